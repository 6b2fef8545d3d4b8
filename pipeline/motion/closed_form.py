"""What the models in closed form share: a motion is a frozen dataclass of numbers, a model takes
the first one that fits."""

import json
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike
from pydantic import TypeAdapter

from pipeline.data.errors import DominoError
from pipeline.poses import Floats, quat_multiply, quat_rotate

from .contract import (
    Features,
    Level,
    MotionRequest,
    NoMotion,
    Streams,
    TargetMotion,
    keeps_alpha,
    twist_fault,
)
from .pace import LEVELS, Pace
from .scenery import Prop


class MotionError(DominoError):
    """A model whose formulas contradict each other."""


SAMPLES = 60  # poses of a path that must lie in the workspace and be seen

INTEGRATED = 2000  # intervals over which the mean speed is integrated by the midpoint rule


@dataclass(frozen=True)
class ClosedForm(ABC):
    """A motion by formulas at times from -lead on; `end` is its pose at `duration`."""

    kind: ClassVar[str]
    level: int
    alpha: float
    duration: float
    lead: float
    end: tuple[float, float, float, float, float, float, float]

    @property
    def model(self) -> str:
        return self.kind

    @abstractmethod
    def place(self, t: Floats) -> Floats:
        """Pose (..., 7) at times t >= -lead."""

    @abstractmethod
    def rates(self, t: Floats) -> Floats:
        """Twist (..., 6) at times t >= -lead."""

    def pose(self, t: ArrayLike) -> Floats:
        return self.place(np.maximum(np.asarray(t, float), -self.lead))

    def twist(self, t: ArrayLike) -> Floats:
        t = np.asarray(t, float)
        return self.rates(np.maximum(t, -self.lead)) * (t >= -self.lead)[..., None]

    def speed(self, t: ArrayLike) -> Floats:
        """What alpha bounds (m/s) at times t (...,): the speed of the body's origin."""
        return np.asarray(np.linalg.norm(self.twist(t)[..., :3], axis=-1), float)

    def carried_by(self, x: Floats, y: Floats, z: ArrayLike = 0.0) -> Floats:
        """The end pose (..., 7) moved by x, y, z (...,) m."""
        poses = np.broadcast_to(np.array(self.end), (*np.shape(x), 7)).copy()
        for axis, by in enumerate((x, y, z)):
            poses[..., axis] += by
        return poses

    def breakpoints(self) -> Floats:
        return np.zeros(0)

    def features(self) -> Features:
        edges = np.linspace(-self.lead, self.duration, INTEGRATED + 1)
        speeds = self.speed((edges[:-1] + edges[1:]) / 2)
        greatest = max(float(speeds.max()), float(self.speed(edges).max()))
        moved = self.pose(self.duration)[:3] - self.pose(-self.lead)[:3]
        last = float(self.speed(np.array(self.duration)))
        return Features(float(speeds.mean()), greatest, last, float(np.linalg.norm(moved)))

    def scenery(self) -> tuple[Prop, ...]:
        return ()

    def to_json(self) -> str:
        return json.dumps({"model": self.model} | asdict(self), allow_nan=False)


@dataclass(frozen=True)
class Along(ClosedForm):
    """A motion along a path: `at` and `slope` by the advance (m), 0 at the end."""

    pace: Pace

    @abstractmethod
    def at(self, s: Floats) -> Floats:
        """Pose (..., 7) at advances s (...,)."""

    @abstractmethod
    def slope(self, s: Floats) -> Floats:
        """Twist (..., 6) at advances s (...,) for an advance of 1 m/s."""

    def place(self, t: Floats) -> Floats:
        return self.at(self.pace.advance(t))

    def rates(self, t: Floats) -> Floats:
        return self.slope(self.pace.advance(t)) * self.pace.rate(t)[..., None]

    def breakpoints(self) -> Floats:
        return np.array(self.pace.edges[:-1])


class ClosedFormModel[M: ClosedForm]:
    """The first feasible of `candidates`."""

    version = 1
    levels: Mapping[int, Level] = LEVELS

    def __init__(self, motion: type[M]) -> None:
        self._motion = motion

    @property
    def name(self) -> str:
        return self._motion.kind

    def shape(self, asked: MotionRequest, streams: Streams) -> dict[str, Any]:
        """The fields of a motion that are not `common`, without its `heading`."""
        return {}

    def candidates(self, asked: MotionRequest, streams: Streams) -> Iterator[M]:
        """Motions of the slot's shape, in one direction after another."""
        fields: dict[str, Any] = common(asked) | self.shape(asked, streams)
        for heading in headings(streams):
            fields["heading"] = heading
            yield self._motion(**fields)

    def draw(self, asked: MotionRequest, streams: Streams) -> M:
        return first_that_fits(asked, self.candidates(asked, streams))

    def stand(self, asked: MotionRequest, streams: Streams) -> M:
        return next(self.candidates(replace(asked, level=0, alpha=0.0), streams))

    def read(self, values: Mapping[str, Any]) -> M:
        fields = {key: value for key, value in values.items() if key != "model"}
        return TypeAdapter(self._motion).validate_python(fields)


def first_that_fits[M: TargetMotion](asked: MotionRequest, candidates: Iterable[M]) -> M:
    """The first motion that keeps the request. Raises NoMotion."""
    times = np.linspace(-asked.lead, asked.duration + asked.tail, SAMPLES)
    refused, last = Counter[str](), None
    for motion in candidates:
        last, poses = motion, motion.pose(times)
        reason = _refusal(asked, motion, poses)
        if not reason:
            if fault := twist_fault(motion):
                raise MotionError(f"motion {motion.model!r}: {fault}; correct its slope or rates")
            return motion
        refused[reason] += 1
    raise NoMotion(asked, refused, last.features() if last else None)


def _refusal(asked: MotionRequest, motion: TargetMotion, poses: Floats) -> str:
    if not asked.workspace.contains(poses[:, :3]).all():
        return "workspace"
    if not keeps_alpha(motion, asked.speed_bound):
        return "speed"
    if asked.end_speed_limit is not None and motion.features().end_speed > asked.end_speed_limit:
        return "end_speed"
    if asked.visible is not None and not asked.visible(poses[None])[0]:
        return "visibility"
    if asked.free is not None and not asked.free(motion):
        return "blocked"
    return ""


def twists(x: Floats, y: Floats, z: ArrayLike = 0.0, spin: ArrayLike = 0.0) -> Floats:
    """Twists (..., 6) of velocities (...,) m/s and a spin (rad/s) about the vertical."""
    out = np.zeros((*np.shape(x), 6))
    out[..., 0], out[..., 1], out[..., 2], out[..., 5] = x, y, z, spin
    return out


def common(asked: MotionRequest) -> dict[str, Any]:
    """The fields of every motion that keeps a request."""
    kept = {name: getattr(asked, name) for name in ("level", "alpha", "duration", "lead")}
    return kept | {"end": tuple(np.asarray(asked.end_pose, float).tolist())}


def headings(streams: Streams, count: int = 64) -> list[float]:
    """Directions (rad) spread over the circle, in the attempt's order."""
    rng = streams.direction
    spread = (np.arange(count) + rng.random()) * (2 * np.pi / count)
    return (rng.permutation(spread) - np.pi).tolist()


def ways(heading: float) -> tuple[Floats, Floats]:
    """Unit vectors (3,) along `heading` (rad) and to its left."""
    c, s = np.cos(heading), np.sin(heading)
    return np.array([c, s, 0.0]), np.array([-s, c, 0.0])


def ahead_of(heading: float, ahead: Floats, aside: Floats) -> tuple[Floats, Floats]:
    """x and y (...,) m of ways ahead and to the left, seen along `heading` (rad)."""
    c, s = np.cos(heading), np.sin(heading)
    return c * ahead - s * aside, s * ahead + c * aside


def turned_about(end: ArrayLike, pivot: ArrayLike, turn: Floats) -> Floats:
    """Poses (..., 7) of a body after turns (..., 4) about the world point `pivot`."""
    end, pivot = np.asarray(end, float), np.asarray(pivot, float)
    at = pivot + quat_rotate(turn, end[:3] - pivot)
    return np.concatenate([at, quat_multiply(turn, end[3:])], -1)


def turns(axis: ArrayLike, angle: Floats) -> Floats:
    """Quaternions (..., 4) of rotations by `angle` (...,) rad about a unit axis (3,)."""
    half = np.asarray(angle, float)[..., None] / 2
    return np.concatenate([np.cos(half), np.sin(half) * np.asarray(axis, float)], -1)
