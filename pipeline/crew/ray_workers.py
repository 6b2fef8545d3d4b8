"""Jobs on Ray workers: hired, watched from outside, replaced when they are lost or have done their share."""

import ctypes
import gc
import os
import select
import signal
import socket
import time
from collections import deque
from collections.abc import Callable, Generator, Hashable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any, Literal

import ray
from ray.exceptions import RayError, RayTaskError, TaskCancelledError

from pipeline.crew.guard import find_children
from pipeline.crew.pool import Check, Died, Done, EngineError, Limit, Make, Pool
from pipeline.crew.ray_session import session
from pipeline.data.errors import DominoError
from pipeline.plugins import Snapshot

_START_SECONDS = 300.0
"""What a new worker may take before it can be given a job: a place on the cluster, a process, imports."""
_STARTS = 3  # workers in a row that may fail to start, while none is at work, before the run is given up
_POLL_SECONDS = 0.5
_GONE_SECONDS = 10.0
_PR_SET_PDEATHSIG = 1
_DAEMONS = ("raylet", "gcs_server")


def run_on_ray[J, R](
    make: Make[J, R], jobs: deque[J], pool: Pool, limit: Limit[J], gpus: bool, check: Check | None
) -> Generator[Done[J, R] | Died[J], None, None]:
    """As `engine.run`, for a pool of Ray workers."""
    with session(pool):
        plugins = Snapshot.taken() if pool.address else Snapshot()  # workers of this machine inherit the directories
        crew = _Crew(make, limit, pool.recycle, _share(pool, gpus), check, plugins)
        with _daemons(pool) as check_daemons:
            try:
                while jobs or crew.at_work:
                    check_daemons()
                    crew.hire(min(pool.workers, len(jobs) + crew.at_work))
                    crew.hand_out(jobs)
                    yield from crew.ends()
            finally:
                crew.dismiss()


def _share(pool: Pool, gpus: bool) -> float:
    """The GPUs of each worker: as the pool says, or an equal share. Raises EngineError if the cluster does not have so many."""
    there = float(ray.cluster_resources().get("GPU", 0))
    if not pool.gpus:
        return min(1.0, there / pool.workers) if gpus else 0.0
    # a share lies on one GPU
    room = int(there) * int(1 / pool.gpus + 1e-9) if pool.gpus <= 1 else int(there / pool.gpus)
    if room < pool.workers:
        has = f"{there:g} GPUs, room for {room} workers" if there else "no GPU"
        wanted = f"{pool.workers} workers with {pool.gpus:g} GPUs each"
        raise EngineError(f"{wanted}: Ray has {has}; fewer --workers or --gpus-per-worker")
    return pool.gpus


@contextmanager
def _daemons(pool: Pool) -> Iterator[Callable[[], None]]:
    """What raises EngineError once the raylet or the control service below this process has ended: calls to Ray wait for minutes
    or forever then. Only where they are this run's: nodes of a cluster may come and go."""
    found = [] if pool.address else [(name, pid) for name in _DAEMONS for pid in find_children(os.getpid(), name)]
    names, poll = {os.pidfd_open(pid): name for name, pid in found}, select.poll()
    for descriptor in names:
        poll.register(descriptor, select.POLLIN)

    def check() -> None:
        for descriptor, _ in poll.poll(0):
            name = names[descriptor]
            raise EngineError(f"Ray's {name} has ended (killed, or no memory left?); rerun the same command to resume")

    try:
        yield check
    finally:
        for descriptor in names:
            os.close(descriptor)


class _Process:
    """What runs inside a Ray actor."""

    def begin(self, make: Callable[[], Callable[[Any], Any]], check: Check | None, plugins: Snapshot) -> "_Place":
        """Load plugins, look at the machine and make the work. Raises EngineError for a machine that cannot do it."""
        # the kernel ends this process with its parent, the raylet, which ends with the driver: even one that hangs or is stopped
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        name = f"{socket.gethostname()} ({ray.util.get_node_ip_address()})"
        try:
            plugins.load()
            facts = dict(check()) if check is not None else {}
        except DominoError as error:
            raise EngineError(f"node {name}: {error}") from None
        self._work = make()
        gc.collect()
        gc.freeze()  # for good, for the reason that pipeline.memory gives
        return _Place(ray.get_runtime_context().get_node_id(), os.getpid(), name, facts)

    def do(self, job: Any) -> Any:
        """Run one job."""
        return self._work(job)


@dataclass(frozen=True)
class _Place:
    """Where a worker is: Ray's id of the node, its process id there, the machine's name, and what was found there."""

    node: str
    pid: int
    name: str
    facts: dict[str, str]


@dataclass(eq=False)
class _Worker[J]:
    """The driver's view of one worker: its actor, its job (None while it starts or waits), and signs of life."""

    actor: Any
    job: J | None = None
    ready: bool = False
    node: str = ""
    finished: int = 0
    process: int | None = None
    """A file descriptor of the process where it runs on this machine: no number that the system could give to another."""
    since: float = field(default_factory=time.monotonic)
    seen: Hashable = None
    look: float = 0.0


class _Crew[J, R]:
    """The workers of one run."""

    def __init__(
        self, make: Make[J, R], limit: Limit[J], recycle: int, gpus: float, check: Check | None, plugins: Snapshot
    ) -> None:
        self._limit, self._recycle, self._begin = limit, recycle, (make, check, plugins)
        self._first: _Place | None = None
        self._actor: Any = ray.remote(num_cpus=1, num_gpus=gpus, max_restarts=0, scheduling_strategy="SPREAD")(_Process)
        self._node = ray.get_runtime_context().get_node_id()
        self._busy: dict[ray.ObjectRef, _Worker[J]] = {}
        self._idle: list[_Worker[J]] = []
        self._failed_starts = 0
        self._leaving: list[int] = []

    @property
    def at_work(self) -> int:
        """Jobs that workers have."""
        return sum(worker.job is not None for worker in self._busy.values())

    def hire(self, wanted: int) -> None:
        """Start workers until there are so many."""
        for _ in range(wanted - len(self._busy) - len(self._idle)):
            worker = _Worker[J](self._actor.remote())
            self._busy[worker.actor.begin.remote(*self._begin)] = worker

    def hand_out(self, jobs: deque[J]) -> None:
        """Give jobs to workers that have none."""
        while jobs and self._idle:
            worker = self._idle.pop()
            worker.job = jobs.popleft()
            worker.since = time.monotonic()
            worker.seen = self._limit.headway(worker.job)
            worker.look = worker.since + self._limit.seconds(worker.job) / 10
            self._busy[worker.actor.do.remote(worker.job)] = worker

    def ends(self) -> Iterator[Done[J, R] | Died[J]]:
        """Wait a moment for jobs to end; then look after those that take long."""
        ready, _ = ray.wait(list(self._busy), timeout=_POLL_SECONDS)
        for ref in ready:
            worker = self._busy.pop(ref)
            try:
                result = ray.get(ref)
            except RayTaskError as error:
                if isinstance(error.cause, TaskCancelledError):  # what Ray makes of a KeyboardInterrupt in the work
                    yield from self._report_loss(worker, "worker_died", str(error))
                    continue
                self._kill(worker)
                raise (error.cause if isinstance(error.cause, Exception) else error) from error
            except RayError as error:
                yield from self._report_loss(worker, "worker_died" if self._there(worker) else "node_lost", str(error))
                continue
            job, worker.job = worker.job, None
            if worker.ready:
                worker.finished += 1
            else:
                self._welcome(worker, result)
            if worker.finished < self._recycle:
                self._idle.append(worker)
            else:
                self._kill(worker)
            if job is not None:
                yield Done(job, result)
        now = time.monotonic()
        for ref in [ref for ref, worker in self._busy.items() if self._hangs(worker, now)]:
            yield from self._report_loss(self._busy.pop(ref), "worker_hung", f"it took more than {_START_SECONDS:.0f} s")

    def dismiss(self) -> None:
        """Kill all workers and wait until those on this machine are gone."""
        for worker in [*self._idle, *self._busy.values()]:
            self._kill(worker)
        deadline = time.monotonic() + _GONE_SECONDS
        while self._leaving and time.monotonic() < deadline:
            self._close_gone(0.1)

    def _close_gone(self, seconds: float) -> None:
        """Forget killed processes that are gone, after waiting at most so long for one."""
        poll = select.poll()
        for process in self._leaving:
            poll.register(process, select.POLLIN)
        for process, _ in poll.poll(1000 * seconds):
            self._leaving.remove(process)
            os.close(process)

    def _welcome(self, worker: _Worker[J], place: _Place) -> None:
        worker.ready, worker.node, self._failed_starts = True, place.node, 0
        if place.node == self._node:
            worker.process = os.pidfd_open(place.pid)
        self._first = first = self._first or place
        for name in sorted(first.facts.keys() | place.facts.keys()):
            one, other = (each.facts.get(name, "none") for each in (first, place))
            if one != other:
                self._kill(worker)
                raise EngineError(
                    f"node {place.name}: its {name} is {other}, that of node {first.name} is {one}: have the same on all nodes"
                )

    def _there(self, worker: _Worker[J]) -> bool:
        """Whether the node of a worker, where it is known, is still part of the cluster."""
        return not worker.node or any(node["Alive"] for node in ray.nodes() if node["NodeID"] == worker.node)

    def _hangs(self, worker: _Worker[J], now: float) -> bool:
        if worker.job is None:
            return now - worker.since > _START_SECONDS
        if now < worker.look:
            return False
        seconds = self._limit.seconds(worker.job)
        worker.look = now + seconds / 10
        seen = self._limit.headway(worker.job)
        if seen != worker.seen:
            worker.seen, worker.since = seen, now
        return now - worker.since > seconds

    def _report_loss(
        self, worker: _Worker[J], reason: Literal["worker_died", "worker_hung", "node_lost"], why: str
    ) -> Iterator[Died[J]]:
        self._kill(worker)
        if worker.job is not None:
            yield Died(worker.job, reason)
            return
        self._failed_starts += 1
        at_work = any(other.ready for other in [*self._idle, *self._busy.values()])
        if self._failed_starts >= _STARTS and not at_work:
            raise EngineError(f"no worker starts, the last of {_STARTS} tries: {' '.join(why.split())}")

    def _kill(self, worker: _Worker[J]) -> None:
        if worker.process is not None:
            with suppress(ProcessLookupError):
                signal.pidfd_send_signal(worker.process, signal.SIGKILL)
            self._leaving.append(worker.process)
            self._close_gone(0)
            worker.process = None
        # on another machine, Ray asks the process to leave and kills it some seconds later
        ray.kill(worker.actor)
