"""Writes tables and plots of the study into docs/measurements/evaluation.md, between two marks."""

from datetime import date
from pathlib import Path

from benchmarks.long_tables import write_page
from benchmarks.study import plots, tables
from benchmarks.study.rows import StudyRows

DOCS = Path(__file__).parents[2] / "docs"
BEGIN, END = "<!-- reference policies: begin -->", "<!-- reference policies: end -->"


def write(rows: StudyRows, docs: Path = DOCS) -> None:
    """Tables between the marks, pictures beside the page."""
    plots.policies(rows, docs / "evaluation_policies.png")
    plots.timing(rows, docs / "evaluation_timing.png")
    plots.delays(rows, docs / "evaluation_latency.png")
    page = docs / "measurements" / "evaluation.md"
    write_page(page, inserted(page.read_text(), text(rows), BEGIN, END))


def inserted(page: str, block: str, begin: str, end: str) -> str:
    """The page with the text between two marks replaced. Raises ValueError for a page without
    them."""
    head, _, rest = page.partition(begin)
    _, found, tail = rest.partition(end)
    if not found:
        raise ValueError(f"the page has no marks {begin} and {end}")
    return f"{head}{begin}\n\n{block}\n\n{end}{tail}"


def text(rows: StudyRows) -> str:
    """The generated part of the page."""
    seeds = sorted(
        {
            len(
                rows.of(
                    task=t, policy="replay", clock="sim", rules="strict", level=1, alpha=0.1
                ).rows
            )
            for t in rows.values("task")
        }
    )
    count = f"{seeds[0]}" if len(seeds) == 1 else f"{seeds[0]}-{seeds[-1]}"
    made = rows.rows[-1]
    untimed = ", ".join(f"{task} ({contact})" for task, contact in tables.untimed(rows)) or "none"
    return "\n\n".join(
        [
            (
                f"{len(rows.rows)} episodes, {count} admitted scenes a task and cell, aloha, clean;"
                f" code {made['version']}, {made['hardware'].split(', load')[0]}, {date.today()}."
                " Per cent solved, Wilson's 95 % interval in brackets."
            ),
            "### Policies that need no training",
            tables.summary(rows),
            "![Success rate against alpha](../evaluation_policies.png)",
            "Solved of tried at alpha 0.1, by task and level:",
            tables.by_task(rows),
            "### How precise the timing must be",
            "Recorded actions, `--clock late:MS`, level 1; per cent solved:",
            tables.timing(rows),
            "![Success rate against delay](../evaluation_timing.png)",
            (
                f"At alpha 0.1 these keep at least {tables.ENOUGH:.0%} of their success with a"
                f" target 0.4 s late, so they measure timing only coarsely: {untimed}."
            ),
            "### How much latency costs",
            (
                "The interceptor at level 1, alpha 0.1, on `--clock latency:MS`; with no latency,"
                " chunk size makes no difference:"
            ),
            tables.delays(rows),
            "![Success rate against latency](../evaluation_latency.png)",
        ]
    )
