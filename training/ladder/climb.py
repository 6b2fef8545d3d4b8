"""The whole ladder: demonstrations, networks, their evaluation, and a table."""

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pipeline.data.dataset import Dataset
from pipeline.data.errors import check_directory
from pipeline.data.recipe.model import Recipe
from pipeline.data.setup import Setup
from pipeline.data.setup.rules import Corrections
from pipeline.evaluate.evaluate import Evaluation
from pipeline.evaluate.evaluate import evaluate as run_evaluation
from pipeline.evaluate.policies.lerobot import LerobotForm
from pipeline.evaluate.policies.policy import PolicyName
from pipeline.evaluate.scenes.case import blind
from pipeline.evaluate.scenes.manifests import Runner
from pipeline.evaluate.scoring.clock import Clock
from training.ladder.demonstrations import Demonstration, make_demonstrations, read_demonstrations
from training.ladder.image_rungs import IMAGE_RUNGS, ImageTraining, image_policy, lerobot_dataset
from training.ladder.lerobot_states import LEROBOT_STATES, WORDS, keep_settings, state_dataset
from training.ladder.network import Settings
from training.ladder.policy import LadderForm
from training.ladder.samples import LadderError
from training.ladder.tables import RESULTS, LadderResult, Tried, summary, write_results
from training.ladder.training import train_missing


@dataclass(frozen=True)
class Ladder:
    """What is trained and tried.

    `recipe` names tasks, robot, levels, alpha and demonstrations a cell (`episodes`); one network
    learns a task at all its levels. `executed` are pairs of a chunk's length and how much of it is
    executed; networks of states of one length are trained once. They learn every representation of
    `actions` (network.ACTIONS), those of LeRobot joints alone. Inputs that are IMAGE_RUNGS are
    trained by LeRobot on the images of `data`, for `image_steps` steps and with the words
    `train_options` besides. Networks of states also learn from the datasets `corrections`, whose
    frames are drawn `weight` times as often as others. `rounds` is how often the networks are
    corrected and trained again. `episodes` are admitted scenes a cell. `code` names the version of
    this program, `physics` that of what makes demonstrations: those of another version are made
    again.
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
    rounds: int = 0
    actions: tuple[str, ...] = ("joints-relative",)


@dataclass(frozen=True)
class Training:
    """What was trained: inputs, actions in a chunk, how many of them are executed, demonstrations,
    rounds of corrections, and what an action is."""

    inputs: str
    chunk: int
    execute: int
    demonstrations: int
    round: int = 0
    actions: str = "joints-relative"


def climb(
    ladder: Ladder, out: Path, run: Runner, tell: Callable[[str], None] = lambda text: None
) -> list[LadderResult]:
    """Make what is missing below OUT (demonstrations, networks, OUT/episodes.jsonl) and summarise
    it in OUT/ladder.json.

    The summary is updated after every network. Raises LadderError if a task has no demonstrations,
    OSError for a file in place of OUT, and what evaluation and datasets raise.
    """
    check_directory(out)
    rows = list[Tried]()
    for task in ladder.recipe.tasks:
        for found in itertools.chain(
            _state_rows(ladder, task, out, run, tell), _image_rows(ladder, task, out, run, tell)
        ):
            rows += found
            write_results(out / RESULTS, summary(rows), ladder.code)
    return summary(rows)


def _state_rows(
    ladder: Ladder, task: str, out: Path, run: Runner, tell: Callable[[str], None]
) -> Iterator[list[Tried]]:
    """Rows of the rungs that see states, one list a network, one round after the other.

    Every rung and chunk has corrections of its own: those of its network of seed 0.
    """
    kinds = [kind for kind in ladder.inputs if kind not in IMAGE_RUNGS]
    if not kinds:
        return
    tell(f"{task}: demonstrations")
    recipe = ladder.recipe.model_copy(update={"tasks": (task,)})
    shown = _demonstrations(ladder, recipe, out, run)
    learned = {
        (kind, pair, actions): shown
        for kind, pair in itertools.product(kinds, ladder.executed)
        for actions in (ladder.actions if kind not in LEROBOT_STATES else ("joints",))
    }
    source = recipe if ladder.data is None else Dataset(ladder.data).setup()
    made_for = {key: getattr(source, key) for key in ("fps", "layout")}
    for number in range(ladder.rounds + 1):
        first = dict[tuple[str, tuple[int, int], str], PolicyName]()
        for seed, ((kind, (chunk, execute), actions), shown) in itertools.product(
            range(ladder.seeds), learned.items()
        ):
            tell(
                f"{task}: {kind}, chunk {chunk}, {actions}, seed {seed}"
                + f", round {number}" * (ladder.rounds > 0)
            )
            settings = replace(
                ladder.settings, inputs=kind, chunk=chunk, seed=seed, actions=actions, **made_for
            )
            where = out / "networks" / task
            if kind in LEROBOT_STATES:
                policy = LadderForm().name(
                    f"ladder:{_train_lerobot(ladder, shown, settings, execute, where)}"
                )
            else:
                policy = LadderForm().name(
                    f"ladder:{train_missing(shown, settings, where, ladder.weight)}?execute={execute}"  # noqa: E501
                )
            first.setdefault((kind, (chunk, execute), actions), policy)
            network = Training(kind, chunk, execute, len(shown), number, actions)
            wanted = evaluation(ladder, task, policy, blind(ladder.recipe))
            yield [_score(network, cell) for cell in run_evaluation(wanted, out, run).cells]
        if number < ladder.rounds:
            tell(f"{task}: corrections, round {number + 1}")
            for key, policy in first.items():
                corrections = _make(ladder, _correcting(recipe, policy, number + 1), out, run)
                if not corrections:
                    failed = f"{task}: the expert finished no episode that {policy.label} began"
                    raise LadderError(
                        f"{failed}; name fewer --rounds than {number + 1}, or more --demonstrations"
                    )
                learned[key] = [*learned[key], *corrections]


def _train_lerobot(
    ladder: Ladder, shown: Sequence[Demonstration], settings: Settings, execute: int, where: Path
) -> Path:
    """The directory of a policy of LeRobot on states, trained if it is not there.

    It learns from demonstrations as an export has them: without disturbed copies, all frames drawn
    alike."""
    kind, seen = LEROBOT_STATES[settings.inputs], replace(settings, inputs="velocity", copies=0)
    dataset = state_dataset(shown, seen, where.parent.parent / "lerobot")
    words = (*WORDS, *ladder.train_options)
    path = image_policy(
        ImageTraining(kind, settings.chunk, execute, settings.seed, ladder.image_steps, words),
        dataset,
        where,
    )
    keep_settings(seen, path)
    return path


def _image_rows(
    ladder: Ladder, task: str, out: Path, run: Runner, tell: Callable[[str], None]
) -> Iterator[list[Tried]]:
    """Rows of the rungs that see images, one list a trained policy."""
    kinds = [kind for kind in ladder.inputs if kind in IMAGE_RUNGS]
    if not kinds:
        return
    if ladder.data is None:
        raise LadderError(f"{kinds[0]} learns from images: give --data a dataset that has them")
    recipe = Dataset(ladder.data).recipe()
    cells = ladder.recipe.model_copy(update={"tasks": (task,)}).cells()
    dataset, count = lerobot_dataset(
        ladder.data, [cell for cell in cells if cell in recipe.cells()], out / "lerobot"
    )
    setup = recipe.setup.override({"textures": "unseen"})
    for seed, kind, (chunk, execute) in itertools.product(
        range(ladder.seeds), kinds, ladder.executed
    ):
        tell(f"{task}: {kind}, chunk {chunk}, seed {seed}")
        training = ImageTraining(
            kind, chunk, execute, seed, ladder.image_steps, ladder.train_options
        )
        path = image_policy(training, dataset, out / "networks" / task)
        wanted = evaluation(ladder, task, LerobotForm().name(f"lerobot:{path}?resize=true"), setup)
        network = Training(kind, chunk, execute, count, actions="joints")
        yield [_score(network, cell) for cell in run_evaluation(wanted, out, run).cells]


def _demonstrations(ladder: Ladder, recipe: Recipe, out: Path, run: Runner) -> list[Demonstration]:
    """What networks of states learn from before the first round. Raises LadderError if there is
    nothing."""
    source = recipe if ladder.data is None else Dataset(ladder.data).recipe()
    corrections = [
        demonstration
        for root in dict.fromkeys(ladder.corrections)
        for demonstration in _corrections(root, recipe, source)
    ]
    shown = (
        _make(ladder, recipe, out, run)
        if ladder.data is None
        else list(read_demonstrations(ladder.data, recipe.cells()))
    )
    shown += corrections
    if not shown:
        raise LadderError(
            f"{recipe.tasks[0]}: there is no demonstration to learn from; give --data a dataset"
            " that has some"
        )
    return shown


def _corrections(root: Path, recipe: Recipe, source: Recipe) -> list[Demonstration]:
    """The corrections that a dataset holds of a recipe's cells. Raises LadderError if there are
    none, or if their physics or frame rate is not that of `source`, the recipe of the
    demonstrations."""
    held, where = Dataset(root).recipe(), f"--corrections {root}"
    if not held.corrections:
        raise LadderError(
            f"{where}: holds no corrections; give it as --data, or make some with `build"
            " --corrections`"
        )
    if held.physics != source.physics:
        raise LadderError(
            f"{where}: was made with {held.physics.label}, the demonstrations with"
            f" {source.physics.label}"
        )
    found = list(read_demonstrations(root, recipe.cells()))
    if not found:
        raise LadderError(
            f"{where}: holds no episode of {recipe.tasks[0]} with this robot, levels and alpha"
        )
    return found


def _make(ladder: Ladder, recipe: Recipe, out: Path, run: Runner) -> list[Demonstration]:
    """The demonstrations of a recipe; they are kept by version of the program, label and seed."""
    name = recipe.label + f"-seed{recipe.seed}" * (recipe.seed != 0)
    return list(
        make_demonstrations(
            recipe, out / "demonstrations" / (ladder.physics[:12] or "any") / name, run
        )
    )


def _correcting(recipe: Recipe, policy: PolicyName, number: int) -> Recipe:
    """The recipe of the corrections of a policy in round `number`, from 1: as many of each cell as
    there are demonstrations, in the scenes of the seed plus `number`."""
    corrections = Corrections(policy=policy.text, label=policy.label)
    return recipe.model_copy(update={"seed": recipe.seed + number, "corrections": corrections})


def evaluation(ladder: Ladder, task: str, policy: PolicyName, setup: Setup) -> Evaluation:
    cells = tuple(ladder.recipe.model_copy(update={"tasks": (task,)}).cells())
    return Evaluation(
        cells, policy, Clock("sim", "sim"), ladder.episodes, setup=setup, code=ladder.code
    )


def _score(network: Training, cell: Mapping[str, Any]) -> Tried:
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
        "round": network.round,
        "actions": network.actions,
        "solved": len(cell["solved_seeds"]),
        "episodes": cell["episodes"],
        "solved_seeds": cell["solved_seeds"],
    }
