"""evaluate: policies in closed loop."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tqdm import tqdm

from pipeline.data.recipe.model import Recipe
from pipeline.data.setup import Setup
from pipeline.data.spec import MOST_CONDITIONS
from pipeline.data.store.place import with_urls

from .common import (
    Address,
    AsJson,
    Executor,
    Quiet,
    UsageError,
    Workers,
    crew_of,
    note,
    number,
    option,
    print_result,
    resumable,
)
from .options import CELLS, SETUP, Given, recipe_options

if TYPE_CHECKING:
    from pipeline.evaluate.evaluate import EvaluationResult
    from pipeline.evaluate.policies.policy import PolicyName

MOST_EPISODES = 100_000

REAL_TIME = "paused,100,300"
"""The clocks of the suite `decide`."""

Baselines = Annotated[
    bool, option("Also evaluate `static` and `still` on the same scenes.", "--baselines")
]
PolicyText = Annotated[
    str,
    option(
        "replay, static, still, tapper, chaser, interceptor, random, FILE.py, ws://HOST:PORT and"
        " others (docs/evaluation.md)."
    ),
]
Episodes = Annotated[int, number(1, MOST_EPISODES, "Admitted scenes per cell; the paper has 100.")]
ClockText = Annotated[
    str | None,
    option(
        "sim, step-locked, late:MS and others (docs/evaluation.md), also several, as in"
        " paused,100,300; by default the rules', and these three for the suite decide."
    ),
]
InProcess = Annotated[
    bool,
    option(
        "Run the policy in the evaluator's process: a debugger reaches it, and it the score.",
        "--in-process",
    ),
]
Results = Annotated[Path, option("Directory of the results; rerun the same command to resume.")]

DEMONSTRATING = ("expert", "sight", "corrections", "takeover", "perturb")
"""Keys of who demonstrated, which an evaluation with --like leaves out: it runs no policy that a
dataset names."""

SEEING = ("openpi:", "starvla:", "gr00t:")
"""Policies of servers that make nothing of an observation without images."""


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
    benchmark: Annotated[
        str | None,
        option(
            "A benchmark by its name or file, or NAME:PART; its scenes are not drawn. --tasks,"
            " --levels and others choose some of its cells.",
            metavar="NAME",
        ),
    ] = None,
    episodes: Annotated[
        int | None,
        number(
            1,
            MOST_EPISODES,
            "Scenes of each cell; the paper has 100. By default all of a benchmark, else 100.",
            "--episodes",
            "--scenes",
        ),
    ] = None,
    seed: Annotated[
        int,
        number(
            0,
            10**12,
            "Scenes are drawn from seed 100000 * (1 + SEED); a large secret seed hides them.",
        ),
    ] = 0,
    clock: ClockText = None,
    instructions: Annotated[str, option("Instructions of the split seen or unseen.")] = "unseen",
    compounding: Annotated[
        bool, option("Apply the clutter penalty to every distractor, as the original does.")
    ] = False,
    baselines: Baselines = False,
    paired: Annotated[
        bool,
        option(
            "Run every scene without its events, too: the difference is that of the events.",
            "--paired",
        ),
    ] = False,
    conditions: Annotated[
        bool,
        option(
            "Run every scene with every set of its events: two events make a 2x2 table.",
            "--conditions",
        ),
    ] = False,
    films: Annotated[
        int, number(0, 1000, "Film the first episodes of every cell (OUT/films).")
    ] = 0,
    answer_seconds: Annotated[
        float,
        number(
            0.01,
            86_400,
            "Time limit of one answer of the policy (s); of all of an episode ten times that.",
        ),
    ] = 300.0,
    in_process: InProcess = False,
    manifests: Annotated[
        Path | None, option("Directory of admitted seeds to share; OUT/manifests by default.")
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
    from pipeline.evaluate.evaluate import BASELINES, together
    from pipeline.evaluate.evaluate import evaluate as run_evaluation
    from pipeline.evaluate.names import POLICIES, is_ours
    from pipeline.evaluate.scenes.benchmark import read_benchmark
    from pipeline.evaluate.scoring.clock import parse_clock
    from pipeline.evaluate.scoring.summary import by_clock, table
    from pipeline.run.evaluation import EPISODE_SECONDS, evaluation_of, runner
    from pipeline.run.names import check_events
    from pipeline.tasks.contract import expand_tasks

    if instructions not in ("seen", "unseen"):
        raise UsageError(f"--instructions {instructions!r} is unknown: choose seen or unseen")
    cameras = ("cameras",) if given.values.get("cameras") == [] else ()
    frozen = None if benchmark is None else read_benchmark(benchmark)
    recipe = given.recipe(without=(*DEMONSTRATING, "paired", *cameras), levels=[1])
    # each worker is a client, and a server takes one unless it was told otherwise
    one_client = workers is None and policy.startswith("ws")
    crew = crew_of(executor, 1 if one_client else workers, address)
    # what a policy prints in a process of its own that a worker started
    local = crew.executor == "ray" and address is None
    prints = out.absolute() / "policy.log" if local else None
    setup = _images_setup(given, recipe)
    if frozen is not None:
        if seed or manifests is not None:
            raise UsageError("--seed and --manifests draw scenes: a benchmark has its own")
        episodes = frozen.count_scenes(episodes)
        setup = frozen.under(setup, Setup.model_fields if given.from_file else given.values)
    if policy.startswith(SEEING) and not setup.cameras and "cameras" not in given.values:
        raise UsageError(
            f"--policy {policy} would get no images: add --like DATASET, or --cameras head"
        )
    timed = setup.rules != "domino" and {*expand_tasks(recipe.tasks)} <= {*expand_tasks(["decide"])}
    clocks = (clock or (REAL_TIME if timed else "")).split(",")
    evaluation = evaluation_of(
        recipe,
        setup,
        named_policy(policy, in_process, prints, given.export),
        clocks[0],
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
        evaluation = replace(evaluation, benchmark=frozen, cells=cells)
    others = [parse_clock(text) for text in clocks[1:]]
    tried = [evaluation.clock, *others]
    if len({*tried}) < len(tried):
        raise UsageError(f"--clock {clock} names a clock twice: name each once")
    scripted = [
        name
        for name in (policy, *(BASELINES if baselines else ()))
        if is_ours(name) and getattr(POLICIES[name.partition(":")[0]], "scripted", False)
    ]
    if scripted and (late := [one.name for one in tried if one.join]):
        why = f"--policy {scripted[0]} cannot overlap its chunks"
        raise UsageError(f"--clock {late[0]}: {why}: use latency:...")
    check_events(setup, dict.fromkeys(cell.task for cell in evaluation.cells), evaluated=True)
    if (paired or conditions) and not setup.events:
        raise UsageError("--paired and --conditions withhold --events: name some")
    if paired and conditions:
        raise UsageError("--paired and --conditions: give one of the two")
    if conditions and len(setup.events) > MOST_CONDITIONS:
        raise UsageError(f"--conditions takes {MOST_CONDITIONS} events at most")
    with (
        resumable(out),
        _name_file(prints),
        tqdm(disable=quiet, bar_format="{desc} [{elapsed}]") as bar,
    ):
        runs = runner(crew, EPISODE_SECONDS + ANSWERS * answer_seconds)
        outcome = together(
            run_evaluation(each, out, runs, manifests, bar.set_description_str)
            for each in (evaluation, *(replace(evaluation, clock=c) for c in others))
        )
    if outcome.faults:
        count, first = sum(outcome.faults.values()), next(iter(outcome.faults))
        note(
            "warning: episodes without a valid answer of the policy, which count as failed:"
            f" {count} ({first})"
        )
    text = [table(outcome.cells), *_mean_lines(outcome)]
    if others:
        text = by_clock(outcome.cells, outcome.means)
    if paired:
        text.append(f"with events; against without: domino-data compare {out}")
    if outcome.benchmark:
        text.append(str(outcome.benchmark))
    print_result(outcome.to_dict(), as_json, "\n".join(text))


def _mean_lines(outcome: "EvaluationResult") -> list[str]:
    from pipeline.evaluate.scoring.summary import two_by_two

    same = ("level", "alpha", "domain", "condition", "embodiment", "category")

    def line(row: dict[str, Any], name: str) -> str:
        return (
            f"{name}: SR {row['success_rate']:.1f} %, RC {row['route_completion']:.1f}, MS"
            f" {row['manipulation_score']:.1f}"
        )

    lines = list[str]()
    for mean in outcome.means:
        where = f" [{mean['condition']}]" if mean["condition"] else ""
        of = f"mean of {mean['tasks']} tasks ({mean['category']}), level {mean['level']}{where}"
        lines.append(line(mean, of))
        for row in outcome.baselines:
            if all(row[key] == mean[key] for key in same):
                of = f"{row['episodes']} of these {mean['episodes']} scenes"
                lines.append(line(row, f"   {row['policy']} on {of}"))
    return [*lines, *two_by_two(outcome.means)]


def named_policy(
    policy: str, in_process: bool, prints: Path | None = None, like: Path | None = None
) -> "PolicyName":
    """The policy that `--policy` names, in a process of its own unless `in_process`. `like` is an
    export that states what its actions are."""
    from pipeline.evaluate.names import policy_name

    name = policy_name(policy, prints, like)
    return replace(name, process="evaluator") if in_process and name.process == "own" else name


@contextmanager
def _name_file(prints: Path | None) -> Iterator[None]:
    """Name the file of a policy's output, if any."""
    try:
        yield
    finally:
        if prints is not None and prints.is_file() and prints.stat().st_size:
            note(f"what the policy printed is in {with_urls(str(prints))}")


def _images_setup(given: Given, recipe: Recipe) -> Setup:
    """The setup of an evaluation: images only with named cameras."""
    from pipeline.evaluate.scenes.case import blind

    if given.values.get("cameras") == [] or not (given.from_file or "cameras" in given.values):
        for key in ("depth", "segmentation", "pointcloud"):
            if given.values.get(key):
                raise UsageError(f"--{key} is of the images of --cameras: name some")
        return blind(recipe)
    return recipe.setup.override({"textures": given.values.get("textures", "unseen")})
