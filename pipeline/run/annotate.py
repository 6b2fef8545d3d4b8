"""`domino-data annotate`."""

import time
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

from tqdm import tqdm

from pipeline.annotate.options import AnnotateOptions
from pipeline.annotate.selection import DEFAULT_STAGES, Absent, build_stages, select_episodes
from pipeline.annotate.stage import Redraw, Stage, directory_of
from pipeline.annotate.store import write_stage
from pipeline.annotate.work import StageOutcome, StageWorker
from pipeline.crew.contract import Crew, Done, Steps
from pipeline.crew.loop import run
from pipeline.crew.ray_session import session
from pipeline.data.atomic import exclusive, sweep

LEASE = 8  # most episodes handed to a worker at once: enough for its prefetch thread to run ahead
EPISODE_SECONDS = 1200.0
"""What a worker may take until the next annotation is written, loading its models included."""

type Lease = tuple[str, ...]  # a job: episodes, relative to the dataset's


def annotate(
    dataset: Path,
    stages: Sequence[str] = DEFAULT_STAGES,
    *,
    options: AnnotateOptions | None = None,
    where: str | None = None,
    redraw: Redraw | None = None,
    crew: Crew | None = None,
    device: str = "auto",
    dry_run: bool = False,
    progress: bool = False,
) -> dict[str, Any]:
    """Bring `stages` of a dataset up to date, or report what a `dry_run` would do.

    `redraw` draws episodes again for simulator truth that they lack. Returns the number of
    "episodes", and in "stages" counts of them for each stage and camera; "invalid" were replaced.
    Raises AnnotateError, Busy, CrewError.
    """
    dataset, crew = Path(dataset), crew or Crew()
    chosen = select_episodes(dataset, where)
    options, redraw = options or AnnotateOptions(), redraw or Redraw()
    built = build_stages(options, stages, redraw, device, dry_run)
    reports = list[dict[str, Any]]()
    folder, writes = dataset / "annotations", bool(chosen) and not dry_run
    if writes:
        folder.mkdir(exist_ok=True)
    # not the dataset's lock, so that a build can run meanwhile
    with exclusive(folder) if writes else nullcontext(), session(crew):
        for stage in built:
            start = time.perf_counter()
            if isinstance(stage, Absent):
                done = [StageOutcome(str(e), "computed", "unknown", stage.reason) for e in chosen]
                reports.append(_summary(stage, f"{stage.name}@?", done, 0.0, dry_run))
                continue
            directory = directory_of(stage)
            if writes:
                parameters = {"stage": stage.name, "version": stage.version}
                parameters |= {"parameters": stage.parameters()}
                write_stage(dataset, directory, parameters)
                sweep(folder / directory)
            work = outcomes(stage, dataset, chosen, crew, device, dry_run)
            with closing(work) as found:
                bar = tqdm(
                    found, total=len(chosen), desc=directory, unit="episode", disable=not progress
                )
                done = sorted(bar, key=lambda o: o.episode)
            if dry_run and stage.name == "features" and "masks" in stages:
                ready = {"action": "computed", "reason": "after its masks"}
                done = [replace(o, **ready) if o.action == "waiting" else o for o in done]
            seconds = time.perf_counter() - start
            reports.append(_summary(stage, directory, done, seconds, dry_run))
    return {"dataset": str(dataset), "episodes": len(chosen), "dry_run": dry_run, "stages": reports}


def outcomes(
    stage: Stage, dataset: Path, episodes: Sequence[Path], crew: Crew, device: str, dry_run: bool
) -> Generator[StageOutcome, None, None]:
    """One stage of each episode, as leases end. An episode that costs two workers failed."""
    if crew.executor == "inline":
        # in one go, so that the prefetch thread never stops between leases
        yield from StageWorker(stage, dataset, dry_run).run(episodes)
        return
    dataset = dataset.resolve()
    jobs = deque(leases([str(e) for e in episodes], crew.workers))
    crew = replace(crew, share_gpus=stage.uses_models and device != "cpu")

    def make() -> Callable[[Lease], Steps[list[StageOutcome]]]:
        worker = StageWorker(stage, dataset, dry_run)
        return lambda lease: _annotate(worker, lease)

    with closing(run(make, jobs, crew, EPISODE_SECONDS)) as ends:
        for end in ends:
            if isinstance(end, Done):
                yield from end.result
                continue
            number = end.trying if isinstance(end.trying, int) else 0
            why = f"its worker {end.reason.removeprefix('worker_')} twice; nothing was written"
            yield StageOutcome(end.job[number], "failed", "unknown", why)
            if rest := end.job[:number] + end.job[number + 1 :]:
                jobs.append(rest)


def _annotate(worker: StageWorker, lease: Lease) -> Steps[list[StageOutcome]]:
    """A lease's outcomes; yields each episode's number first."""
    done = list[StageOutcome]()
    yield 0
    for outcome in worker.run([Path(e) for e in lease]):
        done.append(outcome)
        yield len(done)
    return done


def leases(episodes: Sequence[str], workers: int) -> Iterator[Lease]:
    """Episodes in order, in leases small enough that every worker gets several."""
    size = max(1, min(LEASE, len(episodes) // (4 * workers)))
    return (tuple(episodes[i : i + size]) for i in range(0, len(episodes), size))


def _summary(
    stage: Stage | Absent,
    directory: str,
    outcomes: list[StageOutcome],
    seconds: float,
    dry_run: bool,
) -> dict[str, Any]:
    count = Counter(o.action for o in outcomes)
    computed = [o for o in outcomes if o.action == "computed"]
    failed = [o for o in outcomes if o.action in ("failed", "waiting")]
    summary: dict[str, Any] = {
        "name": stage.name,
        "camera": stage.camera,
        "directory": directory,
        "computed": len(computed),
        "reused": count["reused"],
        "invalid": sum(o.state in ("stale", "corrupt") for o in computed),
        "failed": count["failed"],
        "waiting": count["waiting"],
        "frames": sum(o.frames for o in computed),
        "seconds": round(seconds, 3),
        "hit_rate": count["reused"] / len(outcomes) if outcomes else 1.0,
        "problems": [f"{o.episode}: {o.reason}" for o in failed],
    }
    if dry_run:
        summary["plan"] = [
            {"episode": o.episode, "action": o.action, "state": o.state, "reason": o.reason}
            for o in outcomes
            if o.action != "reused"
        ]
    return summary
