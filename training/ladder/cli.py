"""ladder: train small networks on states and try them in closed loop."""

import shlex
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer
from tqdm import tqdm

from pipeline.commands.common import (
    Address,
    AsJson,
    Executor,
    Quiet,
    UsageError,
    Workers,
    crew_of,
    print_result,
    resumable,
    split_list,
)
from pipeline.commands.options import CELLS, SETUP, Given, recipe_options
from pipeline.data.parsing import whole

TASKS = ("adjust_bottle", "move_can_pot", "grab_roller", "shake_bottle")


@recipe_options(*CELLS, *SETUP, tasks=",".join(TASKS), levels="0,1,2,3")
def ladder(
    given: Given,
    demonstrations: Annotated[
        int,
        typer.Option(
            min=1,
            max=1_000_000,
            help="Demonstrations, and corrections in a round, of a task and level.",
        ),
    ] = 50,
    data: Annotated[
        Path | None, typer.Option(help="Learn from the episodes of this dataset instead.")
    ] = None,
    corrections: Annotated[
        str,
        typer.Option(
            help=(
                "Networks of states also learn from these datasets, made by `build --corrections`;"
                " comma-separated."
            )
        ),
    ] = "",
    corrections_weight: Annotated[
        float,
        typer.Option(
            min=0.01, max=100, help="Weight of a frame of the corrections relative to other frames."
        ),
    ] = 1.0,
    rounds: Annotated[
        int,
        typer.Option(
            min=0,
            max=100,
            help=(
                "How often the reactive expert corrects networks of states, which then learn again."
            ),
        ),
    ] = 0,
    rungs: Annotated[
        str,
        typer.Option(
            help=(
                "Inputs. Poses of the bodies: position, velocity, two_frames, and by lerobot-train"
                " act_velocity, "
                "diffusion_velocity. Images of --data, by lerobot-train: act, diffusion."
            )
        ),
    ] = "position,velocity,two_frames",
    chunks: Annotated[
        str, typer.Option(help="LENGTH:EXECUTED pairs: actions in a chunk, and those executed.")
    ] = "8:4,40:20",
    actions: Annotated[
        str,
        typer.Option(
            help=(
                "What networks of states answer with: joints-relative, joints, ee, ee-relative;"
                " comma-separated."
            )
        ),
    ] = "joints-relative",
    seeds: Annotated[
        int, typer.Option(min=1, max=1000, help="Number of networks of each kind.")
    ] = 3,
    steps: Annotated[
        int, typer.Option(min=1, max=10**9, help="Steps of training, of 256 frames each.")
    ] = 5000,
    image_steps: Annotated[
        int, typer.Option(min=1, max=10**9, help="Steps of lerobot-train.")
    ] = 20_000,
    train_options: Annotated[
        str,
        typer.Option(help="Further arguments of lerobot-train, such as '--policy.device=cuda'."),
    ] = "",
    back: Annotated[
        int, typer.Option(min=1, max=1000, help="Number of frames by which two_frames looks back.")
    ] = 1,
    episodes: Annotated[
        int, typer.Option(min=1, max=1_000_000, help="Admitted scenes per task and level.")
    ] = 20,
    executor: Executor = "auto",
    workers: Workers = None,
    address: Address = None,
    out: Annotated[
        Path, typer.Option(help="Directory of all results; rerun the same command to resume.")
    ] = Path("OUT"),
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Compare state networks with and without velocity on moving targets of levels 0-3; they train
    in minutes."""
    from pipeline.data.keys import digest
    from pipeline.run.evaluation import evaluation_version, runner
    from pipeline.run.identity.core import code_version, policy_version
    from training.ladder.climb import Ladder, climb
    from training.ladder.features import INPUTS
    from training.ladder.image_rungs import IMAGE_RUNGS
    from training.ladder.lerobot_states import LEROBOT_STATES
    from training.ladder.network import ACTIONS, Settings
    from training.ladder.tables import table

    every = (*INPUTS, *LEROBOT_STATES, *IMAGE_RUNGS)
    kinds = tuple(split_list(rungs) or ())
    if not kinds:
        raise UsageError(f"--rungs {rungs!r} names nothing: choose from {', '.join(every)}")
    if unknown := [name for name in kinds if name not in every]:
        raise UsageError(f"--rungs {unknown[0]!r} is unknown: choose from {', '.join(every)}")
    words = tuple(split_list(actions) or ())
    if unknown := [word for word in words if word not in ACTIONS] or [""] * (not words):
        raise UsageError(f"--actions {unknown[0]!r}: choose from {', '.join(ACTIONS)}")
    if rounds and not set(kinds) & set(INPUTS):
        raise UsageError(
            f"--rounds {rounds} corrects networks of states: name one of {', '.join(INPUTS)} in"
            " --rungs"
        )
    if corrections and not set(kinds) & {*INPUTS, *LEROBOT_STATES}:
        raise UsageError(
            "--corrections teaches networks of states: name one of"
            f" {', '.join((*INPUTS, *LEROBOT_STATES))} in --rungs"
        )
    if corrections_weight != 1 and (
        not (corrections or rounds or data) or not set(kinds) & set(INPUTS)
    ):
        raise UsageError(
            f"--corrections-weight needs --corrections or --rounds, and one of {', '.join(INPUTS)}"
            " in --rungs"
        )
    if train_options and not set(kinds) - set(INPUTS):
        raise UsageError(
            "--train-options are for lerobot-train: name one of"
            f" {', '.join((*LEROBOT_STATES, *IMAGE_RUNGS))} in --rungs"
        )
    if data is None and (seeing := [name for name in kinds if name in IMAGE_RUNGS]):
        raise UsageError(
            f"--rungs {seeing[0]} learns from images: give --data a dataset that has them"
        )
    if data is not None and not given.from_file:
        given = replace(given, like=data)
    recipe = given.recipe(tasks=TASKS, levels=[0, 1, 2, 3])
    recipe = recipe.override({"episodes": demonstrations, "total": None, "floor": None})
    settings = Settings(steps=steps, back=back)
    wanted = Ladder(
        recipe, kinds, _pairs(chunks), seeds, episodes, settings, data, evaluation_version()
    )
    wanted = replace(wanted, image_steps=image_steps, train_options=_words(train_options))
    wanted = replace(
        wanted,
        corrections=tuple(map(Path, split_list(corrections) or ())),
        weight=corrections_weight,
        rounds=rounds,
        actions=words,
    )
    wanted = replace(wanted, physics=digest([code_version(), policy_version()]))
    try:
        import torch  # noqa: F401
    except ImportError as error:
        raise UsageError(
            "the ladder trains with torch: install the extra train (uv pip install"
            " 'domino-data[train]')"
        ) from error
    with resumable(out), tqdm(disable=quiet, bar_format="{desc} [{elapsed}]") as bar:
        rows = climb(
            wanted, out, runner(crew_of(executor, workers, address)), bar.set_description_str
        )
    print_result({"results": rows}, as_json, table(rows))


def _words(text: str) -> tuple[str, ...]:
    """A command line as words."""
    try:
        return tuple(shlex.split(text))
    except ValueError as error:
        raise UsageError(
            f"--train-options {text!r}: {str(error).lower()}; close the quotation"
        ) from error


def _pairs(text: str) -> tuple[tuple[int, int], ...]:
    """ "8:4,40:20" as pairs of numbers."""
    try:
        pairs = tuple(
            (whole(a), whole(b)) for a, b in (pair.split(":") for pair in text.split(","))
        )
    except ValueError:
        pairs = ()
    if not pairs or not all(1 <= execute <= length <= 1000 for length, execute in pairs):
        raise UsageError(
            f"--chunks {text!r}: write LENGTH:EXECUTED,LENGTH:EXECUTED with 1 <= EXECUTED <= LENGTH"
            " <= 1000"
        )
    return pairs
