"""What a target's motion is, and what a model of motions is."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike

from pipeline.poses import Bools, Floats

from .scenery import Prop
from .workspace import Workspace

Array = Floats  # the name that extensions import
SpeedBound = Literal["average", "maximum"]

UNSURE = 1e-6  # relative excess over alpha that rounding explains


@dataclass(frozen=True)
class Features:
    """Average, greatest and last speed (m/s), and distance (m) from start to end."""

    average_speed: float
    maximum_speed: float
    end_speed: float
    displacement: float


class Motion(Protocol):
    """Where a body is at time t (s), in the world."""

    def pose(self, t: ArrayLike) -> Floats:
        """World pose (..., 7), m and wxyz, at times t (...,)."""
        ...

    def twist(self, t: ArrayLike) -> Floats:
        """Linear (m/s), then angular velocity (rad/s), (..., 6), world: after a breakpoint, zero
        before -lead."""
        ...

    def scenery(self) -> tuple[Prop, ...]:
        """What belongs to the motion and is seen: a belt, a disc, a hook."""
        ...


class TargetMotion(Motion, Protocol):
    """Where a target is at time t (s); the robot starts at 0. It stands until -`lead`, is at its
    manipulation pose at `duration`, and continues until released. Positions are the body's origin
    in the world, m; `alpha` is in m/s."""

    @property
    def model(self) -> str: ...
    @property
    def level(self) -> int: ...
    @property
    def alpha(self) -> float: ...
    @property
    def duration(self) -> float: ...
    @property
    def lead(self) -> float: ...

    def breakpoints(self) -> Floats:
        """Times (k,) before the meeting at which velocity may jump."""
        ...

    def features(self) -> Features:
        """Its speeds over [-lead, duration] and its displacement."""
        ...

    def to_json(self) -> str:
        """JSON from which `motion_from_json` restores every float exactly."""
        ...


Visible = Callable[[Floats], Bools]
Free = Callable[[TargetMotion], bool]


@dataclass(frozen=True, eq=False)
class MotionRequest:
    """A motion that is at `end_pose` (7,) at t = `duration` s. It starts at -`lead` s, or later
    where `moving` names shares of lead + duration to try in turn. `alpha` bounds its average speed,
    or with `speed_bound` "maximum" its greatest, `end_speed_limit` that at the meeting,
    `jump_limit` jumps of its velocity (m/s). It stays in `workspace`, also for `tail` s after the
    meeting. `visible(path (N,K,3 or 7)) -> (N,)` accepts paths, `free(motion)` a motion. At most
    `candidates` shapes are drawn. `radius` and `height` (m) are the target's, `floor` (m) its
    height on the table, `company` x, y, radius (m) of bodies carried with it."""

    level: int
    alpha: float
    duration: float
    end_pose: ArrayLike
    workspace: Workspace
    lead: float = 0.0
    tail: float = 0.0
    speed_bound: SpeedBound = "average"
    end_speed_limit: float | None = None
    jump_limit: float | None = None
    moving: tuple[float, ...] = (1.0,)
    visible: Visible | None = None
    free: Free | None = None
    candidates: int = 1000
    radius: float = 0.04
    height: float = 0.08
    floor: float = 0.0
    company: tuple[tuple[float, float, float], ...] = ()

    @property
    def end(self) -> Floats:
        """Where the target is at the meeting (3,), m."""
        return np.asarray(self.end_pose, float)[:3]

    @property
    def total(self) -> float:
        return self.lead + self.duration


@dataclass(frozen=True, eq=False)
class Streams:
    """Random streams: `shape`, shared by a slot's attempts, and `direction`, the attempt's own."""

    shape: np.random.Generator
    direction: np.random.Generator


class NoMotion(Exception):
    """No candidate was acceptable: `counts` by reason, `features` of the last shape, if any."""

    def __init__(
        self, asked: MotionRequest, counts: Mapping[str, int], features: Features | None = None
    ) -> None:
        self.counts, self.features = dict(counts), features
        reasons = ", ".join(f"{reason} {n}" for reason, n in counts.items())
        wanted = f"level {asked.level} at alpha {asked.alpha:g} m/s over {asked.duration:.3g} s"
        super().__init__(f"no motion of {wanted}: {reasons or 'no candidate was allowed'}")


@dataclass(frozen=True)
class Level:
    """One level of a model: its text on cards, and the colour of its plots."""

    text: str
    colour: str


def described(*texts: str) -> Mapping[int, Level]:
    """Levels 1 to 3 by their texts, in the colours of all models."""
    colours = ("#2563eb", "#059669", "#d97706")
    return MappingProxyType(dict(enumerate(map(Level, texts, colours), 1)))


class MotionModel(Protocol):
    """A family of motions, by level but 0. `version` rises when `draw` returns something else."""

    @property
    def name(self) -> str: ...
    @property
    def version(self) -> int: ...
    @property
    def levels(self) -> Mapping[int, Level]: ...

    def draw(self, asked: MotionRequest, streams: Streams) -> TargetMotion:
        """A motion that keeps the request. Raises NoMotion."""
        ...

    def stand(self, asked: MotionRequest, streams: Streams) -> TargetMotion:
        """Level 0: the target at the end pose all the time, among the scenery of the model."""
        ...

    def read(self, values: Mapping[str, Any]) -> TargetMotion:
        """The motion of the values that `to_json` wrote. Raises ValueError."""
        ...


def twist_fault(motion: TargetMotion) -> str:
    """How far velocity is from the derivative of position, by the median error at 41 times; "" if
    it is the derivative."""
    start, h = float(-motion.lead), 1e-4
    times = np.linspace(start + 2 * h, float(motion.duration) - 2 * h, 41)
    moved = (motion.pose(times + h) - motion.pose(times - h))[:, :3] / (2 * h)
    stated = motion.twist(times)[:, :3]
    off = float(np.median(np.linalg.norm(moved - stated, axis=1)))
    fast = float(np.median(np.linalg.norm(moved, axis=1)))
    if off <= 1e-3 + 0.01 * fast:
        return ""
    return f"its twist is not the derivative of its pose: {off:.4f} m/s off at {fast:.4f} m/s"


def keeps_alpha(motion: TargetMotion, speed_bound: SpeedBound) -> bool:
    """Whether a motion moves and keeps its bound alpha."""
    features = motion.features()
    speed = features.average_speed if speed_bound == "average" else features.maximum_speed
    return 0 < speed <= motion.alpha * (1 + UNSURE)
