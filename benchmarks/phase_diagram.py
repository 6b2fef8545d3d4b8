"""When history matters (docs/science/preregistration_phases.md): success of networks of states in
cells of replanning interval, latency and speed. They see one or two frames, and learned from
planned or reactive demonstrations.

python -m benchmarks.phase_diagram run DIR [--rows FILE] [--workers N] [--minutes M] makes what is
missing; the same command resumes
python -m benchmarks.phase_diagram report [--rows FILE] writes tables and figure of phases.md

A row of FILE is one network: {"task", "set", "network", "arm", "inputs", "scenes", "solved"}. The
scenes are seeds by speed. Of each cell, "execute latency alpha", `solved` has a 1 or 0 for each
scene.
"""

import argparse
import itertools
import json
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, as_completed, wait
from dataclasses import asdict, dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from benchmarks.phase_tables import PAGE, Row, report
from pipeline.data.recipe.model import Recipe
from pipeline.evaluate.episode import EpisodeJob, run_episode
from pipeline.evaluate.scenes.case import Case, blind
from pipeline.evaluate.scenes.manifests import Manifests, Runner
from pipeline.evaluate.scoring.clock import parse_clock
from pipeline.run.identity.core import code_version
from training.ladder.demonstrations import make_demonstrations
from training.ladder.network import Settings
from training.ladder.policy import LadderForm
from training.ladder.training import train_missing

ROWS = PAGE.with_name("phases_rows.jsonl")

TASKS = ("click_bell", "move_can_pot", "beat_block_hammer")
ARMS, INPUTS = ("planned", "reactive"), ("position", "two_frames")
SETS, NETWORKS = 3, 5
ALPHAS, EXECUTED, LATENCIES = (0.05, 0.1, 0.2), (1, 4, 8), (0, 100, 300)
LEVEL, DEMONSTRATIONS, SCENES, SCENES_SEED = 1, 100, 10, 7
SETTINGS = Settings(chunk=8, steps=4000)
FIRST_SET = 20
"""The seed of the recipe of set 0: no other study has these demonstrations."""


@dataclass(frozen=True)
class NetworkUnit:
    """One network, tried in all cells of its task."""

    task: str
    set: int
    network: int
    arm: str
    inputs: str


def units() -> Iterator[NetworkUnit]:
    """All networks in the registered order: one network of every task, set and arm before the
    next."""
    for network, task, held in itertools.product(range(NETWORKS), TASKS, range(SETS)):
        for arm, inputs in itertools.product(ARMS, INPUTS):
            yield NetworkUnit(task, held, network, arm, inputs)


@dataclass(frozen=True)
class PhaseStudy:
    """What is made below `root`: demonstrations, networks and scenes, each of them once."""

    root: Path
    physics: str
    demonstrations: int = DEMONSTRATIONS
    each: int = SCENES
    settings: Settings = SETTINGS

    def recipe(self, task: str, held: int, arm: str) -> Recipe:
        """The demonstrations of a set."""
        return Recipe(
            tasks=(task,),
            levels=(LEVEL,),
            alpha=ALPHAS,
            episodes=self.demonstrations,
            seed=FIRST_SET + held,
            expert=arm,  # type: ignore[arg-type]
        )

    def network(self, unit: NetworkUnit, run: Runner) -> Path:
        """The file of a trained network."""
        recipe = self.recipe(unit.task, unit.set, unit.arm)
        folder = self.root / "demonstrations" / self.physics[:12]
        shown = list(make_demonstrations(recipe, folder / f"{recipe.label}-seed{recipe.seed}", run))
        seen = replace(self.settings, inputs=unit.inputs, seed=unit.network)
        return train_missing(shown, seen, self.root / "networks" / unit.task)

    def scenes(self, task: str, run: Runner) -> dict[float, list[Case]]:
        """The scenes of a task, by speed."""
        recipe = self.recipe(task, 0, ARMS[0])
        kept = Manifests(self.root / "manifests", SCENES_SEED, blind(recipe).calm)
        found = kept.admitted(tuple(recipe.cells()), self.each, run)
        return {cell.alpha: cases for cell, cases in found.items()}

    def row(self, unit: NetworkUnit) -> Row:
        """The network of a unit in all cells."""
        path, setup = self.network(unit, _here), blind(self.recipe(unit.task, 0, ARMS[0]))
        scenes, solved = self.scenes(unit.task, _here), dict[str, str]()
        for execute, latency, alpha in itertools.product(EXECUTED, LATENCIES, ALPHAS):
            policy = LadderForm().name(f"ladder:{path}?execute={execute}")
            clock = parse_clock(f"latency:{latency}" if latency else "sim")
            jobs = [EpisodeJob(case, policy, clock, setup=setup) for case in scenes[alpha]]
            cell = f"{execute} {latency} {alpha:g}"
            solved[cell] = "".join(str(int(run_episode(job)["success"])) for job in jobs)
        seeds = {f"{alpha:g}": [case.spec.seed for case in scenes[alpha]] for alpha in ALPHAS}
        return {**asdict(unit), "scenes": seeds, "solved": solved}


def _here(work: Callable[[Any], Any], jobs: Sequence[Any]) -> Iterator[tuple[Any, Any]]:
    return ((job, work(job)) for job in jobs)


def pooled(pool: ProcessPoolExecutor) -> Runner:
    """Jobs are done by the processes of a pool."""

    def run(work: Callable[[Any], Any], jobs: Sequence[Any]) -> Iterator[tuple[Any, Any]]:
        asked = {pool.submit(work, job): job for job in jobs}
        return ((asked[done], done.result()) for done in as_completed(asked))

    return run


def run(root: Path, rows: Path, workers: int, minutes: float) -> None:
    """Make the rows that are missing; units that begin in the last minute are finished."""
    study, until = PhaseStudy(root, code_version()), time.monotonic() + 60 * minutes
    known = [json.loads(line) for line in rows.read_text().splitlines()] if rows.exists() else []
    left = [u for u in units() if not any(asdict(u).items() <= row.items() for row in known)]
    running = dict[Future[Row], NetworkUnit]()
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        for unit in left:
            if time.monotonic() > until:
                break
            # made by all processes, before a network waits for them
            study.scenes(unit.task, pooled(pool))
            study.network(unit, pooled(pool))
            running[pool.submit(study.row, unit)] = unit
            if len(running) >= workers:
                _keep(rows, running, wait(running, return_when=FIRST_COMPLETED).done)
        _keep(rows, running, wait(running).done)


def _keep(rows: Path, running: dict[Future[Row], NetworkUnit], done: set[Future[Row]]) -> None:
    for each in done:
        print(running.pop(each), flush=True)
        with rows.open("a") as file:
            file.write(json.dumps(each.result()) + "\n")


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    verbs = parser.add_subparsers(dest="verb", required=True)
    doing, telling = verbs.add_parser("run"), verbs.add_parser("report")
    doing.add_argument("root", type=Path)
    doing.add_argument("--workers", type=int, default=1, help="processes, 1 or more")
    doing.add_argument(
        "--minutes", type=float, default=float("inf"), help="after these no unit is begun"
    )
    for verb in (doing, telling):
        verb.add_argument("--rows", type=Path, default=ROWS, help="file of JSON lines")
    given = parser.parse_args()
    if given.verb == "run":
        if given.workers < 1:
            parser.error("--workers: 1 or more")
        given.root.mkdir(parents=True, exist_ok=True)
        run(given.root, given.rows, given.workers, given.minutes)
    else:
        report(given.rows)


if __name__ == "__main__":
    main()
