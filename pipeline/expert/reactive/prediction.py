"""Prediction of a target: a Kalman filter of constant velocity; turning by difference."""

import numpy as np
from numpy.typing import ArrayLike

from pipeline.poses import (
    Floats,
    Pose,
    angle_between,
    quat_about,
    quat_conjugate,
    quat_multiply,
    quat_rotate,
    transform,
)

UNSTEADY = np.array([0.15, 0.15, 0.015])
"""Standard deviations (m/s2) of a target's acceleration along x, y, z. With exact sightings the
filter follows the last two, with an error of 5 mm about the last ten."""

EXACT = 1e-4  # m, standard deviation of a position seen without error
SLOW = np.array([0.1, 0.1, 0.01])  # m/s, of the velocity before the target was seen twice
ROLLING = 1.5  # rad/s about a level axis, from which a target rolls: no hand turns with it


class TargetFilter:
    """A target's motion as seen so far. `noise` (m) is per coordinate; `surprise` (m) the last
    error of prediction. The point `centre` (3,) of the body moves evenly. A `ball` is predicted
    upright, however it has rolled: hands take it as it stands.
    """

    def __init__(
        self, noise: float = 0.0, centre: ArrayLike = (0.0, 0.0, 0.0), *, ball: bool = False
    ) -> None:
        self.noise, self._variance = noise, EXACT**2 + noise**2
        self._centre = np.asarray(centre, float)
        self.time, self.surprise = -np.inf, 0.0
        self._state, self._cov = np.zeros((2, 3)), np.zeros((3, 2, 2))
        self._seen = self._turned = np.array([1.0, 0.0, 0.0, 0.0])
        self._rolls = ball
        self._axis, self._rate = np.array([0.0, 0.0, 1.0]), 0.0

    def see(self, time: float, pose: Pose) -> None:
        """The target was at `pose` (7,) at `time` (s), later than before."""
        at = transform(pose, self._centre)
        if not np.isfinite(self.time):
            self._state[0], self._cov[:, 0, 0], self._cov[:, 1, 1] = (at, self._variance, SLOW**2)
        else:
            dt = time - self.time
            ahead = np.array([[1.0, dt], [0.0, 1.0]])
            spread = UNSTEADY[:, None] * np.array([dt**2 / 2, dt])
            self._state = ahead @ self._state
            self._cov = ahead @ self._cov @ ahead.T + spread[:, :, None] * spread[:, None]
            error = at - self._state[0]
            gain = self._cov[:, :, 0] / (self._cov[:, :1, 0] + self._variance)
            self._state = self._state + gain.T * error
            self._cov = self._cov - gain[:, :, None] * self._cov[:, :1]
            self.surprise = float(np.linalg.norm(error))
            self._turn(pose[3:], dt)
        self.time, self._seen = time, pose[3:].copy()
        if not self._rolls:
            self._turned = self._seen

    def _turn(self, quaternion: Floats, dt: float) -> None:
        by = quat_multiply(quaternion, quat_conjugate(self._seen))
        sine = float(np.linalg.norm(by[1:]))
        self._rate = angle_between(quaternion, self._seen) / dt if sine > 1e-6 else 0.0
        if self._rate:
            self._axis = by[1:] / sine * (1.0 if by[0] >= 0 else -1.0)
            self._rolls |= bool(self._rate > ROLLING and abs(self._axis[2]) < 0.5)
        self._rate *= not self._rolls

    @property
    def velocity(self) -> Floats:
        """Estimated (3,), m/s."""
        return self._state[1]

    def predict(self, time: float) -> Pose:
        """The expected pose (7,) at `time` (s)."""
        ahead = time - self.time
        turned = self._turned
        if self._rate:
            turned = quat_multiply(quat_about(self._axis, self._rate * ahead), turned)
        centre = self._state[0] + ahead * self._state[1]
        return np.concatenate([centre - quat_rotate(turned, self._centre), turned])
