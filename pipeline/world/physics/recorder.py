"""Turns a running simulation into a state log at the recording rate."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.data.episode.state_log import CONTACT_DTYPE, Event, StateLog, Touch
from pipeline.data.names import SIDES
from pipeline.poses import Floats

from .simulation import PHYSICS_HZ, Simulation

CONTACT_EVERY = 8
"""Physics steps between samples of contacts (30 Hz); also sampled at the meeting."""


class _Rows:
    """An array that doubles when full: appending stays cheap."""

    def __init__(self, row: NDArray[Any]) -> None:
        self._held, self._count = np.empty((256, *row.shape), row.dtype), 0

    def append(self, row: Any) -> None:
        if self._count == len(self._held):
            self._held = np.concatenate([self._held, np.empty_like(self._held)])
        self._held[self._count] = row
        self._count += 1

    @property
    def rows(self) -> NDArray[Any]:
        """The rows so far (N,...), a stable view."""
        return self._held[: self._count]


class Recorder:
    """Call `after_step` after every physics step.

    Frame k is the state after 16 k steps (at 15 Hz), its action the interval's last command. First
    contacts of `watched` arms are noted to the step (30 us a step until all touched). Raises
    ValueError when `fps` does not divide the physics rate.
    """

    def __init__(self, simulation: Simulation, fps: int = 15) -> None:
        if PHYSICS_HZ % fps:
            raise ValueError(f"fps {fps} does not divide the physics rate of {PHYSICS_HZ} Hz")
        self.simulation, self.fps = simulation, fps
        self._every = PHYSICS_HZ // fps
        self._columns = tuple(map(_Rows, self._measured()))
        self._actions = _Rows(np.asarray(simulation.command, float))
        self._contacts = _Rows(np.zeros((), CONTACT_DTYPE))
        self._open: dict[tuple[int, int], tuple[float, Floats, int]] = {}
        self._first = dict[str, Touch]()
        self.watched: tuple[str, ...] = ()
        self.extra: list[Event] = []
        self._capture()

    def after_step(self) -> None:
        """Note contacts and, at an interval's end, the frame."""
        s = self.simulation
        if s.steps % CONTACT_EVERY == 0 or s.steps == s.touched_at:
            for a, b, impulse, point, points in s.contacts():
                if impulse > self._open.get((a, b), (0.0, None))[0]:
                    self._open[a, b] = (impulse, point, points)
        if len(self._first) < len(self.watched):
            untouched = [side for side in self.watched if side not in self._first]
            for side, points in s.target_contacts(untouched).items():
                centre = tuple(math.fsum(axis) / len(points) for axis in points.T)
                poses = tuple(tuple(map(float, pose)) for pose in (s.tcp(side), s.pose(s.target)))
                self._first[side] = Touch(side, s.steps, centre, len(points), *poses)
        if s.steps % self._every == 0:
            self._actions.append(s.command)
            self._capture()

    def _measured(self) -> tuple[Floats, ...]:
        """Poses (B,7), joint positions and velocities (J,), state (A,), tools (S,7), target
        velocities (3,)."""
        s = self.simulation
        qpos, qvel = s.qpos()
        tcp = np.stack([s.tcp(side) for side in s.embodiment.sides])
        twist = s.target_twist()
        return s.poses(), qpos, qvel, s.state_vector(qpos), tcp, twist[:3], twist[3:]

    def _capture(self) -> None:
        frame = len(self._columns[0].rows)
        for pair, strongest in sorted(self._open.items()):
            self._contacts.append((frame, *pair, *strongest))
        self._open = {}
        for column, row in zip(self._columns, self._measured(), strict=True):
            column.append(row)
        self._captured = self.simulation.steps

    @property
    def state(self) -> Floats:
        """Measured vector (A,) of now."""
        s = self.simulation
        if s.steps == self._captured:
            return self._columns[3].rows[-1]
        return s.state_vector(s.qpos()[0])

    @property
    def past(self) -> Floats:
        """Poses (T,B,7) at past frames, and of now if between frames."""
        rows, s = self._columns[0].rows, self.simulation
        return rows if s.steps % self._every == 0 else np.concatenate([rows, s.poses()[None]])

    def log(self) -> StateLog:
        """The state log up to the last full frame."""
        s = self.simulation
        poses, qpos, qvel, state, tcp, velocity, spin = (column.rows for column in self._columns)
        actions = self._actions.rows
        last = actions[-1] if len(actions) else s.command
        return StateLog(
            times=np.arange(len(poses)) / self.fps,
            bodies=s.names,
            poses=poses,
            joints=s.joint_names,
            qpos=qpos,
            qvel=qvel,
            vector_names=s.embodiment.vector_names,
            state=state,
            action=np.concatenate([actions, last[None]]),
            tcp=tcp,
            target_velocity=velocity,
            target_angular_velocity=spin,
            contacts=self._contacts.rows,
            events=sorted([*s.events, *self.extra], key=lambda e: e.time),
            touches=[self._first[side] for side in SIDES if side in self._first],
        )
