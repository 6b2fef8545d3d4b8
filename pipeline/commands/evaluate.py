"""evaluate: policies in closed loop."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

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
)
from pipeline.commands.options import CELLS, SETUP, Given, recipe_options
from pipeline.commands.serve import BatchWait
from pipeline.data.recipe.model import Recipe
from pipeline.data.setup import Setup
from pipeline.data.spec import MOST_CONDITIONS
from pipeline.data.store.place import with_urls

Baselines = Annotated[
    bool,
    typer.Option(
        "--baselines",
        help="Also evaluate `static` and `still` on the same scenes; printed beside the table.",
    ),
]

PolicyText = Annotated[
    str,
    typer.Option(
        "--policy",
        help=(
            "replay, static, tapper, chaser, interceptor, random, FILE.py, ws://HOST:PORT and"
            " others (docs/evaluation.md)."
        ),
    ),
]
MOST_EPISODES = 100_000
Episodes = Annotated[
    int,
    typer.Option(min=1, max=MOST_EPISODES, help="Admitted scenes per cell; the paper has 100."),
]
ClockText = Annotated[
    str | None,
    typer.Option(
        "--clock",
        help=(
            "sim, step-locked, late:MS, latency:MS and others (docs/evaluation.md); by default"
            " that of the rules."
        ),
    ),
]
InProcess = Annotated[
    bool,
    typer.Option(
        "--in-process",
        help=(
            "Run the policy in the evaluator's process, where a debugger reaches it and it could"
            " change its score."
        ),
    ),
]
Results = Annotated[
    Path, typer.Option(help="Directory of the results; rerun the same command to resume.")
]

BenchmarkText = Annotated[
    str | None,
    typer.Option(
        "--benchmark",
        help=(
            "A benchmark by its name or file, or NAME:PART; its scenes are not drawn. --tasks,"
            " --levels and others choose some of its cells."
        ),
        metavar="NAME",
    ),
]

if TYPE_CHECKING:
    from pipeline.evaluate.evaluate import EvaluationResult
    from pipeline.evaluate.policies.policy import PolicyName

DEMONSTRATING = ("expert", "sight", "corrections", "takeover", "perturb")
"""Keys of who demonstrated, which an evaluation with --like leaves out: it runs no policy that a
dataset names."""

SEEING = ("openpi:", "starvla:", "gr00t:")
"""Policies of servers that make nothing of an observation without images."""

PRINTS = "policy.log"
"""The file in OUT for what a policy prints in a process of its own that a worker started."""


@recipe_options(
    *CELLS,
    "assets",
    *SETUP,
    levels="1",
    tasks="all",
    cameras="none",
    textures="unseen",
    rules="strict",
)
def evaluate(
    given: Given,
    policy: PolicyText,
    benchmark: BenchmarkText = None,
    episodes: Annotated[
        int | None,
        typer.Option(
            "--episodes",
            "--scenes",
            min=1,
            max=MOST_EPISODES,
            help="Scenes of each cell; the paper has 100. By default all of a benchmark, else 100.",
        ),
    ] = None,
    seed: Annotated[
        int,
        typer.Option(
            min=0,
            max=10**12,
            help="Scenes are drawn from seed 100000 * (1 + SEED); a large secret seed hides them.",
        ),
    ] = 0,
    clock: ClockText = None,
    instructions: Annotated[
        str, typer.Option(help="Instructions of the split seen or unseen.")
    ] = "unseen",
    compounding: Annotated[
        bool,
        typer.Option(help="Apply the clutter penalty to every distractor, as the original does."),
    ] = False,
    baselines: Baselines = False,
    paired: Annotated[
        bool,
        typer.Option(
            "--paired",
            help="Run every scene without its events, too: the difference is that of the events.",
        ),
    ] = False,
    conditions: Annotated[
        bool,
        typer.Option(
            "--conditions",
            help="Run every scene with every set of its events: two events make a 2x2 table.",
        ),
    ] = False,
    films: Annotated[
        int,
        typer.Option(min=0, max=1000, help="Film the first episodes of every cell (OUT/films)."),
    ] = 0,
    answer_seconds: Annotated[
        float,
        typer.Option(
            min=0.01,
            max=86_400,
            help=(
                "Time limit of one answer of the policy (s); all answers of an episode have ten"
                " times that."
            ),
        ),
    ] = 300.0,
    batch_wait: BatchWait = None,
    in_process: InProcess = False,
    manifests: Annotated[
        Path | None,
        typer.Option(help="Directory of admitted seeds to share; OUT/manifests by default."),
    ] = None,
    executor: Executor = "auto",
    workers: Workers = None,
    address: Address = None,
    out: Results = Path("OUT"),
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Evaluate a policy in closed loop: success rate, route completion and manipulation score, with
    intervals."""
    from pipeline.evaluate.asking import ANSWERS
    from pipeline.evaluate.evaluate import evaluate as run_evaluation
    from pipeline.evaluate.scenes.benchmark import read_benchmark
    from pipeline.evaluate.scoring.summary import table
    from pipeline.run.evaluation import EPISODE_SECONDS, answer_together, evaluation_of, runner
    from pipeline.run.names import check_events

    if instructions not in ("seen", "unseen"):
        raise UsageError(f"--instructions {instructions!r} is unknown: choose seen or unseen")
    cameras = ("cameras",) if given.values.get("cameras") == [] else ()
    frozen = None if benchmark is None else read_benchmark(benchmark)
    recipe = given.recipe(without=(*DEMONSTRATING, "paired", *cameras), levels=[1])
    # each worker is a client, and a server takes one unless it was told otherwise
    one_client = workers is None and policy.startswith("ws") and batch_wait is None
    crew = crew_of(executor, 1 if one_client else workers, address)
    prints = out.absolute() / PRINTS if crew.executor == "ray" and address is None else None
    setup = _images_setup(given, recipe)
    if frozen is not None:
        if seed or manifests is not None:
            raise UsageError("--seed and --manifests draw scenes: a benchmark has its own")
        setup = frozen.under(setup, Setup.model_fields if given.from_file else given.values)
    if policy.startswith(SEEING) and not setup.cameras and "cameras" not in given.values:
        raise UsageError(
            f"--policy {policy} would get no images: add --like DATASET, or --cameras head"
        )
    name = named_policy(policy, in_process, prints, given.export)
    evaluation = evaluation_of(
        recipe,
        setup,
        name,
        clock or "",
        episodes=episodes or 100,
        seed=seed,
        split=instructions,
        compounding=compounding,
        films=films,
        answer_seconds=answer_seconds,
        baselines=baselines,
        paired=paired,
        conditions=conditions,
    )
    if frozen is not None:
        cells = tuple(frozen.choose(recipe, given.values, given.values.get("tasks", ())))
        scenes = episodes or frozen.head.scenes
        evaluation = replace(evaluation, benchmark=frozen, cells=cells, episodes=scenes)
    check_events(setup, dict.fromkeys(cell.task for cell in evaluation.cells), evaluated=True)
    if (paired or conditions) and not setup.events:
        raise UsageError("--paired and --conditions withhold --events: name some")
    if paired and conditions:
        raise UsageError("--paired and --conditions: give one of the two")
    if conditions and len(setup.events) > MOST_CONDITIONS:
        raise UsageError(f"--conditions takes {MOST_CONDITIONS} events at most")
    together = answer_together(evaluation, crew, None if batch_wait is None else batch_wait / 1000)
    with (
        resumable(out),
        name_file(prints),
        tqdm(disable=quiet, bar_format="{desc} [{elapsed}]") as bar,
        together as shared,
    ):
        runs = runner(crew, EPISODE_SECONDS + ANSWERS * answer_seconds)
        outcome = run_evaluation(shared, out, runs, manifests, bar.set_description_str)
    if outcome.faults:
        count, first = sum(outcome.faults.values()), next(iter(outcome.faults))
        print(
            "domino-data: warning: episodes without a valid answer of the policy, which count as"
            f" failed: {count} ({first})",
            file=sys.stderr,
        )
    text = [table(outcome.cells), *_mean_lines(outcome)]
    if outcome.benchmark:
        text.append(str(outcome.benchmark))
    print_result(outcome.to_dict(), as_json, "\n".join(text))


def _mean_lines(outcome: "EvaluationResult") -> list[str]:
    """Means over tasks, each followed by what the baselines score on the same scenes."""
    from pipeline.evaluate.scoring.summary import two_by_two

    same = ("level", "alpha", "domain", "condition", "embodiment", "category")

    def line(mean: dict[str, Any], name: str) -> str:
        scores = (
            f"SR {mean['success_rate']:.1f} %, RC {mean['route_completion']:.1f}, MS"
            f" {mean['manipulation_score']:.1f}"
        )
        return f"{name}: {scores}"

    out = list[str]()
    for mean in outcome.means:
        where = f" [{mean['condition']}]" if mean["condition"] else ""
        name = f"mean of {mean['tasks']} tasks ({mean['category']}), level {mean['level']}{where}"
        out.append(line(mean, name))
        beside = [row for row in outcome.baselines if all(row[key] == mean[key] for key in same)]
        out += [
            line(row, f"   {row['policy']} on {row['episodes']} of these {mean['episodes']} scenes")
            for row in beside
        ]
    return [*out, *two_by_two(outcome.means)]


def named_policy(
    policy: str, in_process: bool, prints: Path | None = None, like: Path | None = None
) -> "PolicyName":
    """The policy that `--policy` names, in a process of its own unless `in_process`. `like` is an
    export that states what its actions are."""
    from pipeline.evaluate.names import policy_name

    name = policy_name(policy, prints, like)
    return replace(name, process="evaluator") if in_process and name.process == "own" else name


@contextmanager
def name_file(prints: Path | None) -> Iterator[None]:
    """Name the file of what a policy printed at the end of the block, if it printed anything."""
    try:
        yield
    finally:
        if prints is not None and prints.is_file() and prints.stat().st_size:
            print(
                f"domino-data: what the policy printed is in {with_urls(str(prints))}",
                file=sys.stderr,
            )


def _images_setup(given: Given, recipe: Recipe) -> Setup:
    """The setup of an evaluation: images only with named cameras, textures of training only on
    demand."""
    from pipeline.evaluate.scenes.case import blind

    if given.values.get("cameras") == [] or not (given.from_file or "cameras" in given.values):
        if asked := next(
            (key for key in ("depth", "segmentation", "pointcloud") if given.values.get(key)), None
        ):
            raise UsageError(f"--{asked} is of the images of --cameras: name some")
        return blind(recipe)
    return recipe.setup.override({"textures": given.values.get("textures", "unseen")})
