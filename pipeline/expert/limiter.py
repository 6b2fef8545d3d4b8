"""Joint commands after a moving goal, within limits up to jerk."""

from collections.abc import Sequence

import numpy as np

from pipeline.data.clock import PHYSICS_HZ
from pipeline.planning.budgets import LIMITS
from pipeline.poses import Floats

WINDOW = int(np.ceil(2 * LIMITS.acceleration / LIMITS.jerk * PHYSICS_HZ - 1e-9))
"""Rows that are averaged, as in trajectory.smoothed: the limit of acceleration becomes one of
jerk."""
LAG = (WINDOW - 1) / 2 / PHYSICS_HZ  # s by which commands follow later than what is averaged
STIFFNESS = 40.0  # 1/s, how fast a small remaining distance is closed
BRAKING = 0.35  # share of the acceleration limit that is counted on for coming to rest
TINY = 1e-12


class Limiter:
    """Commands at the physics rate, LAG later than their goal, from rest at `start` (A,). The
    columns of each of `arms` close their distances in proportion, else a swinging hand would
    dip."""

    def __init__(
        self, start: Floats, speed: Floats, acceleration: Floats, arms: Sequence[slice] = ()
    ) -> None:
        self.at, self.velocity = start.copy(), np.zeros(len(start))
        self.speed, self._acceleration, self._arms = speed, acceleration, arms
        self._rows = np.repeat(start[None], WINDOW, axis=0)

    @property
    def stop(self) -> Floats:
        """Where (A,) it comes to rest if it begins to brake now."""
        return self.at + self.velocity * np.abs(self.velocity) / (2 * BRAKING * self._acceleration)

    def follow(self, goal: Floats, velocity: Floats) -> tuple[Floats, Floats]:
        """The next command (A,) and its velocity, for a `goal` (A,) after this step."""
        dt = 1.0 / PHYSICS_HZ
        gap = goal - self.at - velocity * dt
        size, room = np.abs(gap) + TINY, self.speed - np.sign(gap) * velocity
        rate = np.minimum(STIFFNESS, np.sqrt(2 * BRAKING * self._acceleration / size))
        rate = self._least(np.clip(room / size, 0.0, rate))
        change = np.clip(velocity + rate * gap, -self.speed, self.speed) - self.velocity
        share = self._least(np.minimum(1.0, self._acceleration * dt / (np.abs(change) + TINY)))
        self.velocity = self.velocity + share * change
        self.at = self.at + self.velocity * dt
        before = self._rows.mean(axis=0)
        self._rows = np.concatenate([self._rows[1:], self.at[None]])
        after = self._rows.mean(axis=0)
        return after, (after - before) * PHYSICS_HZ

    def _least(self, values: Floats) -> Floats:
        """Values (A,) of which those of an arm are its least one."""
        for arm in self._arms:
            values[arm] = values[arm].min()
        return values
