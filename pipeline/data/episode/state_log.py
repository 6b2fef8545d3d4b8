"""The state log: physics at the recording rate."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.data.keys import arrays_digest, digest
from pipeline.data.names import sides_of
from pipeline.data.spec import EpisodeSpec
from pipeline.poses import Bools, Floats, between

CONTACT_DTYPE = np.dtype(
    [
        ("frame", "<i4"),
        ("a", "<i2"),
        ("b", "<i2"),
        ("impulse", "<f4"),
        ("point", "<f4", (3,)),
        ("points", "<i2"),
    ]
)
"""Bodies a < b (indices into `StateLog.bodies`) touched in the interval that ends at `frame`: the
largest summed impulse (N s), its mean point (m, world) and number of points."""


@dataclass(frozen=True)
class Event:
    """Something that happened (meeting, release, success...), at `time` (s), `by` a body."""

    name: str
    time: float
    by: str = ""


@dataclass(frozen=True)
class SkillRun:
    """A skill executed in physics steps `start` (exclusive) to `end`.

    `half` is "meet" or "finish". Of nested runs the outer one comes first.
    """

    skill: str
    arms: tuple[str, ...]
    body: str
    part: str
    half: str
    start: int
    end: int


@dataclass(frozen=True)
class Touch:
    """The first physics step in which an arm pushed the target; `point` (3,) is the mean contact
    (m, world).
    """

    side: str
    step: int
    point: tuple[float, ...]
    points: int
    tcp: tuple[float, ...]
    target: tuple[float, ...]


@dataclass(eq=False)
class StateLog:
    """T frames. Names index the second axis of the arrays beside them; poses xyz + wxyz, world."""

    times: Floats  # (T,) s
    # objects, links of the arms (side_link), scenery of the motion, "table"
    bodies: tuple[str, ...]
    poses: Floats  # (T, B, 7)
    joints: tuple[str, ...]  # side_joint, jaws included
    qpos: Floats  # (T, J) measured, rad or m
    qvel: Floats  # (T, J) measured
    vector_names: tuple[str, ...]
    state: Floats  # (T, A) measured vector: arm joints (rad), grippers normalised 0-1
    action: Floats  # (T, A) commanded for the interval after the frame
    tcp: Floats  # (T, S, 7) measured tcp poses of `sides`
    target_velocity: Floats  # (T, 3) m/s of the target's origin, world frame
    contacts: NDArray[np.void]  # CONTACT_DTYPE
    events: list[Event] = field(default_factory=list)
    skills: list[SkillRun] = field(default_factory=list)
    touches: list[Touch] = field(default_factory=list)
    # (T, 3) rad/s, world frame; None in files of earlier versions
    target_angular_velocity: Floats | None = None
    # (T,) whether the expert acts after the frame, where a policy acts first
    intervention: Bools | None = None
    # (T, A) what the expert commands, or would command, after the frame
    expert_action: Floats | None = None

    def __len__(self) -> int:
        return len(self.times)

    @property
    def sides(self) -> tuple[str, ...]:
        """The arms: the second axis of `tcp`."""
        return sides_of(self.vector_names)

    def pose(self, body: str) -> Floats:
        """Poses (T, 7) of one body."""
        return self.poses[:, self.bodies.index(body)]

    def late(self, frames: float) -> "StateLog":
        """The log with the poses of `frames` before, as late cameras show them."""
        if not frames:
            return self
        return replace(self, poses=between(self.poses, np.arange(len(self)) - frames))

    def event(self, name: str) -> Event | None:
        """The first event of that name."""
        return next((e for e in self.events if e.name == name), None)

    def frames_until(self, event: str, more: float) -> int:
        """How many frames end `more` s after an event; all if it did not happen."""
        time = self.time_of(event)
        if time is None:
            return len(self)
        return max(1, int(np.searchsorted(self.times, time + more + 1e-6, side="right")))

    def time_of(self, event: str) -> float | None:
        """Time (s) of the first event of that name."""
        first = self.event(event)
        return first and first.time


_ARRAYS = ("times", "poses", "qpos", "qvel", "state", "action", "tcp", "target_velocity")


def physics_id(spec: EpisodeSpec, log: StateLog) -> str:
    """sha256 (32 hex digits) of a spec and of what happened, whatever the images. Equal ones
    belong in one split.
    """
    arrays = {name: getattr(log, name) for name in _ARRAYS}
    return digest([spec.to_json(), list(log.bodies), list(log.joints), arrays_digest(arrays)])
