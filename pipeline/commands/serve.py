"""serve-policy and freeze."""

import sys
from functools import partial
from pathlib import Path
from typing import Annotated

from pipeline.data.setup import IMAGES, Setup

from .common import (
    Address,
    AsJson,
    Executor,
    Quiet,
    UsageError,
    Workers,
    argument,
    crew_of,
    number,
    option,
    print_result,
    resumable,
    split_list,
)
from .options import CELLS, Given, recipe_options

BatchWait = Annotated[
    float | None,
    number(
        0,
        60_000,
        "Load a BatchPolicy once for all clients; a batch waits this many ms for more questions.",
    ),
]


def serve_policy(
    policy: Annotated[
        str, argument("FILE.py with make_policy(), random, or lerobot:PATH and the other kinds.")
    ],
    host: Annotated[
        str,
        option("Address to listen on; others than loopback need a token in DOMINO_POLICY_TOKEN."),
    ] = "127.0.0.1",
    port: Annotated[int, number(0, 65535, "Port to listen on; 0 selects a free one.")] = 8765,
    clients: Annotated[
        int, number(1, 1000, "Number of simultaneous clients, each with its own policy.")
    ] = 1,
    batch_wait: BatchWait = None,
    embodiment: Annotated[
        str, option("The robot of openpi's clients, which do not name it.")
    ] = "aloha",
    as_json: AsJson = False,
) -> None:
    """Serve a policy to `evaluate --policy ws://HOST:PORT`, here or on another machine."""
    from pipeline.evaluate.names import make_here, policy_name
    from pipeline.evaluate.policies.policy import Policy, SeesTruth
    from pipeline.evaluate.serving.address import token
    from pipeline.evaluate.serving.batching import batcher_of
    from pipeline.evaluate.serving.server import PolicyServer, ServerAddress, ServerLimits
    from pipeline.evaluate.serving.session import ServerOptions
    from pipeline.world.robots import UnknownEmbodiment, get_embodiment

    try:
        robot = get_embodiment(embodiment).name
    except UnknownEmbodiment as error:
        raise UsageError(f"--embodiment: {error}") from error
    address, name = ServerAddress(host, port, token()), policy_name(policy)

    def made() -> Policy:
        policy_made = make_here(name)
        if isinstance(policy_made, SeesTruth):
            raise UsageError(
                f"{policy} is shown the simulation itself and cannot be served: give it to evaluate"
                " --policy"
            )
        return policy_made

    def print_address(port: int) -> None:
        url = f"ws://{f'[{host}]' if ':' in host else host}:{port}"
        values = {"policy": name.label, "host": host, "port": port}
        print_result(values, as_json, f"serving {name.label} on {url}")
        sys.stdout.flush()

    make = made if batch_wait is None else batcher_of(made(), policy, batch_wait / 1000).seat
    options, limits = ServerOptions(name.label, robot), ServerLimits(clients)
    report = partial(print, file=sys.stderr, flush=True)
    PolicyServer(make, options, address, limits, report).run(print_address)


@recipe_options(
    *CELLS,
    "assets",
    *(key for key in Setup.model_fields if key not in (*IMAGES, "events")),
    tasks="all",
    levels="0,1,2,3",
)
def freeze(
    given: Given,
    out: Annotated[Path, option("The benchmark: NAME.jsonl.xz.")],
    scenes: Annotated[int, number(1, 100_000, "Scenes of each cell.")] = 50,
    seed: Annotated[int, number(0, 10**12, "Scenes are drawn from seed 100000 * (1 + SEED).")] = 0,
    part: Annotated[
        list[str] | None,
        option(
            "A part by name and its tasks, NAME=TASK,TASK; several times for several.",
            metavar="PART",
        ),
    ] = None,
    manifests: Annotated[
        Path | None, option("Directory of admitted seeds; a longer freeze continues there.")
    ] = None,
    executor: Executor = "auto",
    workers: Workers = None,
    address: Address = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Draw scenes that the expert solves, and write them as data into one file, which `evaluate
    --benchmark` takes."""
    from pipeline.evaluate.scenes.benchmark import SUFFIX
    from pipeline.evaluate.scenes.case import blind
    from pipeline.evaluate.scenes.manifests import Manifests
    from pipeline.run.evaluation import freeze_benchmark, runner
    from pipeline.tasks.contract import expand_tasks

    if not out.name.endswith(SUFFIX):
        raise UsageError(f"--out {out}: name it NAME{SUFFIX}")
    name = out.name.removesuffix(SUFFIX)
    recipe = given.recipe(levels=[0, 1, 2, 3])
    if recipe.events:
        raise UsageError("the recipe has events: scenes are frozen without, leave the key out")
    parts = dict[str, tuple[str, ...]]()
    for text in part or ():
        label, _, tasks = text.partition("=")
        parts[label] = expand_tasks(split_list(tasks) or [])
        if unknown := [task for task in parts[label] if task not in recipe.tasks]:
            raise UsageError(f"--part {text}: {unknown[0]} is not among the tasks")
    seeds = Manifests(manifests or out.with_name(f"{name}-seeds"), seed, blind(recipe).physics)
    with resumable(seeds.root):
        run = runner(crew_of(executor, workers, address))
        made = freeze_benchmark(out, recipe.cells(), scenes, parts, seeds, run, not quiet)
    values = {"benchmark": name, "sha256": made.sha256, "scenes": len(made.lines)}
    size = out.stat().st_size
    text = f"{out}: {len(made.lines)} scenes, {size} bytes, sha256 {made.sha256}"
    print_result(values | {"bytes": size, "path": str(out)}, as_json, text)
