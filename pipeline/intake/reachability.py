"""The pose that a skill failed to reach, and the nearest reachable one, in words."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.planning.failure import PlanFailure
from pipeline.planning.planner import ArmPlanner
from pipeline.poses import Pose, quat_rotate
from pipeline.stages.failure import Failure

JUDGED = 12  # wanted poses, evenly spread over all, around which a reachable one is looked for
NEAR, FAR = (0.0, 0.01, 0.02, 0.03, 0.04, 0.06, 0.08), (0.1, 0.13, 0.16, 0.2, 0.25, 0.3)
DISTANCES = (*NEAR, *FAR, 0.4, 0.5, 0.6)
"""Metres from a wanted pose that are tried, nearest first."""


@dataclass(frozen=True, eq=False)
class Unreached:
    """A skill whose arm cannot reach the tcp pose (7,) that it `wanted`. `nearest` is the next one
    of that orientation at which arm and held body touch nothing."""

    skill: str
    side: str
    wanted: Pose
    nearest: Pose | None

    @property
    def text(self) -> str:
        sine = -quat_rotate(self.wanted[3:], np.array([1.0, 0, 0]))[2]
        down = np.degrees(np.arcsin(np.clip(sine, -1, 1)))
        most = 100 * DISTANCES[-1]
        found = f"no pose of that orientation within {most:.0f} cm is in reach and free"
        if self.nearest is not None:
            apart = float(np.linalg.norm(self.nearest[:3] - self.wanted[:3]))
            place = f"{_place(self.nearest)}, {100 * apart:.1f} cm away"
            found = f"the nearest pose in reach and free is {place}"
            if apart < 1e-9:
                found = "that pose is in reach and free, and no path leads there"
        return (
            f"{self.skill}: the {self.side} tcp is to be at {_place(self.wanted)}, {down:.0f}"
            f" degrees below the horizontal; {found}"
        )


def find_unreached(failure: Failure) -> Unreached | None:
    """The pose of a failure; None if it is not about poses."""
    plan = failure.__cause__
    if not isinstance(plan, PlanFailure) or not isinstance(plan.arm, ArmPlanner):
        return None
    if plan.wanted is None or not len(plan.wanted):
        return None
    some = plan.wanted[np.unique(np.linspace(0, len(plan.wanted) - 1, JUDGED).round().astype(int))]
    wanted, there = nearest(plan.arm, some) or (some[0], None)
    return Unreached(plan.skill, plan.arm.side, wanted, there)


def nearest(arm: ArmPlanner, wanted: NDArray[np.float64]) -> tuple[Pose, Pose] | None:
    """One of the tcp poses `wanted` (N,7), and the nearest free one of its orientation, if any. It
    is right to a tenth of the step between DISTANCES."""
    free = arm.checker()

    def first(poses: NDArray[np.float64]) -> int | None:
        q, ok = arm.solve(poses)
        return next((int(i) for i in np.flatnonzero(ok) if free(q[i])), None)

    directions = np.array([d for d in np.ndindex(3, 3, 3) if d != (1, 1, 1)], float) - 1
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    # from every wanted pose in every direction
    starts = np.repeat(wanted, len(directions), 0)
    ways = np.pad(np.tile(directions, (len(wanted), 1)), ((0, 0), (0, 4)))
    for before, distance in zip((0.0, *DISTANCES), DISTANCES, strict=False):
        if (i := first(starts + distance * ways)) is not None:
            nearer = starts[i] + np.linspace(before, distance, 11)[:, None] * ways[i]
            return starts[i], nearer[first(nearer) or 0]
    return None


def _place(tcp: Pose) -> str:
    return f"({', '.join(f'{value:.3f}' for value in tcp[:3])}) m"
