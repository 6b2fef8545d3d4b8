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
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from benchmarks.phase_tables import PAGE, Row, report
from pipeline.crew.contract import Crew
from pipeline.data.recipe.model import Recipe
from pipeline.data.setup.rules import Expert
from pipeline.evaluate.episode import EpisodeJob, run_episode
from pipeline.evaluate.scenes.case import Case, blind
from pipeline.evaluate.scenes.manifests import Manifests, Runner, inline
from pipeline.evaluate.scoring.clock import parse_clock
from pipeline.run.evaluation import runner
from pipeline.run.identity.core import code_version
from training.ladder.demonstrations import Demonstration, make_demonstrations
from training.ladder.network import Settings
from training.ladder.policy import LadderForm
from training.ladder.training import train_missing

ROWS = PAGE.with_name("phases_rows.jsonl")

TASKS = ("click_bell", "move_can_pot", "beat_block_hammer")
EXPERTS: tuple[Expert, ...] = ("planned", "reactive")
INPUTS = ("position", "two_frames")
SETS, NETWORKS = 3, 5
ALPHAS, EXECUTED, LATENCIES = (0.05, 0.1, 0.2), (1, 4, 8), (0, 100, 300)
LEVEL, DEMONSTRATIONS, SCENES, SCENES_SEED = 1, 100, 10, 7
SETTINGS = Settings(chunk=8, steps=4000)
FIRST_SET = 20
"""The seed of the recipe of set 0: no other study has these demonstrations."""

SECONDS = 7200.0
"""What a network, trained and tried in all cells, may take before its worker counts as hung."""


@dataclass(frozen=True)
class NetworkUnit:
    """One network, tried in all cells of its task."""

    task: str
    set: int
    network: int
    arm: Expert
    inputs: str


def units() -> Iterator[NetworkUnit]:
    """All networks in the registered order: one network of every task, set and arm before the
    next."""
    for network, task, held in itertools.product(range(NETWORKS), TASKS, range(SETS)):
        for arm, inputs in itertools.product(EXPERTS, INPUTS):
            yield NetworkUnit(task, held, network, arm, inputs)


@dataclass(frozen=True)
class PhaseStudy:
    """What is made below `root`: demonstrations, networks and scenes, each of them once."""

    root: Path
    physics: str
    demonstrations: int = DEMONSTRATIONS
    each: int = SCENES
    settings: Settings = SETTINGS

    def recipe(self, task: str, held: int, arm: Expert) -> Recipe:
        """What the demonstrations of a set are made of."""
        return Recipe(
            tasks=(task,),
            levels=(LEVEL,),
            alpha=ALPHAS,
            episodes=self.demonstrations,
            seed=FIRST_SET + held,
            expert=arm,
        )

    def shown(self, task: str, held: int, arm: Expert, run: Runner) -> list[Demonstration]:
        """The demonstrations of a set."""
        recipe = self.recipe(task, held, arm)
        folder = self.root / "demonstrations" / self.physics[:12]
        return [*make_demonstrations(recipe, folder / f"{recipe.label}-seed{recipe.seed}", run)]

    def network(self, unit: NetworkUnit) -> Path:
        """The file of a trained network."""
        shown = self.shown(unit.task, unit.set, unit.arm, inline)
        seen = replace(self.settings, inputs=unit.inputs, seed=unit.network)
        return train_missing(shown, seen, self.root / "networks" / unit.task)

    def scenes(self, task: str, run: Runner) -> dict[float, list[Case]]:
        """The scenes of a task, by speed."""
        recipe = self.recipe(task, 0, EXPERTS[0])
        kept = Manifests(self.root / "manifests", SCENES_SEED, blind(recipe).calm)
        found = kept.admitted(tuple(recipe.cells()), self.each, run)
        return {cell.alpha: cases for cell, cases in found.items()}

    def row(self, unit: NetworkUnit) -> Row:
        """The network of a unit in all cells."""
        path, setup = self.network(unit), blind(self.recipe(unit.task, 0, EXPERTS[0]))
        scenes, solved = self.scenes(unit.task, inline), dict[str, str]()
        for execute, latency, alpha in itertools.product(EXECUTED, LATENCIES, ALPHAS):
            policy = LadderForm().name(f"ladder:{path}?execute={execute}")
            clock = parse_clock(f"latency:{latency}" if latency else "sim")
            jobs = [EpisodeJob(case, policy, clock, setup=setup) for case in scenes[alpha]]
            cell = f"{execute} {latency} {alpha:g}"
            solved[cell] = "".join(str(int(run_episode(job)["success"])) for job in jobs)
        seeds = {f"{alpha:g}": [case.spec.seed for case in scenes[alpha]] for alpha in ALPHAS}
        return {**asdict(unit), "scenes": seeds, "solved": solved}


def run(study: PhaseStudy, rows: Path, workers: int, minutes: float) -> None:
    """Make the rows that are missing, all arms of a network and set together; after `minutes` no
    others are begun."""
    each = runner(Crew("inline" if workers == 1 else "ray", workers), SECONDS)
    until = time.monotonic() + 60 * minutes
    known = [json.loads(line) for line in rows.read_text().splitlines()] if rows.exists() else []
    left = (u for u in units() if not any(asdict(u).items() <= row.items() for row in known))
    for (_, task, held), arms in itertools.groupby(left, lambda u: (u.network, u.task, u.set)):
        if time.monotonic() > until:
            break
        # made by all workers, before networks wait for them
        study.scenes(task, each)
        for expert in EXPERTS:
            study.shown(task, held, expert, each)
        for unit, row in each(study.row, [*arms]):
            with rows.open("a") as file:
                file.write(json.dumps(row) + "\n")
            print(unit, flush=True)


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
        "--minutes", type=float, default=float("inf"), help="after these no network is begun"
    )
    for verb in (doing, telling):
        verb.add_argument("--rows", type=Path, default=ROWS, help="file of JSON lines")
    given = parser.parse_args()
    if given.verb == "run":
        if given.workers < 1:
            parser.error("--workers: 1 or more")
        given.root.mkdir(parents=True, exist_ok=True)
        study = PhaseStudy(given.root, code_version())
        run(study, given.rows, given.workers, given.minutes)
    else:
        report(given.rows)


if __name__ == "__main__":
    main()
