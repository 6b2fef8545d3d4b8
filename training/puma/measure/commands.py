"""The commands of `puma` that measure: a configuration, or a trained policy."""

import json
from typing import Annotated

import typer

from training.puma.options import (
    AsJson,
    Checkpoint,
    Configuration,
    Datasets,
    Settings,
    configuration,
)


def overfit(
    config: Configuration = "puma-tiny",
    data: Datasets = None,
    settings: Settings = None,
    steps: Annotated[int, typer.Option(min=1, max=10**9, help="Steps on the one batch.")] = 300,
    as_json: AsJson = False,
) -> None:
    """Train on one batch until its loss is near zero; exit code 1 if it does not fall to a
    tenth."""
    wanted = configuration(config, settings, data)
    from training.puma.measure.checks import overfit as run

    found = run(wanted, steps)
    text = (
        f"loss {found['first']:.4f} -> {found['last']:.4f} in {steps} steps on one batch of"
        f" {found['samples']}"
    )
    print(json.dumps(found) if as_json else text)
    if found["last"] > 0.1 * found["first"]:
        raise typer.Exit(1)


def replay_check(
    folder: Checkpoint,
    data: Datasets = None,
    episodes: Annotated[int, typer.Option(min=1, max=1_000_000, help="Episodes to replay.")] = 10,
    as_json: AsJson = False,
) -> None:
    """Compare a policy on recorded episodes: its answers with the commands, its inputs with those
    of training."""
    from training.puma.measure.checks import replay_check as run

    found = run(folder, data, episodes)
    lines = [f"{name:16} {error:.4f}" for name, error in found["errors"].items()]
    lines.append(
        f"mean absolute error over {found['answers']} answers in {found['episodes']} episodes:"
        f" {found['error']:.4f}"
    )
    lines.append(f"inputs that differ from training: {found['different']}")
    print(json.dumps(found) if as_json else "\n".join(lines))
    if found["different"]:
        raise typer.Exit(1)


def errors(folder: Checkpoint, as_json: AsJson = False) -> None:
    """Measure errors on validation episodes by dataset: those of the finder (px) by sentence, and
    those of actions before and after the touch (rad)."""
    from training.puma.measure.checks import errors as run

    found = run(folder)
    if as_json:
        return print(json.dumps(found))
    for name, values in found.items():
        print(f"{name:40} " + "  ".join(f"{key} {value:.3g}" for key, value in values.items()))


def bench(
    config: Configuration = "puma-tiny",
    settings: Settings = None,
    compiled: Annotated[
        bool, typer.Option("--compile", help="Also measure answers of the compiled network.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Measure training, data loading and inference on generated data."""
    wanted = configuration(config, settings, None)
    from training.puma.measure.bench import report

    found = report(wanted, compiled)
    print(
        json.dumps(found)
        if as_json
        else "\n".join(f"{name:40} {value}" for name, value in found.items())
    )


def memory(
    config: Configuration = "puma-4b",
    settings: Settings = None,
    cards: Annotated[str, typer.Option(help="Numbers of cards.")] = "1,2,4,8",
    as_json: AsJson = False,
) -> None:
    """Calculate the memory that training needs on each card, and list the cards that have it."""
    from pipeline.data.parsing import ParseError, whole

    wanted = configuration(config, settings, None)
    try:
        counts = [whole(part, 1, 100_000) for part in cards.split(",")]
    except ParseError as error:
        raise typer.BadParameter(f"--cards {cards}: {error}") from error
    from training.puma.processes.memory import needs, table

    found = needs(wanted, counts)
    print(json.dumps([vars(need) for need in found]) if as_json else table(found))
