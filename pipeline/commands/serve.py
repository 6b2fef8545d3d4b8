"""serve-policy and freeze."""

import sys
from functools import partial
from pathlib import Path
from typing import Annotated

from tqdm import tqdm

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
    setup, cells = blind(recipe).physics, recipe.cells()
    parts = dict[str, tuple[str, ...]]()
    for text in part or ():
        label, _, tasks = text.partition("=")
        parts[label] = expand_tasks(split_list(tasks) or [])
        if unknown := [task for task in parts[label] if task not in recipe.tasks]:
            raise UsageError(f"--part {text}: {unknown[0]} is not among the tasks")
    there = read_benchmark(str(out)) if out.exists() else None
    other = UsageError(f"--out {out}: is another benchmark: give another name, or remove the file")
    if there is not None:
        held = [each.cell() for each in there.head.cells]
        if (there.head.scenes, held) != (scenes, [*cells]):
            raise other
    seeds = Manifests(manifests or out.with_name(f"{name}-seeds"), seed, setup)
    with resumable(seeds.root), tqdm(disable=quiet, bar_format="{desc} [{elapsed}]") as bar:
        bar.set_description_str("admitting seeds")
        cases = seeds.admitted(cells, scenes, runner(crew_of(executor, workers, address)))
        bar.set_description_str("freezing")
        data = pack(name, cases, setup, parts, {"packages": machine()["packages"]})
        made = unpack_benchmark(data, str(out))
        if there is not None and there.sha256 != made.sha256:
            raise other
        write_atomic(out, data)
    values = {"benchmark": name, "sha256": made.sha256, "scenes": len(made.lines)}
    text = f"{out}: {len(made.lines)} scenes, {len(data)} bytes, sha256 {made.sha256}"
    print_result(values | {"bytes": len(data), "path": str(out)}, as_json, text)
