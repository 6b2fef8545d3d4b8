"""The drive of a target under `contact: hold`, and joints with imperfect drives."""

from collections import deque
from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal

import numpy as np
from sapien.physx import PhysxRigidDynamicComponent

from pipeline.data.clock import PHYSICS_HZ
from pipeline.data.imperfections import DriveErrors
from pipeline.poses import Floats, Pose, quat_conjugate, quat_multiply, quat_rotate, rotation_vector
from pipeline.world.robots.contract import Embodiment

FORCE, TORQUE = 3.0, 0.1
"""N and N m; the most that the drive exerts at the centre of mass, besides the body's weight."""

RATE = 40.0
"""rad/s; natural frequency of the critically damped drive where its force suffices."""

REACH, TURN = 0.01, 0.2
"""m and rad; a body further from its motion is pulled no harder: it returns at RATE * REACH / 2 =
0.2 m/s."""

HELD = 0.2
"""s without a break for which a body must be held before the drive ends."""

Twist = Floats


@dataclass(frozen=True)
class Hold:
    """What holds a target: at least one of `grips`, of which every part touches it. A part is a set
    of names of links or bodies, one of which must touch."""

    grips: tuple[tuple[frozenset[str], ...], ...]

    def holds(self, touching: Collection[str]) -> bool:
        return any(all(part.intersection(touching) for part in grip) for grip in self.grips)


AfterTouch = Literal["stop", "continue"] | Hold
"""What the first touch does: ends the target's own motion, nothing, or starts a drive."""


class Drive:
    """Pulls a touched body to its motion with bounded force and carries its weight until held."""

    def __init__(self, body: PhysxRigidDynamicComponent, hold: Hold) -> None:
        self._body, self._hold, self._steps = body, hold, 0
        self._mass, self._inertia = float(body.mass), np.asarray(body.inertia, float)
        centre = body.cmass_local_pose
        self._centre, self._axes = np.asarray(centre.p, float), np.asarray(centre.q, float)
        body.set_disable_gravity(True)

    def push(self, pose: Pose, twist: Twist, later: Twist) -> None:
        """Apply the next step's force and torque: now `pose` (7,) and `twist` (6,), then the twist
        `later`."""
        body, now = self._body, self._body.entity_pose
        q = np.asarray(now.q, float)
        goal, there = (
            origin + quat_rotate(turn, self._centre)
            for origin, turn in ((pose[:3], pose[3:]), (np.asarray(now.p, float), q))
        )
        gap = _bounded(goal - there, REACH)
        arm = quat_rotate(pose[3:], self._centre)
        speed, next_speed = (v[:3] + np.cross(v[3:], arm) for v in (twist, later))
        pull = (
            RATE**2 * gap
            + 2 * RATE * (speed - np.asarray(body.linear_velocity, float))
            + (next_speed - speed) * PHYSICS_HZ
        )
        turn = _bounded(rotation_vector(quat_multiply(pose[3:], quat_conjugate(q))), TURN)
        spin = RATE**2 * turn + 2 * RATE * (twist[3:] - np.asarray(body.angular_velocity, float))
        principal = quat_multiply(q, self._axes)
        torque = quat_rotate(
            principal, self._inertia * quat_rotate(quat_conjugate(principal), spin)
        )
        force = _bounded(self._mass * pull, FORCE)
        body.add_force_torque(force.astype(np.float32), _bounded(torque, TORQUE).astype(np.float32))

    def is_held(self, touching: Collection[str]) -> bool:
        """Whether held for HELD seconds; call after every step."""
        self._steps = self._steps + 1 if self._hold.holds(touching) else 0
        return self._steps >= round(HELD * PHYSICS_HZ)

    def end(self) -> None:
        """Let the body carry its own weight."""
        self._body.set_disable_gravity(False)


def _bounded(vector: Floats, most: float) -> Floats:
    length = float(np.linalg.norm(vector))
    return vector if length <= most else vector * (most / length)


WAVES = 8
"""Sines of which the noise of a joint is the sum."""

SLOWEST, FASTEST = 0.2, 3.0
"""Hz; the frequencies of the sines."""

ONSET = 0.5
"""s until the noise has its full size: every episode begins at home."""


class ImperfectDrives:
    """Commands (A,) with lag, smooth noise and backlash. Noise from `rng` is slow enough that its
    size is the measured joints' standard deviation."""

    def __init__(self, errors: DriveErrors, robot: Embodiment, rng: np.random.Generator) -> None:
        self._errors = errors
        self._is_arm = np.array([not name.endswith("gripper") for name in robot.vector_names])
        home = np.concatenate([[*arm.home, 1.0] for arm in robot.arms.values()])
        delay = round(errors.lag * PHYSICS_HZ)
        still = (home, np.zeros_like(home))
        self._late = deque([still] * (delay + 1), maxlen=delay + 1)
        self._held = home.copy()
        shape = (len(home), WAVES)
        self._rates = 2 * np.pi * rng.uniform(SLOWEST, FASTEST, shape)
        self._phases = rng.uniform(0, 2 * np.pi, shape)

    def apply(self, command: Floats, velocity: Floats, time: float) -> tuple[Floats, Floats]:
        """Drive positions and velocities (A,) after `time` (s)."""
        self._late.append((command, velocity))
        position, speed = self._late[0]
        before, half = self._held, self._errors.backlash / 2
        played = np.clip(before, position - half, position + half)
        self._held = np.where(self._is_arm, played, position)
        if half:  # a joint within its play is not driven
            speed = np.where(self._is_arm & (played == before), 0.0, speed)
        noise, rate = self._noise(time + 1 / PHYSICS_HZ)
        return self._held + noise, speed + rate

    def _noise(self, time: float) -> tuple[Floats, Floats]:
        """Noise (A,) in rad and its rate in rad/s."""
        size = self._errors.noise * np.sqrt(2 / WAVES) * self._is_arm
        angles = self._rates * time + self._phases
        waves, slopes = np.sin(angles).sum(1), (self._rates * np.cos(angles)).sum(1)
        s = min(time / ONSET, 1.0)
        grown, growth = s * s * (3 - 2 * s), 6 * s * (1 - s) / ONSET
        return size * waves * grown, size * (slopes * grown + waves * growth)
