"""An evaluation, whole: admit seeds, run the episodes that are missing, summarise."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.data.recipe import Cell
from pipeline.data.rules import STRICT, Rules
from pipeline.evaluate.case import Case
from pipeline.evaluate.clock import Clock
from pipeline.evaluate.episode import EpisodeJob, run_episode
from pipeline.evaluate.policy import PolicyName
from pipeline.evaluate.protocol import Manifests, Runner
from pipeline.evaluate.results import Results, text_key
from pipeline.evaluate.summary import Row, over_tasks, summarise


@dataclass(frozen=True)
class Evaluation:
    """What is to be evaluated. `code` names the version of this program: results of another version do not count."""

    cells: tuple[Cell, ...]
    policy: PolicyName
    clock: Clock
    episodes: int = 100
    seed: int = 0
    cameras: tuple[str, ...] = ()
    split: str = "unseen"
    compounding: bool = False
    depth: bool = False
    code: str = ""
    rules: Rules = STRICT


@dataclass(frozen=True)
class Outcome:
    """What an evaluation found: a row of results for every cell, means over tasks, episodes run by this call, file of all rows."""

    cells: list[Row]
    means: list[Row]
    run: int
    path: Path

    def to_dict(self) -> dict[str, Any]:
        """For a program to read."""
        return {"results": self.cells, "means": self.means, "run": self.run, "episodes": str(self.path)}


def evaluate(
    wanted: Evaluation, out: Path, run: Runner, manifests: Path | None = None, tell: Callable[[str], None] = lambda text: None
) -> Outcome:
    """Evaluate, or go on evaluating, into OUT/episodes.jsonl.

    Manifests of seeds are read from and kept in `manifests`, by default OUT/manifests. Raises ProtocolError, ResultsError and what
    the policy raises; rows that are finished stay.
    """
    results, seeds = Results(out / "episodes.jsonl"), Manifests(manifests or out / "manifests", wanted.seed, rules=wanted.rules)
    tell("admitting seeds")
    admitted = seeds.admitted(wanted.cells, wanted.episodes, run)
    jobs = {text_key(job.key): job for cases in admitted.values() for job in (_job(wanted, case) for case in cases)}
    missing = [job for key, job in jobs.items() if key not in results]
    if missing:
        for done, (job, row) in enumerate(run(episodes, missing), 1):
            results.append(text_key(job.key), row)
            tell(f"{done} of {len(missing)} episodes")
    rows = results.of(jobs)
    return Outcome(summarise(rows), over_tasks(rows), len(missing), results.path)


def _job(wanted: Evaluation, case: Case) -> EpisodeJob:
    options = {"cameras": wanted.cameras, "split": wanted.split, "compounding": wanted.compounding, "depth": wanted.depth}
    return EpisodeJob(case, wanted.policy, wanted.clock, wanted.code, **options)


def episodes() -> Callable[[EpisodeJob], Row]:
    """`run_episode`, as workers are given it."""
    return run_episode


def inline(make: Callable[[], Callable[[Any], Any]], jobs: Sequence[Any]) -> Iterator[tuple[Any, Any]]:
    """The runner of one process."""
    work = make()
    return ((job, work(job)) for job in jobs)
