"""The engine's contract: the workers, the ways in which a job ends, the limits of a worker, and whose fault a lost one is."""

import os
from collections import Counter
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from pipeline.data.errors import DominoError

EXECUTORS = ("auto", "inline", "ray")

_THREAD_LIMITS = "OMP_NUM_THREADS OPENBLAS_NUM_THREADS MKL_NUM_THREADS NUMBA_NUM_THREADS LP_NUM_THREADS OPENCV_FOR_THREADS_NUM"
SINGLE_THREAD = dict.fromkeys(_THREAD_LIMITS.split(), "1")
"""One thread per worker; workers scale, threads inside one do not (docs/cluster.md)."""

type Make[J, R] = Callable[[], Callable[[J], R]]
"""Makes the work, once in every worker: what is heavy to load (models, kernels, planners) is kept from job to job."""

type Check = Callable[[], Mapping[str, str]]
"""Looks at the machine of a worker, before the work is made there: what must be the same on all of them, by name. Raises
DominoError for a machine that cannot do the work."""


class EngineError(DominoError):
    """The engine cannot continue: no worker can be started, no cluster answers, or worker after worker is lost. One line."""


@dataclass(frozen=True)
class Pool:
    """The workers of a run.

    `executor` is inline (this process) or ray (`workers` processes, each replaced after `recycle` jobs). `address` names a running
    Ray cluster (host:port); without it Ray is started for this run, on this machine, on loopback. `gpus` is each worker's share of
    a GPU, e.g. 0.25 where four share one; 0 leaves it to the work. `runtime_env` is Ray's description of what processes on a
    cluster need (environment variables, interpreter, ...).
    """

    executor: str = "inline"
    workers: int = 1
    address: str | None = None
    recycle: int = 500
    gpus: float = 0.0
    runtime_env: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not (0 <= self.gpus <= 1 or self.gpus == int(self.gpus) > 1):
            raise EngineError(f"{self.gpus:g} GPUs a worker: use a share of one like 0.25, or a whole number")
        if self.runtime_env and self.address is None:
            raise EngineError("a runtime environment is for the machines of a cluster: name it with --address")
        if self.executor not in EXECUTORS[1:] or self.workers < 1:
            raise EngineError(f"executor {self.executor!r} with {self.workers} workers: use inline or ray and at least 1 worker")


@dataclass(frozen=True)
class Limit[J]:
    """When a worker counts as hung: `seconds(job)` have passed since its job began or `headway(job)` last changed."""

    seconds: Callable[[J], float]
    headway: Callable[[J], Hashable] = lambda _: None


@dataclass(frozen=True)
class Done[J, R]:
    """A job that ended, and what the work returned."""

    job: J
    result: R


@dataclass(frozen=True)
class Died[J]:
    """A job whose worker was lost.

    The process ended or was killed (`worker_died`), hung until the watchdog killed it (`worker_hung`), or its machine left the
    cluster (`node_lost`), which is no fault of the job.
    """

    job: J
    reason: Literal["worker_died", "worker_hung", "node_lost"]


def pick_executor(name: str, workers: int | None) -> tuple[str, int]:
    """The executor to use and its number of workers: `auto` is inline for one worker and Ray for more."""
    count = workers or len(os.sched_getaffinity(0))
    if name == "auto":
        name = "inline" if count == 1 else "ray"
    return name, 1 if name == "inline" else count


class Strikes:
    """A try that takes two workers with it is out; `most` different jobs in a row that lose their worker end the run."""

    def __init__(self, workers: int) -> None:
        self._most = 4 + 4 * workers
        self._count: Counter[Hashable] = Counter()
        self._in_a_row: set[Hashable] = set()

    def count_loss(self, job: Hashable, trying: Hashable = None) -> bool:
        """Count a worker lost on a job, while `trying` one of several ways to do it; true for the second loss on the same try.

        Raises EngineError if no job ends at all: recording them all as failed would blame the wrong thing.
        """
        self._in_a_row.add(job)
        if len(self._in_a_row) >= self._most:
            lost = len(self._in_a_row)
            raise EngineError(
                f"{lost} jobs in a row lost their worker, none ended: is there memory for so many workers (--workers)?"
            )
        self._count[job, trying] += 1
        return self._count[job, trying] >= 2

    def clear(self) -> None:
        """Note that a job ended well."""
        self._in_a_row.clear()
