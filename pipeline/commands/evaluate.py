"""evaluate: policies in closed loop."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

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
    table,
)
from .options import CELLS, SETUP, Given, recipe_options

if TYPE_CHECKING:
    from pipeline.evaluate.policies.policy import PolicyName

type Row = dict[str, Any]

MOST_EPISODES = 100_000

REAL_TIME = "paused,100,300"
"""The clocks of the suite `decide`."""

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
    instructions: Annotated[
        Literal["seen", "unseen"], option("The split of sentences.")
    ] = "unseen",
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
    from pipeline.evaluate.evaluate import evaluate as run_evaluation
    from pipeline.evaluate.evaluate import together
    from pipeline.evaluate.names import POLICIES, is_ours
    from pipeline.evaluate.scenes.benchmark import read_benchmark
    from pipeline.evaluate.scoring.clock import parse_clock
    from pipeline.run.evaluation import EPISODE_SECONDS, evaluation_of, runner
    from pipeline.run.names import check_events
    from pipeline.tasks.contract import expand_tasks

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
        films=films,
        answer_seconds=answer_seconds,
        paired=paired,
        conditions=conditions,
    )
    if frozen is not None:
        cells = tuple(frozen.choose(recipe, given.values, given.values.get("tasks", ())))
        evaluation = replace(evaluation, benchmark=frozen, cells=cells)
    others = [parse_clock(text) for text in clocks[1:]]
    tried = [evaluation.clock, *others]
    if len({*tried}) < len(tried):
        raise UsageError(f"--clock {clock} names a clock twice")
    scripted = is_ours(policy) and getattr(POLICIES[policy.partition(":")[0]], "scripted", False)
    if scripted and (late := [one.name for one in tried if one.join]):
        why = f"--policy {policy} cannot overlap its chunks"
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
    text = [describe(outcome.cells, outcome.means), *describe_conditions(outcome.means)]
    if others:
        text = [describe_clocks(outcome.cells, outcome.means)]
    if paired:
        text.append(f"with events; against without: domino-data compare {out}")
    if outcome.benchmark:
        text.append(str(outcome.benchmark))
    print_result(outcome.to_dict(), as_json, "\n".join(text))


def describe(cells: Sequence[Row], means: Sequence[Row]) -> str:
    """Cells and means over tasks as aligned text, without empty columns."""
    rows = list[Row]()
    for row in (*cells, *means):
        low, high = row["success_rate_interval"]
        failures = row.get("failures", {}) | {"unreachable poses": row.get("unreachable", 0)}
        hold = row.get("hold")
        rows.append(
            _place(row)
            | {
                "rules": row["rules"],
                "truth": "sees" if row["sees_truth"] else "-",
                "process": row["process"],
                "n": row["episodes"],
                "SR %": f"{row['success_rate']:.1f}",
                "(95 %)": f"{low:.1f}-{high:.1f}",
                "RC": f"{row['route_completion']:.1f}",
                "MS": f"{row['manipulation_score']:.1f}",
                "hold s": "-" if hold is None else f"{hold:.2f}",
                "failures": ", ".join(f"{name} {n}" for name, n in failures.items() if n),
            }
        )
    return _table_of(rows)


def describe_clocks(cells: Sequence[Row], means: Sequence[Row]) -> str:
    """Success rates (per cent) by clock, and what the first clock hides."""
    from pipeline.evaluate.scoring.page import clock_title

    lines = dict[tuple[Any, ...], Row]()
    for row in (*cells, *(mean for mean in means if mean["category"] == "all")):
        line = lines.setdefault((*_place(row).values(), row["rules"]), _place(row))
        line[clock_title(row["clock"])] = f"{row['success_rate']:.1f}"
    rates = defaultdict[str, list[float]](list)
    for row in cells:
        rates[clock_title(row["clock"])].append(row["success_rate"])
    first, *others = ((name, sum(each) / len(each)) for name, each in rates.items())
    lost = ", ".join(f"{first[1] - rate:.1f} at {name}" for name, rate in others)
    return f"{_table_of([*lines.values()])}\nWhat {first[0]} hides, in points of SR: {lost}"


def describe_conditions(means: Sequence[Row]) -> list[str]:
    """Tables of success rates (per cent) under two conditions, with their interaction."""
    groups, out = defaultdict[Any, dict[str, float]](dict), list[str]()
    for mean in means:
        if mean["category"] == "all":
            place = {k: v for k, v in _place(mean).items() if k != "condition"}
            groups[(*place.values(), mean["rules"])][mean["condition"]] = mean["success_rate"]
    for (_, _, level, *_), rates in groups.items():
        one, _, two = max(rates, key=lambda name: name.count("+")).partition("+")
        if "+" in two or {*rates} != {"none", one, two, f"{one}+{two}"}:
            continue
        neither, first, second, both = (rates[n] for n in ("none", one, two, f"{one}+{two}"))
        body = [
            (f"no {one}", f"{neither:.1f}", f"{second:.1f}"),
            (one, f"{first:.1f}", f"{both:.1f}"),
            ("interaction, points", f"{both - first - second + neither:+.1f}", ""),
        ]
        out.append(table((f"SR %, level {level}", f"no {two}", two), body))
    return out


def _place(row: Row) -> Row:
    name = row.get("task") or f"mean of {row['tasks']} tasks ({row['category']})"
    where = {"task": name, "robot": row["embodiment"], "L": row["level"]}
    where |= {"alpha": f"{row['alpha']:g}", "domain": row["domain"]}
    return where | {"condition": row["condition"]}


def _table_of(rows: Sequence[Row]) -> str:
    head = [name for name in rows[0] if any(row[name] != "" for row in rows)] if rows else []
    return table(head, [[row[name] for name in head] for row in rows])


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
