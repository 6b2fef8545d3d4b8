"""A mesh file as an object's directory."""

import json
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import BaseModel

from pipeline.data.atomic import write_atomic
from pipeline.world.files import write_glb
from pipeline.world.meshes.part import Part
from pipeline.world.meshes.reader import drawn, read_mesh, welded
from pipeline.world.objects import from_files
from pipeline.world.objects.contract import Grasp
from pipeline.world.objects.from_files import ObjectError, ObjectToml, piece
from pipeline.world.shapes import Collider, Parts

from .holding import two_finger_grasps
from .standing import frames_like, kinds_like, solid_of, stand_up

DENSITY = 400.0  # kg/m3: a box of cereal, a mug, a toy
SMALLEST, LARGEST = 0.008, 1.0  # m, the longest edge of an object
TRIANGLES, FEWEST = 2000, 20  # of an object at most, and of one of its parts at least
KEPT_DIGITS = 5


@dataclass(frozen=True)
class ObjectOptions:
    """In kg, kg/m3, m per unit. Textures lie below `within`, by default the mesh's directory."""

    name: str
    family: str
    to: Path
    mass: float | None = None
    density: float | None = None
    up: str | None = None
    scale: float = 1.0
    words: tuple[str, ...] = ()
    licence: str = "unknown"
    within: Path | None = None


@dataclass(frozen=True, eq=False)
class ObjectDraft:
    """An object before it is written; `notes` are on what was guessed or left out."""

    settings: ObjectToml
    looks: Parts
    solid: tuple[Collider, ...]
    notes: tuple[str, ...]


def draft_of(file: Path, options: ObjectOptions) -> ObjectDraft:
    mesh = read_mesh(file, options.within)
    scaled = np.diag([options.scale] * 3 + [1.0])
    parts = [part.moved(scaled) for part in mesh.parts]
    check_size(file, parts)
    pieces = solid_of(*welded(parts), str(file))
    upright = stand_up(pieces, options.family, options.up, mesh.up, str(file))
    solid = moved(pieces, upright)
    grasps = kinds_like(two_finger_grasps(solid), solid, options.family)
    settings = settings_of(options, solid, grasps, file.name)
    return ObjectDraft(settings, looks_of(parts, upright), solid, mesh.notes)


def looks_of(parts: Sequence[Part], upright: np.ndarray) -> Parts:
    return drawn([part.moved(upright) for part in parts], TRIANGLES, FEWEST)


def check_size(file: Path, parts: Sequence[Part]) -> None:
    points = np.concatenate([part.points for part in parts])
    size = float(np.ptp(points, axis=0).max())
    if not SMALLEST <= size <= LARGEST:
        fix = f"try --scale {10.0 ** np.round(np.log10(0.12 / max(size, 1e-12))):g}"
        usual = f"objects are {SMALLEST:g} to {LARGEST:g} m"
        raise ObjectError(f"{file}: is {size:.3g} m long; {usual}: {fix}")


def moved(pieces: Sequence[Collider], matrix: np.ndarray) -> tuple[Collider, ...]:
    turn, shift = matrix[:3, :3].T, matrix[:3, 3]
    points = (np.asarray(one.vertices, np.float64) @ turn + shift for one in pieces)
    return tuple(piece(np.round(each, 6)) for each in points)


def settings_of(
    options: ObjectOptions, solid: Sequence[Collider], grasps: Sequence[Grasp], source: str
) -> ObjectToml:
    volume = sum(one.volume() for one in solid)
    mass = options.mass if options.mass is not None else (options.density or DENSITY) * volume
    words = options.words or (options.name.replace("_", " "),)
    if not 0.001 <= mass <= 50:
        raise ObjectError(f"--mass {mass:.3g}: 0.001 to 50 kg; give --mass, --density or --scale")
    return ObjectToml.model_validate(
        {
            "family": options.family,
            "source": source,
            "licence": options.licence,
            "mass": round(mass, 4),
            "friction": from_files.FRICTION,
            "words": {"noun": words[0], "seen": words[:-1] or words, "unseen": words[-1:]},
            "frames": {name: row(at) for name, at in frames_like(solid, options.family).items()},
            "grasps": [(g.kind, round(g.width, KEPT_DIGITS), row(g.pose)) for g in grasps],
        }
    )


def row(at: np.ndarray) -> list[float]:
    return [*np.round(at[:3] + 0.0, KEPT_DIGITS).tolist(), *np.round(at[3:] + 0.0, 9).tolist()]


def write_object(draft: ObjectDraft, directory: Path) -> None:
    """Write the directory; `object.toml`, which makes it an object, comes last."""
    lines = list[str]()
    for number, one in enumerate(draft.solid):
        lines.append(f"o piece_{number}")
        lines += ["v {:.6f} {:.6f} {:.6f}".format(*corner) for corner in np.asarray(one.vertices)]
    write_atomic(directory / from_files.LOOKS, write_glb(draft.looks))
    write_atomic(directory / from_files.SOLID, ("\n".join(lines) + "\n").encode())
    write_atomic(directory / from_files.TOML, toml_of(draft.settings).encode())


def toml_of(settings: ObjectToml) -> str:
    def rows(table: BaseModel, *keys: str) -> list[str]:
        values = table.model_dump(mode="json", include=set(keys))
        return [f"{key} = {json.dumps(values[key], ensure_ascii=False)}" for key in keys]

    text = [
        *rows(settings, "family", "source", "licence"),
        f"mass = {settings.mass:g}  # kg",
        f"friction = {settings.friction:g}",
        "grasps = [  # kind, width (m), tcp in the object's frame: x y z qw qx qy qz",
        *(f"  {json.dumps([kind, width, list(at)])}," for kind, width, at in settings.grasps),
        "]",
        "",
        "[words]",
        *rows(settings.words, "noun", "seen", "unseen"),
        "",
        "[frames]  # x y z qw qx qy qz, z is the outward normal",
        *(f"{name} = {json.dumps(list(at))}" for name, at in settings.frames.items()),
    ]
    tomllib.loads(joined := "\n".join(text) + "\n")
    return joined
