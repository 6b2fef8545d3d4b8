"""The robots that exist, and two single arms as one embodiment."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from pipeline.data.names import NONE, SIDES
from pipeline.data.setup.rules import Layout
from pipeline.poses import compose, pose, quat_from_rpy
from pipeline.registry import Registry
from pipeline.world.shapes import Mesh

from .contract import Arm, Embodiment, RobotError, check_arm
from .directory import TOML, RobotModel
from .stands import HEAD_CAMERA, Stand, pedestal

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
