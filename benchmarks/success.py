"""Attempt success of tasks x robots x levels x domains x experts, physics only.

    python -m benchmarks.success --tasks domino --robots all --levels 1,3 --domains clean,randomized \
        --experts planned,reactive --slots 1 --seed 2040 --rows rows.jsonl

Slots are filled as a build fills them, without images: attempts, each with a layout of its own,
until one is accepted. Every finished slot is a line of `--rows`: the same command resumes a run
that was stopped. They are filled in random order, so that a part stands for the whole. `--table`
prints the tables of the file and makes no attempts.

It prints, for each expert, per cent of attempts accepted with 95 % intervals clustered by slot
(attempts of a slot share the motion's shape), why attempts fail, how accepted targets move against
how the law draws them (of level 1 with a test, for each alpha), how far the hands travel and how
hard the robot presses.
"""  # noqa: E501

import argparse
import json
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict
from multiprocessing import get_context
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from tqdm import tqdm

from benchmarks.hardware import hardware
from benchmarks.limits import ways_of
from pipeline.data.clock import PHYSICS_HZ
from pipeline.data.recipe.model import Recipe, Slot
from pipeline.evaluate.scoring.statistics import clustered
from pipeline.motion.planar_shapes import mean_speed
from pipeline.report.summary import drawn_and_accepted, law
from pipeline.stages.attempt import Rollout, attempt
from pipeline.stages.failure import Failure
from pipeline.tasks.contract import expand_tasks
from pipeline.world.physics.contacts import ContactKinds
from pipeline.world.robots import MODELS, get_embodiment

SUITES = ("domino", "beyond", "decide")
ORIGINAL_STATIC = {"aloha-agilex": 78, "arx-x5": 78, "franka-panda": 69, "piper": 27, "ur5-wsg": 61}
"""Mean static expert success of the original over its 35 tasks, per cent (RoboTwin 2.0
documentation)."""

CELL = ("task", "embodiment", "level", "alpha", "domain", "slot")
KEYS = ("expert", "seed", "attempts", "contact", "start")
SAME = (*CELL, *KEYS)
"""What tells a slot from the others of a file."""

Row = dict[str, Any]


def fill(recipe: Recipe, slot: Slot) -> Row:
    """Attempts at a slot until one is accepted: the row of the slot."""
    tries = list[Row]()
    row = asdict(slot.cell) | {"slot": slot.index} | settings(recipe) | {"tries": tries}
    for number in range(recipe.attempts):
        spec, worked = recipe.spec(slot, number), time.process_time()
        try:
            done = attempt(spec, recipe)
        except Failure as failure:
            one = {
                "outcome": "failed",
                "stage": failure.stage,
                "reason": failure.reason,
                "detail": failure.detail,
            }
            drawn = failure.drawn
        else:
            one, drawn = {"outcome": "accepted"}, done.motion.features()
            row |= {"travel": travel(done), "forces": forces(done)}
        moved = asdict(drawn) if drawn else {}
        seconds = time.process_time() - worked
        tries.append({"attempt": number, "seconds": seconds} | one | moved)
        if one["outcome"] == "accepted":
            break
    return row


def settings(recipe: Recipe) -> Row:
    """What of a recipe tells the rows of a file apart."""
    return {name: getattr(recipe, name) for name in KEYS}


def travel(done: Rollout) -> Row:
    """Length (m) of the way of both tools in an episode, and by how much (m) the way of one skill
    exceeds its straight line."""
    log = done.replay.log
    worst = max((way.length - way.straight for way in ways_of(log)), default=0.0)
    total = np.linalg.norm(np.diff(log.tcp[..., :3], axis=0), axis=-1).sum()
    return {"total": round(float(total), 3), "excess": round(worst, 3)}


def forces(done: Rollout) -> Row:
    """The strongest contact (N) of an episode of each kind that the robot has, as sampled for the
    state log (30 Hz)."""
    log, found = done.replay.log, defaultdict[str, float](float)
    contact = ContactKinds(done.scene.embodiment)
    for row in log.contacts:
        if kind := contact.of(log.bodies[row["a"]], log.bodies[row["b"]]):
            found[kind] = max(found[kind], round(PHYSICS_HZ * float(row["impulse"]), 1))
    return dict(found)


def run(jobs: Sequence[tuple[Recipe, Slot]], workers: int, keep: Callable[[Row], None]) -> None:
    """Fill all slots in fresh processes, and keep each row as it comes. Ctrl-C ends it with what is
    finished."""
    filled = tried = 0
    with (
        ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool,
        tqdm(total=len(jobs), unit="slot") as bar,
    ):
        futures = [pool.submit(fill, *job) for job in jobs]
        try:
            for future in as_completed(futures):
                row = future.result()
                keep(row)
                filled, tried = filled + is_filled(row), tried + len(row["tries"])
                bar.update()
                bar.set_postfix_str(f"{filled / tried:.1%} of {tried} attempts accepted")
        except KeyboardInterrupt:
            pool.shutdown(cancel_futures=True)
        except BrokenProcessPool:
            print("a worker was killed: run the same command again to resume", file=sys.stderr)


def is_filled(row: Row) -> bool:
    """Whether the last attempt of a slot was accepted."""
    return row["tries"][-1]["outcome"] == "accepted"


def percent(rows: Sequence[Row], digits: int = 0) -> str:
    """Per cent of the attempts of slots that were accepted, as text; "" for no slots."""
    tries = sum(len(row["tries"]) for row in rows)
    return f"{100 * sum(map(is_filled, rows)) / tries:.{digits}f}" if rows else ""


def interval(rows: Sequence[Row]) -> str:
    """95 % interval of that share, clustered by slot, as text."""
    low, high = clustered([(int(is_filled(row)), len(row["tries"])) for row in rows])
    return f"{100 * low:.1f}-{100 * high:.1f}"


def rates(rows: Sequence[Row], by: str) -> str:
    """Markdown: tasks down, values of `by` across, per cent of attempts accepted; per level too,
    and all with intervals."""
    columns = sorted({row[by] for row in rows})

    def line(
        name: str, group: Sequence[Row], cell: Callable[[Sequence[Row]], str] = percent
    ) -> str:
        cells = [cell([row for row in group if row[by] == column]) for column in columns]
        return f"| {name} | " + " | ".join([*cells, cell(group)]) + " |"

    lines = [
        "| task | " + " | ".join([*columns, "all"]) + " |",
        "|---|" + "---:|" * (len(columns) + 1),
    ]
    lines += [
        line(task, [r for r in rows if r["task"] == task])
        for task in sorted({r["task"] for r in rows})
    ]
    lines += [
        line(f"level {level}", [r for r in rows if r["level"] == level])
        for level in sorted({r["level"] for r in rows})
    ]
    lines += [
        line("**all attempts**", rows, lambda group: percent(group, 1)),
        line("95 % interval by slot", rows, interval),
    ]
    lines += [
        line("slots filled", rows, lambda group: f"{sum(map(is_filled, group))} of {len(group)}")
    ]
    if by == "embodiment":
        lines.append(line("original, static expert", rows, original))
    return "\n".join(lines)


def summary(rows: Sequence[Row]) -> str:
    """Markdown, one row an expert and suite: slots, attempts and per cent accepted."""
    head = "| expert | suite | slots | filled | attempts | accepted, % | 95 % interval by slot |"
    lines = [head, "|---|---|---:|---:|---:|---:|---:|"]
    suite_of = {task: suite for suite in SUITES for task in expand_tasks([suite])}
    groups = defaultdict[tuple[str, str], list[Row]](list)
    for row in rows:
        groups[row["expert"], suite_of.get(row["task"], "others")].append(row)
    for (expert, suite), group in sorted(groups.items()):
        count = sum(len(row["tries"]) for row in group)
        cells = (len(group), sum(map(is_filled, group)), count, percent(group, 1), interval(group))
        lines.append(f"| {expert} | {suite} | " + " | ".join(map(str, cells)) + " |")
    return "\n".join(lines)


def original(rows: Sequence[Row]) -> str:
    """The original's success on the robot of these slots, "" for several robots."""
    robots = {row["embodiment"] for row in rows}
    return str(ORIGINAL_STATIC[robots.pop()]) if len(robots) == 1 else ""


def attempts(rows: Sequence[Row]) -> list[Row]:
    """All attempts of slots, each with the cell of its slot, as pipeline.report.summary takes
    them."""
    return [{name: row[name] for name in CELL} | one for row in rows for one in row["tries"]]


def speeds(rows: Sequence[Row]) -> str:
    """Markdown: motions drawn against motions accepted per level and alpha, and the test of level 1
    against the paper's law."""
    head = [
        "level",
        "alpha m/s",
        "motions",
        "number",
        "average m/s",
        "end m/s",
        "greatest, 99 % below m/s",
    ]
    head += ["displacement m", "under 5 cm", "0.8 alpha or more"]
    lines, tests = ["| " + " | ".join(head) + " |", "|---:|---:|---|" + "---:|" * 7], list[str]()
    for level, alpha in sorted({(row["level"], row["alpha"]) for row in rows if row["level"]}):
        groups = drawn_and_accepted(
            attempts([row for row in rows if (row["level"], row["alpha"]) == (level, alpha)])
        )
        for name, group in zip(("drawn", "accepted"), groups, strict=True):
            if (m := law(group)) is not None:
                greatest = np.quantile([one["maximum_speed"] for one in group], 0.99)
                means = (
                    f"{m.count} | {m.average_speed:.4f} | {m.end_speed:.4f} | {greatest:.2f} |"
                    f" {m.displacement:.3f}"
                )
                lines.append(
                    f"| {level} | {alpha:g} | {name} | {means} | {m.short:.0%} | {m.fast:.0%} |"
                )
            if level == 1 and group:
                d, p = kolmogorov_smirnov(
                    [one["average_speed"] / alpha for one in group], 0.01 / alpha
                )
                mean = f"the law's mean is {mean_speed(alpha):.4f}"
                tests.append(
                    f"{len(group)} motions {name} at {alpha:g} m/s: {mean}; D {d:.3f}, p {p:.2g}"
                )
    return "\n".join([*lines, "", *tests])


def kolmogorov_smirnov(
    relative: Sequence[float] | NDArray[np.float64], slowest: float = 0.1
) -> tuple[float, float]:
    """Statistic and p of speeds over alpha against clip(abs(N(0.8, 1/3)), slowest, 1), by its
    probability integral transform. `slowest` is 0.01 m/s over alpha.

    The law has atoms at both clips, where the transform draws from the atom's share: then it is
    uniform under the law.
    """
    normal, rng = stats.norm(0.8, 1 / 3), np.random.default_rng(0)
    x = np.asarray(relative)
    below = normal.cdf(x) - normal.cdf(-x)
    low, high = normal.cdf(slowest) - normal.cdf(-slowest), normal.cdf(1.0) - normal.cdf(-1.0)
    spread = rng.random(len(x))
    u = np.where(
        x <= slowest + 1e-9,
        spread * low,
        np.where(x >= 1 - 1e-9, high + spread * (1 - high), below),
    )
    found = stats.kstest(u, "uniform")
    return float(found.statistic), float(found.pvalue)


def hands(rows: Sequence[Row]) -> str:
    """Markdown, one row a robot: how far the tools travel, and the strongest contacts; median, 95th
    percentile and most."""
    kinds = {
        "arms": "arm on arm",
        "hands": "hand on hand",
        "palm": "palm or link on a body",
        "table": "finger on table",
        "finger": "finger on a body",
    }
    head = [
        "robot",
        "episodes",
        "both tools, m",
        "beyond the straight line of a skill, m",
        *(f"{k}, N" for k in kinds.values()),
    ]
    lines = ["| " + " | ".join(head) + " |", "|---|" + "---:|" * (len(head) - 1)]
    for robot in sorted({row["embodiment"] for row in rows}):
        group = [row for row in rows if row["embodiment"] == robot and is_filled(row)]
        ways = [[row["travel"][name] for row in group] for name in ("total", "excess")]
        pushes = [[row["forces"].get(kind, 0.0) for row in group] for kind in kinds]
        cells = [*(_spread(way, 2) for way in ways), *(_spread(push, 0) for push in pushes)]
        lines.append(f"| {robot} | {len(group)} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _spread(values: Sequence[float], digits: int) -> str:
    middle, most = np.quantile(values, (0.5, 0.95)) if values else (np.nan, np.nan)
    return f"{middle:.{digits}f}, {most:.{digits}f}, {max(values, default=np.nan):.{digits}f}"


def reasons(rows: Sequence[Row]) -> str:
    """Markdown: why attempts failed, with the number of slots in which they did, and the tasks
    where they did most often."""
    failed = [(row, one) for row in rows for one in row["tries"] if one["outcome"] == "failed"]
    groups = defaultdict[str, list[Row]](list)
    for row, one in failed:
        groups[f"{one['stage']}: {one['reason']}"].append(row)
    lines = ["| stage: reason | attempts | slots | most often in |", "|---|---:|---:|---|"]
    for reason, of in sorted(groups.items(), key=lambda item: (-len(item[1]), item[0])):
        tasks = ", ".join(
            f"{task} {n}" for task, n in Counter(row["task"] for row in of).most_common(3)
        )
        lines.append(
            f"| {reason} | {len(of)} | {len({tuple(row[k] for k in SAME) for row in of})} |"
            f" {tasks} |"
        )
    return "\n".join(lines)


def tables(rows: Sequence[Row]) -> Iterator[str]:
    """All tables, expert by expert."""
    yield hardware()
    yield summary(rows)
    for expert in sorted({row["expert"] for row in rows}):
        own = [row for row in rows if row["expert"] == expert]
        seconds = sum(one["seconds"] for row in own for one in row["tries"]) / max(
            1, sum(map(is_filled, own))
        )
        count = sum(len(row["tries"]) for row in own)
        share = (
            f"{percent(own, 1)} % ({interval(own)}) of {count} attempts at {len(own)} slots"
            " accepted"
        )
        yield (
            f"## {expert} expert\n\n{share}; {seconds:.2f} s of processor time an accepted episode."
        )
        for by in ("embodiment", "domain", "alpha"):
            if by == "embodiment" or len({row[by] for row in own}) > 1:
                yield rates([row | {by: str(row[by])} for row in own], by)
        yield from (reasons(own), speeds(own), hands(own))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--tasks", default="domino", help="names of tasks and of suites, such as domino or beyond"
    )
    parser.add_argument("--robots", default="aloha")
    parser.add_argument("--levels", default="1")
    parser.add_argument("--alpha", default="0.1")
    parser.add_argument("--domains", default="clean")
    parser.add_argument("--experts", default="planned")
    parser.add_argument(
        "--slots", type=int, default=1, help="slots per task, robot, level, alpha and domain"
    )
    parser.add_argument(
        "--seed", type=int, default=0, help="seed of the recipe: other ones are other layouts"
    )
    parser.add_argument("--attempts", type=int, default=30)
    parser.add_argument(
        "--contact",
        help="what the first touch does to the target, where it is not what the rules say",
    )
    parser.add_argument(
        "--start", help="when targets start, early or late, where it is not what the rules say"
    )
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument(
        "--rows",
        type=Path,
        required=True,
        help="JSON lines, one a slot; slots that it has are not filled again",
    )
    parser.add_argument(
        "--table", action="store_true", help="make no attempts: print the tables of the rows"
    )
    args = parser.parse_args()
    rows = (
        [json.loads(line) for line in args.rows.read_text().splitlines()]
        if args.rows.exists()
        else []
    )
    if not args.table:
        jobs = wanted(args)
        have = {tuple(row[name] for name in SAME) for row in rows}
        left = [(recipe, slot) for recipe, slot in jobs if _key(recipe, slot) not in have]
        Random(0).shuffle(left)
        with args.rows.open("a") as file:

            def keep(row: Row) -> None:
                rows.append(row)
                print(json.dumps(row), file=file, flush=True)

            run(left, args.workers, keep)
        asked = {_key(*job) for job in jobs}
        rows = [row for row in rows if tuple(row[name] for name in SAME) in asked]
    print("\n\n".join(tables(rows)))


def wanted(args: argparse.Namespace) -> list[tuple[Recipe, Slot]]:
    """The slots that are asked for, expert by expert."""
    robots = (
        list(MODELS)
        if args.robots == "all"
        else [get_embodiment(robot).name for robot in args.robots.split(",")]
    )
    values = {
        "seed": args.seed,
        "tasks": expand_tasks(args.tasks.split(",")),
        "embodiments": robots,
        "attempts": args.attempts,
    }
    values |= {
        "levels": [int(x) for x in args.levels.split(",")],
        "alpha": [float(x) for x in args.alpha.split(",")],
    }
    values |= {
        "domains": args.domains.split(","),
        "episodes": args.slots,
        "contact": args.contact,
        "start": args.start,
    }
    recipes = [
        Recipe.model_validate(values | {"expert": expert}) for expert in args.experts.split(",")
    ]
    return [(recipe, slot) for recipe in recipes for slot in recipe.slots()]


def _key(recipe: Recipe, slot: Slot) -> tuple[Any, ...]:
    row = asdict(slot.cell) | {"slot": slot.index} | settings(recipe)
    return tuple(row[name] for name in SAME)


if __name__ == "__main__":
    main()
