from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.data.names import SIDES
from pipeline.poses import Floats, Pose
from pipeline.world.shapes import Collider

Sees = Callable[[Floats], NDArray[np.bool_]]  # which world points (N,3) are in an image


def everywhere(points: Floats) -> NDArray[np.bool_]:
    return np.ones(len(points), bool)


class Obstacle(NamedTuple):
    """A body that stands still: collision pieces in the body frame, world pose (7,)."""

    pieces: tuple[Collider, ...]
    pose: Pose


class Carried(NamedTuple):
    """A body in a hand: pieces in the body frame, pose (7,) in the tcp frame."""

    side: str
    pieces: tuple[Collider, ...]
    pose: Pose


@dataclass(frozen=True, eq=False)
class ArmState:
    """Joints q (n,) and gripper, 0 closed to 1 open. The other arm avoids `expected` (n,)."""

    q: Floats
    gripper: float
    expected: Floats


@dataclass(frozen=True, eq=False)
class PlanningScene:
    """Both arms by side, the bodies that stand still and those that are carried, by name;
    read-only. `sees` tells which world points (N,3) the head camera has in its image."""

    arms: Mapping[str, ArmState]
    obstacles: Mapping[str, Obstacle]
    carried: Mapping[str, Carried]
    sees: Sees = everywhere

    def __post_init__(self) -> None:
        for name in ("arms", "obstacles", "carried"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    @property
    def jaws(self) -> tuple[float, float]:
        """Left and right; 1 for an arm that the robot does not have."""
        left, right = (self.arms[side].gripper if side in self.arms else 1.0 for side in SIDES)
        return left, right

    def holding(self, name: str, carried: Carried) -> "PlanningScene":
        """Body `name` is carried, and no longer an obstacle."""
        others = {n: obstacle for n, obstacle in self.obstacles.items() if n != name}
        return replace(self, obstacles=others, carried={**self.carried, name: carried})

    def commanding(self, side: str, q: ArrayLike) -> "PlanningScene":
        state = replace(self.arms[side], q=np.array(q, float), expected=np.array(q, float))
        return replace(self, arms={**self.arms, side: state})

    def expecting(self, side: str, q: ArrayLike) -> "PlanningScene":
        state = replace(self.arms[side], expected=np.array(q, float))
        return replace(self, arms={**self.arms, side: state})
