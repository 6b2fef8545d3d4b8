"""What a policy is. Latency is charged for `inferences`, the runs of its network, if it counts
them."""

import hashlib
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.data.actions import Representation
from pipeline.data.errors import DominoError
from pipeline.data.setup import DEFAULT, Setup
from pipeline.evaluate.actions import ActionError, check_action
from pipeline.evaluate.lines import line_of
from pipeline.evaluate.scenes.case import Case
from pipeline.evaluate.scenes.trial import CameraViews, Eyes, Trial
from pipeline.poses import Floats, Floats32, Pixels

LONGEST_CHUNK = 1000


class PolicyError(DominoError):
    """It cannot be loaded, or refuses an episode."""


class NoAnswer(PolicyError):
    """An error, a lost connection, or a time limit."""


@dataclass(frozen=True)
class Start:
    """What a policy receives before an episode. Nothing in it identifies the scene.

    `image_sizes` are (height, width) by camera; `seed` is for its own draws. The robot's base is
    `lift` m, to 0.1 mm, higher above the table than usual."""

    instruction: str
    embodiment: str
    action_names: tuple[str, ...]
    fps: int
    cameras: tuple[str, ...]
    seed: int
    image_sizes: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    setup: Setup = DEFAULT
    lift: float = 0.0
    state_names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "state_names", self.state_names or self.action_names)


def policy_seed(instruction: str, embodiment: str) -> int:
    """63 bits for a policy's own draws: a hash of what it receives anyway."""
    digest = hashlib.sha256(f"{embodiment}\n{instruction}".encode()).digest()
    return int.from_bytes(digest[:8], "little") >> 1


@dataclass(frozen=True, eq=False)
class Observation:
    """Measured joints (A,), grippers 0-1; `time` in s; images (H,W,3) uint8 RGB by camera.

    With sensors depth (H,W) uint16 in mm (0 = nothing), bodies (H,W) uint8, points (N,6): x y z
    (m, world), r g b (0-1). On an `async` clock `committed` (N,A) are executed meanwhile."""

    joints: Floats
    instruction: str
    time: float
    images: Mapping[str, Pixels] = field(default_factory=dict)
    depth: Mapping[str, NDArray[np.uint16]] = field(default_factory=dict)
    segmentation: Mapping[str, Pixels] = field(default_factory=dict)
    pointcloud: Floats32 | None = None
    committed: Floats | None = None


def observe(
    trial: Trial, eyes: Eyes | None, words: str, committed: Floats | None = None
) -> Observation:
    seen = eyes.look(trial.recorder) if eyes else CameraViews()
    joints = trial.recorder.state.copy()
    return Observation(joints, words, trial.time, **vars(seen), committed=committed)


class Policy(Protocol):
    def reset(self, start: Start) -> None: ...

    def act(self, observation: Observation) -> ArrayLike:
        """The next action (A,) or chunk (H,A): drive targets at the end of each control period."""
        ...


class BatchPolicy(ABC):
    """A policy that answers many episodes together. The memory of an episode is what `begin`
    returns; its `inferences` counts the runs of the network."""

    _episode: Any = None

    @abstractmethod
    def begin(self, start: Start) -> Any: ...

    @abstractmethod
    def act_together(self, asked: Sequence[tuple[Any, Observation]]) -> Sequence[ArrayLike]:
        """An answer for each pair of a memory and its observation. After an error each question
        is asked again alone: change a memory after everything that can fail."""

    def reset(self, start: Start) -> None:
        self._episode = self.begin(start)

    def act(self, observation: Observation) -> ArrayLike:
        return self.act_together([(self._episode, observation)])[0]

    @property
    def inferences(self) -> int | None:
        return getattr(self._episode, "inferences", None)


@runtime_checkable
class SeesTruth(Protocol):
    """Is shown the simulation itself."""

    def see(self, trial: Trial, case: Case) -> None: ...


@dataclass(frozen=True)
class PolicyName:
    """How a policy was asked for. `label` names it in results; `probe` hashes its answer to a
    fixed question; `process` is "evaluator", "own" or "server"."""

    text: str
    label: str
    probe: str = ""
    process: str = "own"
    prints: Path | None = None
    actions: Representation | None = None


def attribute(policy: object, name: str) -> Any:
    with foreign(f"its attribute {name} cannot be read"):
        return getattr(policy, name, None)


@contextmanager
def foreign(
    what: str = "",
    kind: type[PolicyError] = PolicyError,
    known: tuple[type[BaseException], ...] = (),
) -> Iterator[None]:
    """Turns any error but `known` ones into one line of a kind, which begins with `what`."""
    try:
        yield
    except (KeyboardInterrupt, *known):
        raise
    except BaseException as error:
        line = str(error) if isinstance(error, DominoError) else line_of(error)
        raise kind(f"{what}: {line}" if what else line) from error


def count_inferences(policy: object) -> int | None:
    """How often the network has run; None if the policy does not count in whole numbers."""
    count: object = attribute(policy, "inferences")
    if isinstance(count, bool) or not isinstance(count, int | np.integer):
        return None
    return int(count) if count >= 0 else None


def chunk_of(answer: ArrayLike, length: int) -> Floats:
    """An answer as (H,A). Raises ActionError."""
    try:
        values = np.asarray(answer)
    except (TypeError, ValueError) as error:
        raise ActionError(f"the policy's answer is no array: {line_of(error)}") from error
    if values.dtype.kind == "b" or not np.can_cast(values.dtype, np.float64, "same_kind"):
        raise ActionError(f"the policy's answer is of the type {values.dtype}: give floats")
    rows = values[None] if values.ndim == 1 else values
    if rows.ndim != 2 or not 1 <= len(rows) <= LONGEST_CHUNK:
        give = f"give ({length},) or (H, {length})"
        raise ActionError(f"the policy's answer has the shape {values.shape}; {give}")
    return np.stack([check_action(row, length) for row in rows])
