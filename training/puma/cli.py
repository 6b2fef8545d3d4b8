"""The command `puma`: train, evaluate, serve, and check a policy."""

import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.commands.command import Verb, run_app
from training.puma.measure.commands import bench, errors, memory, overfit, replay_check
from training.puma.options import (
    Checkpoint,
    Configuration,
    Datasets,
    Out,
    Quiet,
    Settings,
    configuration,
)

if TYPE_CHECKING:
    from collections.abc import Iterable

    from training.puma.experiments.paper import Command

app = typer.Typer(
    rich_markup_mode=None,
    help="Train and run PUMA, a policy for moving objects.",
    no_args_is_help=True,
    add_completion=False,
)


@app.command(cls=Verb)
def train(
    out: Out,
    config: Configuration = "puma-tiny",
    data: Datasets = None,
    settings: Settings = None,
    quiet: Quiet = False,
) -> None:
    """Train, or resume a training."""
    wanted = configuration(config, settings, data)  # refused before torch is imported
    from training.puma.processes.parallel import part
    from training.puma.train import train as run

    result = run(wanted, out, quiet=quiet)
    part()
    print(f"{result.checkpoint}")


@app.command(
    name="eval",
    cls=Verb,
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True},
)
def evaluate(context: typer.Context, folder: Checkpoint) -> None:
    """Evaluate in closed loop: `domino-data evaluate` with this policy and its setup; takes all of
    its options."""
    from pipeline.cli import app as domino
    from training.puma import checkpoint

    held = checkpoint.load(folder)
    words = ["evaluate", "--policy", str(held.path / "policy.py")]
    if not held.preprocessing.setup:
        words += ["--cameras", ",".join(held.preprocessing.cameras)]
    elif not {"--like", "--manifest", "--recipe"} & {
        word.partition("=")[0] for word in context.args
    }:
        words += ["--like", str(held.path)]
    if held.config.model.oracle:
        words.append("--in-process")  # it is shown the simulation
    words += context.args
    if isinstance(code := domino(words, prog_name="puma eval", standalone_mode=False), int):
        raise typer.Exit(code)


@app.command(cls=Verb)
def serve(
    folder: Checkpoint,
    host: Annotated[
        str, typer.Option(help="Addresses other than loopback need a token in DOMINO_POLICY_TOKEN.")
    ] = "127.0.0.1",
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port to listen on; 0 selects a free one.")
    ] = 8765,
    clients: Annotated[
        int, typer.Option(min=1, max=1000, help="Number of simultaneous clients.")
    ] = 1,
    compiled: Annotated[
        bool, typer.Option("--compile", help="Compile the network; the first answers are slower.")
    ] = False,
    batch: Annotated[
        int,
        typer.Option(min=1, max=256, help="Rows of every pass of the network; its label names it."),
    ] = 1,
    batch_wait: Annotated[
        float, typer.Option(min=0, max=60_000, help="A pass waits this many ms for more questions.")
    ] = 5.0,
) -> None:
    """Serve a policy to `domino-data evaluate --policy ws://HOST:PORT`."""
    from pipeline.evaluate.serving.address import token
    from pipeline.evaluate.serving.server import ServerAddress, ServerLimits
    from training.puma.serve import Together, label, server

    def print_address(port: int) -> None:
        print(
            f"serving {label(folder, batch)} on ws://{f'[{host}]' if ':' in host else host}:{port}",
            flush=True,
        )

    together = Together(batch, batch_wait / 1000)
    address, tell = ServerAddress(host, port, token()), lambda line: print(line, file=sys.stderr)
    server(folder, address, ServerLimits(clients), compiled, together, tell).run(print_address)


for measure in (overfit, replay_check, errors, bench, memory):
    app.command(cls=Verb)(measure)


@app.command(cls=Verb)
def paper(
    name: Annotated[str, typer.Argument(help="An experiment of the paper, such as ablation.")],
    out: Out,
    settings: Settings = None,
    tiny: Annotated[bool, typer.Option("--tiny", help="One task, one step: a trial.")] = False,
) -> None:
    """Run an experiment of the DOMINO paper: build, annotate, export, train each of its networks,
    and print their results beside the published rows."""
    from training.puma.experiments.paper import FULL, TINY, commands

    _run(commands(name, out, TINY if tiny else FULL, settings or ()))


@app.command(cls=Verb)
def table(
    name: Annotated[str, typer.Argument(help="An experiment of the paper, such as main.")],
    out: Annotated[Path, typer.Argument(help="The --out of a domino-data evaluate.")],
) -> None:
    """Print an evaluation beside the published rows of an experiment of the DOMINO paper."""
    from training.puma.experiments.table import printed

    print("\n".join(printed(name, out)))


@app.command(cls=Verb)
def many(
    out: Out,
    tasks: Annotated[
        str, typer.Option(help="Tasks; those of manifests/puma-many.yaml by default.")
    ] = "",
    levels: Annotated[str, typer.Option(help="Levels; those of the recipe by default.")] = "",
    demonstrations: Annotated[
        int, typer.Option(min=0, max=10_000, help="Of a task, level and look; 0: the recipe's.")
    ] = 0,
    networks: Annotated[int, typer.Option(min=1, max=100, help="Networks, one a seed.")] = 3,
    scenes: Annotated[int, typer.Option(min=1, max=10_000, help="Of a task and level.")] = 50,
    settings: Settings = None,
    workers: Annotated[
        int, typer.Option(min=0, max=1024, help="Of builds and evaluations; 0: cores.")
    ] = 0,
    stages: Annotated[
        str, typer.Option(help="Stages that are done: data, networks, evaluation.")
    ] = "data,networks,evaluation",
    conditions: Annotated[
        str, typer.Option(help="Conditions of the evaluation; all by default.")
    ] = "",
    twins: Annotated[
        str, typer.Option(help="Networks beside the first: no-history, planned, static.")
    ] = "",
    plan: Annotated[
        bool, typer.Option("--plan", help="Estimate core-hours by stage, and do nothing.")
    ] = False,
) -> None:
    """Train one policy for many tasks and evaluate it: data, networks, evaluations, table. Rerun
    the same command to resume."""
    from pipeline.data.parsing import ParseError, whole
    from pipeline.run.names import check_known
    from pipeline.tasks import TASKS
    from pipeline.tasks.contract import expand_tasks
    from training.puma import many_table
    from training.puma.many import CONDITIONS, SPENT, STAGES, TWINS, Many, commands, estimate

    full = Many.full(out)
    named = expand_tasks(tasks.split(",")) if tasks else full.tasks
    check_known("task", named, TASKS, "--tasks: ")
    try:
        chosen = tuple(whole(part, 0, 3) for part in levels.split(",")) if levels else full.levels
    except ParseError as error:
        raise typer.BadParameter(f"--levels {levels}: {error}") from error
    wanted = Many(
        out,
        named,
        chosen,
        demonstrations or full.demonstrations,
        networks,
        scenes,
        tuple(settings or ()),
        ("--workers", str(workers)) if workers else (),
        _chosen("stages", stages, STAGES),
        _chosen("conditions", conditions, tuple(CONDITIONS)),
        _chosen("twins", twins, tuple(TWINS)) if twins else (),
    )
    costs = estimate(wanted)
    for name, count, hours in costs:
        print(f"{name:12} {count:8} {SPENT[name][2]:14} {hours:6.1f} core-hours")
    print(f"{'together':36} {sum(hours for *_, hours in costs):6.1f} core-hours")
    if plan:
        return
    _run(commands(wanted))
    text = many_table.table(wanted)
    if twins:
        text += f"\n\n{many_table.twins(wanted)}"
    (out / "table.md").write_text(text + "\n")
    lines = [json.dumps(row) + "\n" for row in many_table.results(wanted)]
    (out / "rows.jsonl").write_text("".join(lines))
    print(text)


def _chosen(option: str, text: str, known: tuple[str, ...]) -> tuple[str, ...]:
    """Some of the `known` names, divided by commas; all for no text."""
    names = tuple(dict.fromkeys(text.split(","))) if text else known
    if wrong := [name for name in names if name not in known]:
        raise typer.BadParameter(f"--{option} {wrong[0]!r}: choose {', '.join(known)}")
    return names


def _run(commands: "Iterable[Command]") -> None:
    """Run commands one after the other, and exit if one fails."""
    from pipeline.cli import app as domino

    programs = {"domino-data": domino, "puma": app}
    for command in commands:
        print(f"+ {command}", flush=True)
        program = programs[command.program]
        code = program(list(command.words), prog_name=command.program, standalone_mode=False)
        if isinstance(code, int) and code not in command.good:
            raise typer.Exit(code)


@app.command(cls=Verb)
def configs() -> None:
    """List the configurations that come with the package."""
    from training.puma.reading import CONFIGS, names

    for name in names():
        first = (CONFIGS / f"{name}.yaml").read_text().splitlines()[0]
        print(f"{name:20} {first.removeprefix('# ')}")


def main() -> None:
    """Entry point."""
    # one thread a process unless asked otherwise: workers and evaluators share the cores
    os.environ.setdefault("TOKENIZERS_PARALLELISM", "false")
    run_app(app, "puma")


if __name__ == "__main__":
    main()
