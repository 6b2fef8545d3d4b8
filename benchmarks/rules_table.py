"""What the first touch gives away: reference policies on all 35 tasks under `contact: stop` and
under `contact: hold`.

    python -m benchmarks.rules_table run --rows out/rules --seeds 10
    python -m benchmarks.rules_table page --rows out/rules

`run` tries every policy on one scene of each task, level and rule before the next scene. You can
stop it at any time; the same command resumes. `page` writes docs/measurements/rules.md from the
rows that exist.
"""

import argparse
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from benchmarks.long_tables import write_page
from benchmarks.study.page import DOCS
from benchmarks.study.plan import StudyGroup, interceptor, latency
from benchmarks.study.rows import Row, StudyRows, markdown
from benchmarks.study.run import run
from pipeline.data.recipe.model import Cell
from pipeline.data.setup import Setup
from pipeline.evaluate.scoring.statistics import bootstrap, clustered
from pipeline.tasks import TASKS
from pipeline.tasks.contract import TRACKING, expand_tasks

CONTACTS = ("stop", "hold")
LEVELS = (0, 1, 3)
TRIES = {
    "recorded actions": ("replay", "sim"),
    "static": ("static", "sim"),
    "tapper": ("tapper", "sim"),
    "chaser": ("chaser", "sim"),
    "interceptor": (interceptor(1), "sim"),
    "interceptor, 15 actions an answer, 200 ms": (interceptor(15), latency(200)),
}
"""Policy and clock of each row of the table."""


def groups(tasks: Sequence[str]) -> Iterator[StudyGroup]:
    """The cells of the table; the levels at which the target moves come first."""
    for level in sorted(LEVELS, key=lambda level: (level == 0, level)):
        for task in tasks:
            for contact in CONTACTS:
                cell = Cell(task, "aloha-agilex", level, 0.1, "clean")
                yield StudyGroup(cell, tuple(TRIES.values()), Setup(contact=contact))


def by_task(rows: Sequence[Row]) -> list[tuple[int, int]]:
    """(successes, episodes) of each task."""
    tasks = defaultdict[str, list[bool]](list)
    for row in rows:
        tasks[row["task"]].append(row["success"])
    return [(sum(found), len(found)) for _, found in sorted(tasks.items())]


def rate(rows: StudyRows) -> str:
    """Per cent solved with its 95 % interval, clustered by task."""
    if not rows.rows:
        return "-"
    counts = by_task(rows.rows)
    low, high = clustered(counts)
    return (
        f"{100 * sum(n for n, _ in counts) / sum(of for _, of in counts):.0f}"
        f" ({100 * low:.0f}-{100 * high:.0f})"
    )


def gain(rows: StudyRows, policy: str = "tapper", over: str = "static") -> str:
    """Points by which one policy solves more than another of the scenes that both tried: a mean
    over tasks, with the 95 % interval of a bootstrap over tasks."""
    solved = [
        {(r["task"], r["level"], r["seed"]): r["success"] for r in rows.of(policy=p).rows}
        for p in (policy, over)
    ]
    tasks = defaultdict[str, list[int]](list)
    for scene in sorted(solved[0].keys() & solved[1].keys()):
        tasks[scene[0]].append(int(solved[0][scene]) - int(solved[1][scene]))
    if not tasks:
        return "-"
    means = [100 * float(np.mean(found)) for found in tasks.values()]
    low, high = bootstrap(means)
    return f"{np.mean(means):.0f} ({low:.0f} to {high:.0f})"


def pressed() -> set[str]:
    """Tasks that consist of a touch: the target itself is pressed."""
    return {
        name
        for name, task in TASKS.items()
        if task.category == TRACKING and task.manipulated == task.target
    }


def table(rows: StudyRows) -> str:
    """Markdown: policies down, rules and levels across, and what the tap is worth."""
    cells = [
        rows.of(rules=f"strict-{contact}", level=level) for contact in CONTACTS for level in LEVELS
    ]
    body = [
        (name, *(rate(c.of(policy=p, clock=clock)) for c in cells))
        for name, (p, clock) in TRIES.items()
    ]
    body.append(("tapper minus static, points", *map(gain, cells)))
    body.append(
        (
            "the same without pressed tasks",
            *(gain(c.where(lambda row: row["task"] not in pressed())) for c in cells),
        )
    )
    return markdown(
        ("policy", *(f"{contact}, level {level}" for contact in CONTACTS for level in LEVELS)), body
    )


def tasks_table(rows: StudyRows) -> str:
    """Markdown: tasks down; solved of tried at levels 1 and 3 together."""
    moving = rows.where(lambda row: row["level"] > 0)
    columns = [(p, clock, contact) for p, clock in TRIES.values() for contact in CONTACTS]
    body = []
    for task in moving.values("task"):
        found = [
            moving.of(task=task, policy=p, clock=clock, rules=f"strict-{contact}").rate
            for p, clock, contact in columns
        ]
        body.append((task, *(f"{r.solved}/{r.episodes}" for r in found)))
    return markdown(
        ("task", *(f"{p.partition(':')[0]} {clock}, {contact}" for p, clock, contact in columns)),
        body,
    )


def scenes(rows: StudyRows) -> str:
    """How many scenes a task has in a column of the table: "2", or "1 to 2"."""
    counts = {
        len(rows.of(task=task, level=level, policy="static", rules=f"strict-{contact}").rows)
        for task in rows.values("task")
        for level in LEVELS
        for contact in CONTACTS
    }
    return f"{min(counts)}" if len(counts) == 1 else f"{min(counts)} to {max(counts)}"


def page(rows: StudyRows) -> str:
    """The page as markdown."""
    made, tasks = rows.rows[-1], len(rows.values("task"))
    days = sorted({row["hardware"].rpartition("; ")[2] for row in rows.rows})
    return f"""# What the first touch gives away

Under `contact: stop`, the paper's rule, the first touch ends the target's motion. Under `contact: hold`, a touched target keeps its
motion until it is held ([fidelity.md](../fidelity.md#contact)). The policies are the
[reference policies](../evaluation.md#policies). `tapper` touches the target, returns, and then acts as in a
still scene. What it solves more often than `static`, it owes to the touch alone.

In the pressed tasks ({", ".join(sorted(pressed() & set(rows.values("task"))))}) the touch is the task.
The tapper solves them by following the target, as the chaser does. The last row leaves these tasks out.

Per cent solved, with the 95 % interval clustered by task: {len(rows.rows)} episodes, {tasks} tasks on aloha, alpha 0.1,
domain clean, {scenes(rows)} scenes a task in each column. Code {made["version"]},
{made["hardware"].split(", load")[0]}, {" and ".join(days)}.

{table(rows)}

## By task

Solved of tried at levels 1 and 3 together:

{tasks_table(rows)}

`python -m benchmarks.rules_table run --rows DIR` runs the episodes and resumes where it was stopped; `page` in place of `run`
writes this page.
"""  # noqa: E501


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("run", "page"))
    parser.add_argument("--rows", type=Path, default=Path("out/rules"), help="where the rows are")
    parser.add_argument("--tasks", default="all")
    parser.add_argument(
        "--seeds", type=int, default=10, help="admitted scenes of every task, level and rule"
    )
    args = parser.parse_args()
    if args.what == "run":
        run(args.rows, list(groups(expand_tasks(args.tasks.split(",")))), args.seeds, step=1)
    else:
        write_page(DOCS / "measurements" / "rules.md", page(StudyRows.read(args.rows)))


if __name__ == "__main__":
    main()
