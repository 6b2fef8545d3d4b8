"""The same work on Ray: one actor a worker, models loaded once in each, leases of a few episodes, a watchdog outside them.

Actors get paths and return outcomes; frames never travel. An actor that dies or hangs is replaced and its lease is tried again
one episode at a time; an episode that takes two actors with it is reported as failed.
"""

import logging
import os
import time
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.annotate.stage import Stage
from pipeline.annotate.work import Outcome, StageWorker

LEASE = 8
"""Most episodes handed to an actor at once: enough for its prefetch thread to run ahead."""

START_SECONDS = 600.0
EPISODE_SECONDS = 600.0
"""What the watchdog allows a new actor for loading its models, and any actor per episode."""


class Worker:
    """What runs inside an actor."""

    def __init__(self, stage: Stage, dataset: str, dry_run: bool) -> None:
        self._worker = StageWorker(stage, Path(dataset), dry_run)

    def run(self, episodes: list[str]) -> list[Outcome]:
        """Outcomes of a lease."""
        return list(self._worker.run([Path(e) for e in episodes]))


@dataclass(eq=False)
class _Lease:
    actor: Any
    episodes: list[str]
    deadline: float


def run_ray(
    stage: Stage, dataset: Path, episodes: Sequence[Path], dry_run: bool, workers: int, device: str = "auto"
) -> Iterator[Outcome]:
    """As `StageWorker.run`, on `workers` actors; outcomes come in the order in which leases end.

    A stage with models gets gpus / workers of a GPU per actor where the cluster has any. Ray is started (and stopped) here unless
    it runs already; RAY_ADDRESS joins a cluster. Raises AnnotateError as `StageWorker.run`.
    """
    import ray
    from ray.exceptions import RayActorError, RayTaskError

    started = not ray.is_initialized()
    if started:
        os.environ.setdefault("RAY_AUTH_MODE", "disabled")
        local = {} if "RAY_ADDRESS" in os.environ else {"num_cpus": workers, "include_dashboard": False}
        ray.init(log_to_driver=False, logging_level=logging.ERROR, **local)
    gpus = float(ray.cluster_resources().get("GPU", 0)) if stage.uses_models and device != "cpu" else 0.0
    remote: Any = ray.remote(num_cpus=1, num_gpus=min(1.0, gpus / workers))(Worker)
    queue = _leases([str(e) for e in episodes], workers)
    strikes: Counter[str] = Counter()
    running: dict[Any, _Lease] = {}
    idle: list[Any] = []
    count = min(workers, len(queue))
    try:
        while queue or running:
            while queue and (idle or len(running) < count):
                fresh = not idle
                actor = remote.remote(stage, str(Path(dataset).resolve()), dry_run) if fresh else idle.pop()
                lease = queue.popleft()
                allowed = EPISODE_SECONDS * len(lease) + (START_SECONDS if fresh else 0)
                running[actor.run.remote(lease)] = _Lease(actor, lease, time.monotonic() + allowed)
            done, _ = ray.wait(list(running), timeout=1.0)
            now = time.monotonic()
            for ref in [*done, *(r for r, x in running.items() if r not in done and x.deadline < now)]:
                lease = running.pop(ref)
                try:
                    yield from ray.get(ref, timeout=0)
                    idle.append(lease.actor)
                except RayTaskError as error:
                    raise (error.cause if isinstance(error.cause, Exception) else error) from None
                except (RayActorError, TimeoutError) as error:
                    ray.kill(lease.actor)
                    why = "hung" if isinstance(error, TimeoutError) else "died"
                    for episode in lease.episodes:
                        strikes[episode] += len(lease.episodes) == 1
                        if strikes[episode] >= 2:
                            yield Outcome(episode, "failed", "unknown", f"its worker {why} twice; nothing was written")
                        else:
                            queue.append([episode])
    finally:
        for actor in [*idle, *(x.actor for x in running.values())]:
            ray.kill(actor)
        if started:
            ray.shutdown()


def _leases(episodes: list[str], workers: int) -> deque[list[str]]:
    size = max(1, min(LEASE, len(episodes) // (4 * workers)))
    return deque(episodes[i : i + size] for i in range(0, len(episodes), size))
