"""The robots that exist, two single arms as one embodiment, and what they stand on."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from pipeline.data.names import NONE, SIDES
from pipeline.data.setup.rules import Layout
from pipeline.poses import compose, pose, quat_from_rpy
from pipeline.registry import Registry
from pipeline.world.objects import geometry
from pipeline.world.objects.surface import join
from pipeline.world.shapes import Material, Mesh, Parts

from .contract import Arm, Embodiment, RobotError, check_arm
from .directory import HEAD_CAMERA, TOML, RobotModel, Stand, Triple, box

_STRETCHES = 0.6
"""m, below which furniture stretches and above which it rises."""


def raised(embodiment: Embodiment, by: float) -> Embodiment:
    """Arms, furniture and head camera `by` m higher."""
    up = pose((0, 0, by))
    arms, pieces = embodiment.arms.items(), embodiment.furniture_collision
    return replace(
        embodiment,
        arms={side: replace(arm, base=compose(up, arm.base)) for side, arm in arms},
        furniture=tuple((_stretched(mesh, by), skin) for mesh, skin in embodiment.furniture),
        furniture_collision=tuple(replace(c, pose=compose(up, c.pose)) for c in pieces),
        head_camera=compose(up, embodiment.head_camera),
    )


def looking(embodiment: Embodiment, shift: ArrayLike, turn: Sequence[float]) -> Embodiment:
    """Move the head camera by `shift` m and turn it by `turn` rad (roll, pitch, yaw) in its
    frame."""
    moved = compose(embodiment.head_camera, pose(shift, quat_from_rpy(*turn)))
    return replace(embodiment, head_camera=moved)


def _stretched(mesh: Mesh, by: float) -> Mesh:
    rise = by * np.clip(mesh.vertices[:, 2] / _STRETCHES, 0.0, 1.0)
    return replace(mesh, vertices=(mesh.vertices + np.outer(rise, (0, 0, 1))).astype(np.float32))


CHARCOAL = Material((0.17, 0.175, 0.185), roughness=0.5)
GREY = Material((0.42, 0.43, 0.45), roughness=0.5)
SILVER = Material((0.72, 0.73, 0.75), roughness=0.35, metallic=0.6)

TABLE_EDGE = -0.35  # y of the table's edge on the robot's side, m
GAP = 0.003  # between the stand's collision and the base link, m


def pedestal(base: Triple, half: float) -> Stand:
    """A stand (world frame) for `base` (m) with a square foot of half edge `half` (m). Only the
    plate under the foot may reach over the table."""
    x, y, z = base
    column_y = min(y, TABLE_EDGE - 0.015 - half)
    front = max(y, column_y) + half
    width = half - 0.012
    left, right, back = x - half, x + half, column_y - half
    foot = block((left, back, z - 0.018), (right, front, z), 0.003)
    column = (x - width, column_y - width, 0.03), (x + width, column_y + width, z - 0.017)
    plate = (left - 0.05, back - 0.06, 0), (right + 0.05, column_y + half, 0.03)
    boards = (SILVER, [block(*column, 0.004)]), (GREY, [block(*plate, 0.004)])
    upper = box((left, back, z - 0.018), (right, front, z - GAP))
    lower = box((left, back, 0), (right, column_y + half, z - 0.018))
    return painted((CHARCOAL, [foot]), *boards), (upper, lower)


def block(lower: ArrayLike, upper: ArrayLike, bevel: float = 0.0) -> Mesh:
    """Box between two corners (3,), m, with chamfered edges."""
    solid = box(lower, upper)
    return geometry.box(*solid.size, bevel=bevel).moved(solid.pose)


def painted(*groups: tuple[Material, Iterable[Mesh]]) -> Parts:
    """One joined mesh per material saves draw calls."""
    listed = ((material, tuple(meshes)) for material, meshes in groups)
    return tuple((join(*meshes), material) for material, meshes in listed if meshes)


MODELS = Registry[RobotModel]("robot")
ALIASES: dict[str, str] = {}


def register(directory: Path) -> RobotModel:
    """Register a robot by its directory's name; an earlier one stays. Raises RobotError."""
    known = MODELS.get(directory.name)
    if known is not None and known.directory == directory:
        return known
    model = RobotModel(directory)
    for word in (model.name, *model.settings.aliases):
        wrong = ""
        if word in MODELS or word in ALIASES:
            wrong = f"another robot is called {word!r}; rename the directory or the alias"
        elif word in ("", NONE) or word != word.strip().lower() or set(word) & set("+_,/ "):
            wrong = f"{word!r} is no name of a robot; use lower case and hyphens"
        if wrong:
            raise RobotError(f"{directory / TOML}: {wrong}")
    ALIASES.update(dict.fromkeys(model.settings.aliases, model.name))
    return MODELS.add(model.name, model)


def register_all(folder: Path) -> None:
    """Register a folder's robots by name order. Raises RobotError."""
    for path in sorted(folder.glob(f"*/{TOML}")):
        register(path.parent)


def pair(left: RobotModel | None, right: RobotModel | None, layout: Layout = "ours") -> Embodiment:
    """The left arm of one model and the right arm of another; None for a missing one. Raises
    RobotError for an unsound spec."""
    twin = left if left is right else None
    arms, parts = dict[str, Arm](), list[Stand]()
    for side, model in zip(SIDES, (left, right), strict=True):
        if model is None:
            continue
        arm, original = model.arm(side), model.settings.original
        if layout == "original" and original is not None:
            arm = replace(arm, base=np.concatenate([original[side], arm.base[3:]]))
        check_arm(model.name, side, arm)
        arms[side] = arm
        x, y, z = arm.base[:3].tolist()
        parts.append(pedestal((x, y, z), model.settings.foot))
    if twin and (body := twin.body()):
        parts = [body]
    return Embodiment(
        twin.name if twin else "+".join(model.name if model else NONE for model in (left, right)),
        arms,
        HEAD_CAMERA,
        tuple(part for visual, _ in parts for part in visual),
        tuple(piece for _, solid in parts for piece in solid),
        twin.settings.aliases if twin else (),
    )
