"""Workers, jobs, and the two ways a job ends."""

from collections import Counter
from collections.abc import Callable, Generator, Hashable, Mapping
from dataclasses import dataclass, field
from importlib.util import find_spec
from typing import Any, Literal

from pipeline.data.errors import DominoError
from pipeline.data.process.machine import usable_cores

SINGLE_THREAD = dict.fromkeys(
    (
        *("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"),
        *("LP_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"),
    ),
    "1",
)
"""One thread per worker; workers scale, threads inside one do not (docs/cluster.md)."""

type Steps[R] = Generator[Hashable, None, R]
"""Work in steps: yields which of several tries begins, and returns the result."""

type Make[J, R] = Callable[[], Callable[[J], R | Steps[R]]]
"""Makes the work, once in each worker: models, kernels and planners are kept from job to job."""

type Check = Callable[[], Mapping[str, str]]
"""Checks the machine of a worker; returns what must be the same on all machines, by name. Raises
DominoError."""


class CrewError(DominoError):
    """No worker starts, no cluster answers, or too many workers are lost."""


@dataclass(frozen=True)
class Crew:
    """The workers of a run.

    `executor` is inline (this process) or ray (`workers` processes, each replaced after `recycle`
    jobs). `address` names a running Ray cluster (host:port); without it, Ray is started here, on
    loopback. `gpus` is each worker's share of a GPU; 0 gives each an equal share if `share_gpus`,
    else none. `runtime_env` is Ray's."""

    executor: str = "inline"
    workers: int = 1
    address: str | None = None
    recycle: int = 500
    gpus: float = 0.0
    share_gpus: bool = False
    runtime_env: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not (0 <= self.gpus <= 1 or self.gpus == int(self.gpus) > 1):
            raise CrewError(
                f"{self.gpus:g} GPUs a worker: use a share of one like 0.25, or a whole number"
            )
        if self.runtime_env and self.address is None:
            raise CrewError("a runtime environment is for a cluster: name it with --address")
        if self.executor not in ("inline", "ray") or self.workers < 1:
            raise CrewError(
                f"{self.workers} {self.executor!r} workers: use inline or ray, 1 or more"
            )


@dataclass(frozen=True)
class Done[J, R]:
    """A job that ended, and what the work returned."""

    job: J
    result: R


@dataclass(frozen=True)
class Died[J]:
    """A job that cost two workers on one try; the last that it yielded, and the second worker's
    `seconds`.
    """

    job: J
    reason: Literal["worker_died", "worker_hung"]
    trying: Hashable
    seconds: float


@dataclass(eq=False)
class RunningJob[J]:
    """A job on its way to its end: how many workers were lost on each try of it."""

    job: J
    losses: Counter[Hashable] = field(default_factory=Counter[Hashable])


def result_of[R](work: R | Steps[R]) -> R:
    """The result of work that was called in this process, run to its end if it is in steps."""
    if not isinstance(work, Generator):
        return work
    while True:
        try:
            next(work)
        except StopIteration as end:
            return end.value


def pick_executor(name: str, workers: int | None, jobs: int | None = None) -> tuple[str, int]:
    """The executor and its workers. `auto` is inline for one worker, without Ray, or for at most
    two `jobs`. Raises CrewError without Ray.
    """
    count, has_ray = workers or usable_cores(), find_spec("ray") is not None
    if name == "auto":
        worth = has_ray and (jobs is None or jobs > 2)
        name = "ray" if count > 1 and (worth or workers) else "inline"
    if name == "ray" and not has_ray:
        raise CrewError(
            "several workers need ray: uv pip install 'domino-data[ray]', or use --workers 1"
        )
    return name, 1 if name == "inline" else count
