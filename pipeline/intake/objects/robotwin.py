"""Objects of RoboTwin-OD.

`NNN_name/` has instances `visual/base{i}.glb` and `collision/base{i}.glb`, `base{i}.glb` or
`textured{i}.obj`, with a `model_data{i}.json`. Contact frames are unscaled: the gripper approaches
against their y axis and opens along z.
"""

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError

from pipeline.data.parsing import ParseError, first_fault, read_json
from pipeline.poses import Floats, Pose, from_matrix, quat_rotate
from pipeline.world.meshes.reader import read_mesh, welded
from pipeline.world.objects.from_files import ObjectError, Phrases

from .draft import ObjectDraft, ObjectOptions, check_size, looks_of, moved, settings_of
from .holding import pinch_at, two_finger_grasps
from .standing import instance_of, kinds_like, solid_of, stand_up

# raise it when the same files give other objects: those in the user's cache are made again then
VERSION = 2
# kg, where the user gives none: the original's 0.01 kg is lighter than any of these things
MASS = 0.1

ARTICLE = re.compile(r"^(a|an|the)\s+", re.IGNORECASE)


class _Data(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False)

    scale: float | tuple[float, float, float] | None = None
    contact_points_pose: tuple[Any, ...] = ()
    functional_matrix: tuple[Any, ...] = ()
    target_pose: tuple[Any, ...] = ()


@dataclass(frozen=True)
class Instance:
    """The files of one instance; its number is "" for the only one."""

    number: str
    visual: Path
    solid: Path
    data: Path

    @property
    def at(self) -> int:
        return int(self.number or 0)


def is_robotwin(directory: Path) -> bool:
    return directory.is_dir() and any(directory.glob("model_data*.json"))


def drafts_of_directory(directory: Path, options: ObjectOptions) -> dict[str, ObjectDraft]:
    numbered = instances(directory)
    if not numbered:
        raise ObjectError(f"{directory}: has no base.glb; articulated objects are not read")
    drafts = dict[str, ObjectDraft]()
    for each in numbered:
        name = options.name if len(numbered) == 1 else f"{options.name}_{each.at}"
        drafts[name] = draft_of_instance(each, replace(options, name=name))
    return drafts


def instances(directory: Path) -> list[Instance]:
    found = list[Instance]()
    for data in filter(Path.is_file, directory.glob("model_data*.json")):
        number = data.stem.removeprefix("model_data")
        names = (f"visual/base{number}.glb", f"base{number}.glb", f"textured{number}.obj")
        visual = next(filter(Path.is_file, (directory / name for name in names)), None)
        if visual is not None and (number.isdecimal() or not number):
            solid = directory / f"collision/base{number}.glb"
            found.append(Instance(number, visual, solid if solid.is_file() else visual, data))
    return sorted(found, key=lambda each: each.at)


def draft_of_instance(each: Instance, options: ObjectOptions, unscaled: float = 1.0) -> ObjectDraft:
    data, noun = _read(each.data), instance_of(options.family).words().noun
    given = np.asarray(unscaled if data.scale is None else data.scale, float)
    scale = np.broadcast_to(given * options.scale, 3)
    scaled = np.diag([*scale, 1.0])
    read = [read_mesh(file, options.within) for file in (each.visual, each.solid)]
    looks, solids = ([part.moved(scaled) for part in mesh.parts] for mesh in read)
    check_size(each.visual, looks)
    pieces = solid_of(*welded(solids), str(each.solid))
    upright = stand_up(pieces, options.family, options.up, "y", str(each.visual))
    solid = moved(pieces, upright)
    contacts = _poses(data.contact_points_pose, scale, upright)
    axes = (quat_rotate(at[3:], np.eye(3)[1:]) for at in contacts)
    pinched = (pinch_at(solid, p[:3], -y, z) for p, (y, z) in zip(contacts, axes, strict=True))
    grasps = tuple(grasp for grasp in pinched if grasp is not None) or two_finger_grasps(solid)
    mass = options.mass or (None if options.density else MASS)
    usual = replace(options, mass=mass, words=options.words or (noun,))
    source = f"robotwin:{each.data.parent.name}/{each.visual.name}"
    settings = settings_of(usual, solid, kinds_like(grasps, solid, options.family), source)
    frames = dict(settings.frames)
    for kind, given in (("functional", data.functional_matrix), ("target", data.target_pose)):
        for i, at in enumerate(_poses(given, scale, upright)):
            frames[f"{kind}_{i}"] = tuple(at.round(6).tolist())
    words = settings.words if options.words else _read_phrases(each, noun) or settings.words
    settings = settings.model_copy(update={"frames": frames, "words": words})
    return ObjectDraft(settings, looks_of(looks, upright), solid, read[0].notes)


def described_in(each: Instance) -> Path | None:
    model = each.data.parent.absolute()
    folder = model / "../../../description/objects_description" / model.name
    file = folder / f"base{each.number}.json"
    return file if file.is_file() else None


def _read_phrases(each: Instance, noun: str) -> Phrases | None:
    file = described_in(each)
    try:
        texts = {} if file is None else read_json(file)
    except ParseError as error:
        raise ObjectError(str(error)) from error
    both = list[tuple[str, ...]]()
    for key in ("seen", "unseen"):
        given = texts.get(key) if isinstance(texts, dict) else None
        short = (t for t in given or () if isinstance(t, str) and 0 < len(t) <= 80)
        both.append(tuple(dict.fromkeys(ARTICLE.sub("", text.strip()) for text in short)))
    seen, unseen = both
    return Phrases(noun=noun, seen=(noun, *seen), unseen=unseen or (noun,)) if seen else None


def _poses(matrices: tuple[Any, ...], scale: Floats, upright: Floats) -> list[Pose]:
    """Frames (7,) in the standing frame."""
    poses = []
    for values in matrices:
        try:
            matrix = np.array(values, float)
        except (TypeError, ValueError) as error:
            raise ObjectError("model_data: a frame is not a matrix of 4 x 4 numbers") from error
        is_sound = matrix.shape == (4, 4) and np.isfinite(matrix).all()
        if not is_sound or abs(np.linalg.det(matrix[:3, :3])) < 1e-6:
            continue
        left, _, right = np.linalg.svd(matrix[:3, :3])
        rotation = left @ np.diag([1, 1, np.sign(np.linalg.det(left @ right))]) @ right
        out = np.eye(4)
        out[:3, :3] = upright[:3, :3] @ rotation
        out[:3, 3] = upright[:3, :3] @ (matrix[:3, 3] * scale) + upright[:3, 3]
        poses.append(from_matrix(out))
    return poses


def _read(path: Path) -> _Data:
    try:
        return _Data.model_validate(read_json(path))
    except ValidationError as error:
        raise ObjectError(f"{path}: {first_fault(error)}") from error
    except (ParseError, OSError) as error:
        raise ObjectError(str(error)) from error
