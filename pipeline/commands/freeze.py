"""freeze: the scenes of an evaluation as one file."""

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
from pipeline.commands.options import CELLS, Given, recipe_options
from pipeline.data.setup import IMAGES, Setup


@recipe_options(
    *CELLS,
    "assets",
    *(key for key in Setup.model_fields if key not in (*IMAGES, "events")),
    tasks="all",
    levels="0,1,2,3",
)
def freeze(
    given: Given,
    out: Annotated[Path, typer.Option(help="The benchmark: NAME.jsonl.xz.")],
    scenes: Annotated[int, typer.Option(min=1, max=100_000, help="Scenes of each cell.")] = 50,
    seed: Annotated[
        int,
        typer.Option(min=0, max=10**12, help="Scenes are drawn from seed 100000 * (1 + SEED)."),
    ] = 0,
    part: Annotated[
        list[str] | None,
        typer.Option(
            help="A part by name and its tasks, NAME=TASK,TASK; several times for several.",
            metavar="PART",
        ),
    ] = None,
    manifests: Annotated[
        Path | None,
        typer.Option(help="Directory of admitted seeds; a longer freeze continues there."),
    ] = None,
    executor: Executor = "auto",
    workers: Workers = None,
    address: Address = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Draw scenes that the expert solves, and write them as data into one file, which `evaluate
    --benchmark` takes."""
    from pipeline.data.atomic import write_atomic
    from pipeline.evaluate.scenes.benchmark import SUFFIX, pack, read_benchmark, unpack_benchmark
    from pipeline.evaluate.scenes.case import blind
    from pipeline.evaluate.scenes.manifests import Manifests
    from pipeline.run.evaluation import runner
    from pipeline.run.provenance import machine
    from pipeline.tasks.contract import expand_tasks

    if not out.name.endswith(SUFFIX):
        raise UsageError(f"--out {out}: name it NAME{SUFFIX}")
    name = out.name.removesuffix(SUFFIX)
    recipe = given.recipe(levels=[0, 1, 2, 3])
    if recipe.events:
        raise UsageError("the recipe has events: scenes are frozen without, leave the key out")
    setup = blind(recipe).physics
    parts = dict[str, tuple[str, ...]]()
    for text in part or ():
        label, _, tasks = text.partition("=")
        parts[label] = expand_tasks(split_list(tasks) or [])
        if unknown := [task for task in parts[label] if task not in recipe.tasks]:
            raise UsageError(f"--part {text}: {unknown[0]} is not among the tasks")
    cells = recipe.cells()
    there = read_benchmark(str(out)) if out.exists() else None
    other = UsageError(f"--out {out}: is another benchmark: give another name, or remove the file")
    if there is not None and (there.head.scenes, [each.cell() for each in there.head.cells]) != (
        scenes,
        [*cells],
    ):
        raise other
    seeds = Manifests(manifests or out.with_name(f"{name}-seeds"), seed, setup)
    with resumable(seeds.root), tqdm(disable=quiet, bar_format="{desc} [{elapsed}]") as bar:
        bar.set_description_str("admitting seeds")
        run = runner(crew_of(executor, workers, address))
        cases = seeds.admitted(cells, scenes, run)
        bar.set_description_str("freezing")
        data = pack(name, cases, setup, parts, {"packages": machine()["packages"]})
        made = unpack_benchmark(data, str(out))
        if there is not None and there.sha256 != made.sha256:
            raise other
        write_atomic(out, data)
    values = {"benchmark": name, "sha256": made.sha256, "scenes": len(made.lines)}
    text = f"{out}: {len(made.lines)} scenes, {len(data)} bytes, sha256 {made.sha256}"
    print_result(values | {"bytes": len(data), "path": str(out)}, as_json, text)
