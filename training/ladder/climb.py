"""The whole ladder: demonstrations, networks, their evaluation, and a table."""

import hashlib
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.data.atomic import write_atomic
from pipeline.data.dataset import Dataset
from pipeline.data.disk import check_directory
from pipeline.data.recipe.model import Recipe
from pipeline.data.setup import Setup
from pipeline.evaluate.adapters.lerobot import LerobotForm
from pipeline.evaluate.case import blind
from pipeline.evaluate.clock import Clock
from pipeline.evaluate.evaluate import Evaluation
from pipeline.evaluate.evaluate import evaluate as run_evaluation
from pipeline.evaluate.policy import PolicyName
from pipeline.evaluate.protocol import Runner
from pipeline.report.card.ladder import RESULTS, Result
from training.ladder.demonstrations import Demonstration, make_demonstrations, read_demonstrations
from training.ladder.image_rungs import IMAGE_RUNGS, ImageTraining, image_policy, lerobot_dataset
from training.ladder.network import Settings
from training.ladder.policy import LadderForm
from training.ladder.samples import LadderError, samples, weights
from training.ladder.tables import Tried, summary, write_results
from training.ladder.training import train


@dataclass(frozen=True)
class Ladder:
    """What is trained and tried.

    `recipe` names tasks, robot, levels, alpha and demonstrations a cell (`episodes`); one network learns a task at all its levels.
    `executed` are pairs of a chunk's length and how much of it is executed; networks of states of one length are trained once.
    Inputs that are IMAGE_RUNGS are trained by LeRobot on the images of `data`, for `image_steps` steps and with the words
    `train_options` besides. Networks of states also learn from the datasets `corrections`, whose frames are drawn `weight` times
    as often as others. `episodes` are admitted scenes a cell. `code` names the version of this program, `physics` that of what
    makes demonstrations: those of another version are made again.
    """

    recipe: Recipe
    inputs: tuple[str, ...]
    executed: tuple[tuple[int, int], ...]
    seeds: int
    episodes: int
    settings: Settings = field(default_factory=Settings)
    data: Path | None = None
    code: str = ""
    physics: str = ""
    image_steps: int = 20_000
    train_options: tuple[str, ...] = ()
    corrections: tuple[Path, ...] = ()
    weight: float = 1.0


@dataclass(frozen=True)
class Network:
    """What was trained: its inputs, actions in a chunk, how many of them are executed, and demonstrations."""

    inputs: str
    chunk: int
    execute: int
    demonstrations: int


def climb(ladder: Ladder, out: Path, run: Runner, tell: Callable[[str], None] = lambda text: None) -> list[Result]:
    """Make what is missing below OUT (demonstrations, networks, OUT/episodes.jsonl) and summarise it in OUT/ladder.json.

    The summary is updated after every network. Raises LadderError if a task has no demonstrations, OSError for a file in place of
    OUT, and what evaluation and datasets raise.
    """
    check_directory(out)
    rows = list[Tried]()
    states = [kind for kind in ladder.inputs if kind not in IMAGE_RUNGS]
    for task in ladder.recipe.tasks:
        if states:
            tell(f"{task}: demonstrations")
            shown = list(_demonstrations(ladder, task, out, run))
            for dataset in ladder.corrections:
                shown += read_demonstrations(dataset, ladder.recipe.model_copy(update={"tasks": (task,)}).cells())
            if len(shown) == 0:
                raise LadderError(f"{task}: there is no demonstration to learn from; give --data a dataset that has some")
            lengths = sorted({chunk for chunk, _ in ladder.executed})
            source = ladder.recipe if ladder.data is None else Dataset(ladder.data).setup()
            made_for = {key: getattr(source, key) for key in ("fps", "layout")}
            for seed, kind, chunk in itertools.product(range(ladder.seeds), states, lengths):
                settings = replace(ladder.settings, inputs=kind, chunk=chunk, seed=seed, **made_for)
                tell(f"{task}: {kind}, chunk {chunk}, seed {seed}")
                path = train_missing(shown, settings, out / "networks" / task, ladder.weight)
                for execute in (e for c, e in ladder.executed if c == chunk):
                    network = Network(kind, chunk, execute, len(shown))
                    wanted = evaluation(ladder, task, LadderForm().name(f"ladder:{path}?execute={execute}"), blind(ladder.recipe))
                    rows += [_score(network, cell) for cell in run_evaluation(wanted, out, run).cells]
                write_results(out / RESULTS, summary(rows), ladder.code)
        for found in _image_rows(ladder, task, out, run, tell):
            rows += found
            write_results(out / RESULTS, summary(rows), ladder.code)
    return summary(rows)


def _image_rows(ladder: Ladder, task: str, out: Path, run: Runner, tell: Callable[[str], None]) -> Iterator[list[Tried]]:
    """Rows of the rungs that see images, one list a trained policy."""
    kinds = [kind for kind in ladder.inputs if kind in IMAGE_RUNGS]
    if not kinds:
        return
    if ladder.data is None:
        raise LadderError(f"{kinds[0]} learns from images: give --data a dataset that has them")
    recipe = Dataset(ladder.data).recipe()
    cells = ladder.recipe.model_copy(update={"tasks": (task,)}).cells()
    dataset, count = lerobot_dataset(ladder.data, [cell for cell in cells if cell in recipe.cells()], out / "lerobot")
    setup = recipe.setup.override({"textures": "unseen"})
    for seed, kind, (chunk, execute) in itertools.product(range(ladder.seeds), kinds, ladder.executed):
        tell(f"{task}: {kind}, chunk {chunk}, seed {seed}")
        training = ImageTraining(kind, chunk, execute, seed, ladder.image_steps, ladder.train_options)
        path = image_policy(training, dataset, out / "networks" / task)
        wanted = evaluation(ladder, task, LerobotForm().name(f"lerobot:{path}?resize=true"), setup)
        network = Network(kind, chunk, execute, count)
        yield [_score(network, cell) for cell in run_evaluation(wanted, out, run).cells]


def _demonstrations(ladder: Ladder, task: str, out: Path, run: Runner) -> Iterator[Demonstration]:
    recipe = ladder.recipe.model_copy(update={"tasks": (task,)})
    if ladder.data is None:
        return make_demonstrations(recipe, out / "demonstrations" / (ladder.physics[:12] or "any") / recipe.label, run)
    return read_demonstrations(ladder.data, recipe.cells())


def train_missing(shown: Sequence[Demonstration], settings: Settings, where: Path, weight: float = 1.0) -> Path:
    """The file of a trained network, trained if it is not there: its name carries a hash of settings, demonstrations and the weight
    of corrections."""
    digest, drawn = hashlib.sha256(repr(asdict(settings)).encode()), weights(shown, settings, weight)
    if any(d.corrected for d in shown):
        digest.update(repr([weight, *(d.corrected for d in shown)]).encode())
    for d in shown:
        for values in (d.joints, d.actions, d.poses, d.points):
            digest.update(np.ascontiguousarray(values).tobytes())
    path = where / f"{settings.inputs}_c{settings.chunk}_s{settings.seed}_{digest.hexdigest()[:8]}.npz"
    if not path.exists():
        write_atomic(path, train(*samples(shown, settings), settings, drawn).to_bytes())
    return path


def evaluation(ladder: Ladder, task: str, policy: PolicyName, setup: Setup) -> Evaluation:
    cells = tuple(ladder.recipe.model_copy(update={"tasks": (task,)}).cells())
    return Evaluation(cells, policy, Clock("sim", "sim"), ladder.episodes, setup=setup, code=ladder.code)


def _score(network: Network, cell: Mapping[str, Any]) -> Tried:
    """The score of a network, from the evaluation of a cell (evaluate/results.py)."""
    return {
        "task": cell["task"],
        "embodiment": cell["embodiment"],
        "alpha": cell["alpha"],
        "level": cell["level"],
        "inputs": network.inputs,
        "chunk": network.chunk,
        "execute": network.execute,
        "demonstrations": network.demonstrations,
        "solved": len(cell["solved_seeds"]),
        "episodes": cell["episodes"],
        "solved_seeds": cell["solved_seeds"],
    }
