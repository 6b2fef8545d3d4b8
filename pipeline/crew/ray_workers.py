"""Ray actors that work on jobs: hired, watched and replaced."""

import ctypes
import gc
import os
import signal
import socket
import time
from collections.abc import Callable, Generator, Hashable, Iterator
from dataclasses import dataclass, field
from typing import Any, Literal

import ray
from ray.exceptions import RayError, RayTaskError

from pipeline.data.errors import DominoError, one_line
from pipeline.plugins import load_plugins

from .contract import Check, Crew, CrewError, Done, Make, RunningJob

_START_SECONDS = 300.0
"""What a new worker may take until it is ready: a place on the cluster, a process, imports."""
_STARTS = 3  # starts that may fail in a row while no worker is ready
_POLL_SECONDS = 0.5
_PR_SET_PDEATHSIG = 1


class CrewWorker:
    """What runs inside a Ray actor."""

    def begin(
        self, make: Make[Any, Any], check: Check | None, folder: str
    ) -> "tuple[str, str, dict[str, str]]":
        """Load plugins, check the machine, make the work. Returns ids of node and machine, and
        what `check` found. Raises CrewError.
        """
        # the kernel ends this process with its parent, the raylet, which ends with the driver:
        # Ray itself takes up to a minute, in which a new command may have been started
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if folder:
            os.chdir(folder)
        name = f"{socket.gethostname()} ({ray.util.get_node_ip_address()})"
        try:
            load_plugins()
            facts = dict(check()) if check is not None else {}
        except DominoError as error:
            raise CrewError(f"node {name}: {error}") from None
        self._work: Callable[[Any], Any] = make()
        gc.collect()
        gc.freeze()  # for good, for the reason that `freeze_garbage` gives
        return ray.get_runtime_context().get_node_id(), name, facts

    def start(self, job: Any) -> tuple[bool, Any]:
        """Begin a job. Returns (False, try) at its first step, or (True, result) at its end."""
        work = self._work(job)
        if not isinstance(work, Generator):
            return True, work
        self._steps = work
        return self.go_on()

    def go_on(self) -> tuple[bool, Any]:
        """As `start`, for the next step: the driver knows of each try before it runs."""
        try:
            return False, next(self._steps)
        except StopIteration as end:
            return True, end.value


@dataclass(frozen=True)
class LostJob[J]:
    """A worker lost on a task: see Died; `node_lost` if its machine left the cluster."""

    task: RunningJob[J]
    reason: Literal["worker_died", "worker_hung", "node_lost"]
    trying: Hashable
    seconds: float


@dataclass(eq=False)
class _Hired[J]:
    """The driver's view of a worker: its task (None if idle) and its last sign."""

    actor: Any
    node: str = ""
    task: RunningJob[J] | None = None
    trying: Hashable = None
    since: float = field(default_factory=time.monotonic)
    finished: int = 0


class Workers[J, R]:
    """The workers of one run."""

    def __init__(self, make: Make[J, R], crew: Crew, seconds: float, check: Check | None) -> None:
        self._crew, self._seconds = crew, seconds
        self._begin = make, check, "" if crew.address else os.getcwd()
        actor: Any = ray.remote(CrewWorker)
        self._actor = actor.options(
            num_cpus=1, num_gpus=_share(crew), max_restarts=0, scheduling_strategy="SPREAD"
        )
        self._first: tuple[str, dict[str, str]] | None = None
        self._busy: dict[ray.ObjectRef[Any], _Hired[J]] = {}  # by the answer to come
        self._idle: list[_Hired[J]] = []
        self._failed_starts = 0

    @property
    def at_work(self) -> int:
        """Tasks that workers have."""
        return sum(worker.task is not None for worker in self._busy.values())

    def free(self, waiting: int) -> int:
        """How many of so many waiting tasks can be given now. Starts workers for the others."""
        wanted = min(self._crew.workers, waiting + self.at_work)
        for _ in range(wanted - len(self._busy) - len(self._idle)):
            worker = _Hired[J](self._actor.remote())
            self._busy[worker.actor.begin.remote(*self._begin)] = worker
        return min(waiting, len(self._idle))

    def give(self, task: RunningJob[J]) -> None:
        """Give a task to a worker that is free."""
        worker = self._idle.pop()
        worker.task, worker.trying, worker.since = task, None, time.monotonic()
        self._busy[worker.actor.start.remote(task.job)] = worker

    def ends(self) -> Iterator[Done[J, R] | LostJob[J]]:
        """Wait a moment for tasks to end; then look for workers that hang."""
        ready, _ = ray.wait(list(self._busy), timeout=_POLL_SECONDS)
        for answer in ready:
            worker = self._busy.pop(answer)
            try:
                value = ray.get(answer)
            except RayTaskError as error:
                ray.kill(worker.actor)
                raise (error.cause if isinstance(error.cause, Exception) else error) from error
            except RayError as error:
                yield from self._lose(worker, "worker_died", str(error))
                continue
            if worker.task is None:
                self._welcome(worker, *value)
                self._idle.append(worker)
                continue
            worker.since, (ended, value) = time.monotonic(), value
            if not ended:
                worker.trying = value
                self._busy[worker.actor.go_on.remote()] = worker
                continue
            job, worker.task = worker.task.job, None
            worker.finished += 1
            if worker.finished < self._crew.recycle:
                self._idle.append(worker)
            else:
                ray.kill(worker.actor)
            yield Done(job, value)
        now = time.monotonic()
        for answer, worker in list(self._busy.items()):
            allowed = self._seconds if worker.task else _START_SECONDS
            # its answer may be there, if this process had more to do than to ask for it
            if now - worker.since > allowed and not ray.wait([answer], timeout=0)[0]:
                del self._busy[answer]
                yield from self._lose(worker, "worker_hung", f"not ready after {allowed:.0f} s")

    def dismiss(self) -> None:
        """Kill all workers."""
        for worker in [*self._idle, *self._busy.values()]:
            ray.kill(worker.actor)

    def _welcome(self, worker: _Hired[J], node: str, name: str, facts: dict[str, str]) -> None:
        worker.node, self._failed_starts = node, 0
        first, known = self._first = self._first or (name, facts)
        for fact, own in facts.items():
            if own != known.get(fact):
                ray.kill(worker.actor)
                raise CrewError(
                    f"node {name}: its {fact} is {own}, that of node {first} is {known.get(fact)}:"
                    " have the same on all nodes"
                )

    def _lose(
        self, worker: _Hired[J], reason: Literal["worker_died", "worker_hung"], why: str
    ) -> Iterator[LostJob[J]]:
        ray.kill(worker.actor)
        alive = {node["NodeID"] for node in ray.nodes() if node["Alive"]}
        if not alive:
            raise CrewError(
                "Ray has ended (killed, or no memory left?); rerun the same command to resume"
            )
        if worker.task is not None:
            gone = "node_lost" if worker.node not in alive else reason
            yield LostJob(worker.task, gone, worker.trying, time.monotonic() - worker.since)
            return
        self._failed_starts += 1
        at_work = bool(self._idle) or any(other.node for other in self._busy.values())
        if self._failed_starts >= _STARTS and not at_work:
            raise CrewError(f"no worker starts, the last of {_STARTS} tries: {one_line(why)}")


def _share(crew: Crew) -> float:
    """The GPUs of each worker. Raises CrewError for too few."""
    there = float(ray.cluster_resources().get("GPU", 0))
    if not crew.gpus:
        return min(1.0, there / crew.workers) if crew.share_gpus else 0.0
    # a share lies on one GPU
    per_gpu = int(1 / crew.gpus + 1e-9)
    room = int(there) * per_gpu if crew.gpus <= 1 else int(there / crew.gpus)
    if room < crew.workers:
        has = f"{there:g} GPUs, room for {room} workers" if there else "no GPU"
        raise CrewError(
            f"{crew.workers} workers with {crew.gpus:g} GPUs each: Ray has {has}; fewer --workers"
            " or --gpus-per-worker"
        )
    return crew.gpus
