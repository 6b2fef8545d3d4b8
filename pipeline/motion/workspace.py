"""The rectangle for a target's path, and the quadrant rule."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pipeline.poses import Bools, Floats

# Control points are clipped onto the edges; their curve comes back from arithmetic some 1e-16 m
# beside them.
ROUNDING = 1e-9
QUADRANT_MARGIN = 0.02


@dataclass(frozen=True)
class Workspace:
    """Rectangle in the world's xy plane, m. Raises ValueError if it is empty or not finite."""

    x_min: float
    x_max: float
    y_min: float
    y_max: float

    def __post_init__(self) -> None:
        if not (np.isfinite([self.x_min, self.x_max, self.y_min, self.y_max]).all()):
            raise ValueError(f"workspace {self} is not finite")
        if self.x_min >= self.x_max or self.y_min >= self.y_max:
            raise ValueError(f"workspace {self} is empty: x_min < x_max, y_min < y_max")

    @property
    def lower(self) -> Floats:
        return np.array([self.x_min, self.y_min])

    @property
    def upper(self) -> Floats:
        return np.array([self.x_max, self.y_max])

    def contains(self, points: ArrayLike, margin: float = 0.0) -> Bools:
        """Which points (..., 2 or 3) lie at least `margin` m inside (to 1 nm)."""
        xy = np.asarray(points, float)[..., :2]
        inset = margin - ROUNDING
        if xy.ndim == 1:  # arrays of two numbers cost ten times as much
            x, y = xy.tolist()
            inside = self.x_min + inset <= x <= self.x_max - inset
            return np.asarray(inside and self.y_min + inset <= y <= self.y_max - inset)
        return np.asarray(((xy >= self.lower + inset) & (xy <= self.upper - inset)).all(-1))

    def clip(self, points: ArrayLike) -> Floats:
        """Points (..., 2) moved to the nearest point of the rectangle."""
        return np.clip(np.asarray(points, float), self.lower, self.upper)

    def guarded(self, end: ArrayLike, margin: float = QUADRANT_MARGIN) -> "Workspace":
        """The part in which a path to `end` (2,) must stay by the quadrant rule (appendix D.3): the
        two edges closest to it are kept at `margin` m, or at its own distance if smaller."""
        end = np.asarray(end, float)
        high = end >= (self.lower + self.upper) / 2
        room = np.where(high, self.upper - end, end - self.lower)
        inset = np.clip(room, 0.0, margin)
        low, up = self.lower + np.where(high, 0.0, inset), self.upper - np.where(high, inset, 0.0)
        return Workspace(float(low[0]), float(up[0]), float(low[1]), float(up[1]))


def draw_within_reach(
    rng: np.random.Generator, n: int, workspace: Workspace, centre: ArrayLike, radius: float
) -> Floats:
    """`n` points (n, 2) uniform in the part of the disc inside the workspace."""
    centre = np.asarray(centre, float)
    low = np.maximum(workspace.lower, centre - radius)
    up = np.minimum(workspace.upper, centre + radius)
    points = rng.uniform(low, up, (n, 2))
    while (outside := np.linalg.norm(points - centre, axis=-1) > radius).any():
        points[outside] = rng.uniform(low, up, (int(outside.sum()), 2))
    return points
