"""Joint commands that go after a moving goal within limits of velocity, acceleration and jerk."""

import numpy as np

from pipeline.data.clock import PHYSICS_HZ
from pipeline.planning.budgets import LIMITS
from pipeline.poses import Floats

WINDOW = int(np.ceil(2 * LIMITS.acceleration / LIMITS.jerk * PHYSICS_HZ - 1e-9))
"""Rows that are averaged, as in planning/trajectory.smoothed: this turns the limit of acceleration
into one of jerk."""

LAG = (WINDOW - 1) / 2 / PHYSICS_HZ
"""Seconds by which the commands follow later than what is averaged."""

STIFFNESS = 40.0
"""1/s; how fast a small remaining distance is closed."""

BRAKING = 0.35
"""Share of the acceleration limit that is counted on for coming to rest."""


class Limiter:
    """Commands of some columns at the physics rate, LAG later than their goal. It begins at rest at
    `start` (A,).

    `speed` and `acceleration` (A,) limit the differences of the commands, in units per s and s2;
    LIMITS.jerk those of the accelerations.
    """

    def __init__(self, start: Floats, speed: Floats, acceleration: Floats) -> None:
        self.at, self.velocity = start.copy(), np.zeros(len(start))
        self.speed, self._acceleration = speed, acceleration
        self._rows = np.repeat(start[None], WINDOW, axis=0)

    @property
    def stop(self) -> Floats:
        """Where (A,) it comes to rest if it begins to brake now."""
        return self.at + self.velocity * np.abs(self.velocity) / (2 * BRAKING * self._acceleration)

    def follow(self, goal: Floats, velocity: Floats) -> tuple[Floats, Floats]:
        """The next command (A,) and its velocity, for a goal that is at `goal` (A,) after this step
        and moves with `velocity`."""
        dt = 1.0 / PHYSICS_HZ
        gap = goal - self.at - velocity * dt
        closing = np.minimum(
            STIFFNESS * np.abs(gap), np.sqrt(2 * BRAKING * self._acceleration * np.abs(gap))
        )
        wanted = np.clip(velocity + np.sign(gap) * closing, -self.speed, self.speed)
        step = self._acceleration * dt
        self.velocity = self.velocity + np.clip(wanted - self.velocity, -step, step)
        self.at = self.at + self.velocity * dt
        before = self._rows.mean(axis=0)
        self._rows = np.concatenate([self._rows[1:], self.at[None]])
        after = self._rows.mean(axis=0)
        return after, (after - before) * PHYSICS_HZ
