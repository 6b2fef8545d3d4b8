"""status, verify, doctor, diff, merge, gc: what a dataset holds, whether it is whole, and what else
is done with datasets."""

import json
import sys
from collections import Counter
from dataclasses import asdict
from itertools import islice
from pathlib import Path
from typing import Annotated

import typer

from pipeline.crew.contract import Crew
from pipeline.data.dataset import EDITED, Dataset

from .common import (
    AsJson,
    Executor,
    Quiet,
    Root,
    Workers,
    argument,
    crew_of,
    number,
    option,
    print_result,
    shorten,
)
from .options import Trust

FEW = 50  # slots that are judged sooner than workers are started


def status(
    dataset: Root,
    rebuild: Annotated[
        bool, option("Read the index again from all files first.", "--rebuild")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Show what a dataset holds and what went wrong."""
    from pipeline.data.atomic import exclusive
    from pipeline.data.slots.reread import rebuild_index
    from pipeline.run.state import redo_lines
    from pipeline.run.state import status as run_status
    from pipeline.stages.reasons import Reason

    source = Dataset(dataset)
    if rebuild:
        recipe = source.recipe()
        with exclusive(source.root):
            rebuild_index(source, recipe).close()
    values = run_status(source)
    lines = [f"{source.manifest}: {EDITED}"] if values["edited"] else []
    lines += [
        f"{path:60} {c['accepted']:5} of {c['wanted']:5}, {c['given_up']} given up, {c['attempts']}"
        " attempts"
        for path, c in values["cells"].items()
    ]
    lines += redo_lines(values["redo"])
    rate = values["attempt_success"]
    lines.append(
        f"{values['accepted']} of {values['wanted']} accepted, {values['given_up']} given up,"
        f" {values['open']} open; {values['attempts']} attempts"
        + (f", {100 * rate:.0f} % succeed" if rate is not None else "")
    )
    if pairs := values["pairs"]:
        lines.append(
            f"paired scenes: {pairs['scenes']}, finished in every cell: {pairs['finished']}, the"
            f" same in every cell: {pairs['complete']}"
        )
    lines += [f"  {Reason(**failure).describe()}" for failure in values["failures"]] or [
        "  no attempt failed"
    ]
    print_result(values, as_json, "\n".join(lines))


def verify(
    dataset: Root,
    executor: Executor = "auto",
    workers: Workers = None,
    again: Annotated[
        int,
        number(0, 1_000_000, "Random episodes to simulate again and compare with those stored."),
    ] = 0,
    episode: Annotated[
        str | None, option("Check this one only and simulate it again: its path below episodes/.")
    ] = None,
    trust: Trust = False,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Check every file of a dataset against what was written; exit code 1 if one differs, or cannot
    be made again."""
    from pipeline.run.checks.verify import verify as run_verify

    source = Dataset(dataset)
    crew = crew_of(executor, workers, None)
    if executor == "auto" and workers is None:
        few = episode or not any(islice(source.recipe().slots(), FEW, None))
        crew = Crew() if few else crew
    values = run_verify(source, crew, not quiet and not as_json, again, trust, episode)
    problems = values["problems"]
    lines = [*shorten(problems), *values["again"]]
    if missing := again - len(values["again"]):
        lines.append(
            f"{missing} of {again} episodes are not made again: no others are sound and of this"
            " version of code and packages"
        )
    sound = "sound" if values["ok"] else "no problem found"
    verdict = f"{len(problems)} problems" if problems else sound
    verdict += f": {values['files']} files, {values['episodes']} sound episodes"
    if values["open"]:
        verdict += f", {values['open']} slots not built yet"
    if values["stale"]:
        verdict += f", {values['stale']} made by another version of code or recipe, see status"
    print_result(values, as_json, "\n".join([*lines, verdict]))
    if not values["ok"]:
        raise typer.Exit(1)


def doctor(
    out: Annotated[Path, option("Directory for datasets.")] = Path(), as_json: AsJson = False
) -> None:
    """Check whether this machine can build; exit code 1 if it cannot."""
    from pipeline.run.checks.doctor import diagnose

    results = []
    print("examining this machine, about 15 s", file=sys.stderr, flush=True)
    for result in diagnose(out):
        results.append(result)
        if not as_json:
            fix = f"\n      fix: {result.fix}" if result.fix else ""
            print(f"{result.verdict}  {result.name}: {result.detail}{fix}", flush=True)
    counts = Counter(result.verdict for result in results)
    if as_json:
        values = {"ok": not counts["FAIL"], "checks": [vars(result) for result in results]}
        print(json.dumps(values, indent=1))
    else:
        print(", ".join(f"{counts[verdict]} {verdict}" for verdict in ("PASS", "WARN", "FAIL")))
    if counts["FAIL"]:
        raise typer.Exit(1)


def diff(
    a: Annotated[Path, argument("A dataset directory.", metavar="A")],
    b: Annotated[Path, argument("Another dataset directory.", metavar="B")],
    as_json: AsJson = False,
) -> None:
    """List the slots of two datasets that differ, and why; exit code 1 if any do."""
    from pipeline.run.manage.diff import Difference
    from pipeline.run.manage.diff import diff as run_diff

    values = run_diff(Dataset(a), Dataset(b))
    lines = [
        *(f"recipe: {change}" for change in values["recipes"]),
        *shorten([Difference(**each).describe() for each in values["differ"]]),
        *(f"{count} slots: {reason}" for reason, count in values["why"].items()),
        f"{values['same']} slots are the same, {len(values['differ'])} differ",
    ]
    print_result(values, as_json, "\n".join(lines))
    if values["differ"]:
        raise typer.Exit(1)


def merge(
    datasets: Annotated[
        list[Path], argument("Two or more dataset directories of one recipe.", metavar="A B")
    ],
    out: Annotated[Path, option("Directory of the new dataset; rerun the same command to resume.")],
    as_json: AsJson = False,
) -> None:
    """Join datasets of one recipe and one version of the code."""
    from pipeline.run.manage.merge import merge as run_merge

    merged = run_merge([Dataset(path) for path in datasets], Dataset(out))
    taken = zip(merged.taken, datasets, strict=True)
    text = (
        f"{merged.accepted} of {merged.slots} episodes in {out} ({merged.given_up} given up;"
        f" {', '.join(f'{count} from {path}' for count, path in taken)})"
    )
    print_result(asdict(merged), as_json, text)


def gc(
    dataset: Root,
    dry_run: Annotated[bool, option("Only list what would be removed.", "--dry-run")] = False,
    as_json: AsJson = False,
) -> None:
    """Remove damaged episodes of no slot, annotations of no episode, assets of no episode, and
    partial files.

    Whole episodes of no slot go to DATASET/orphans."""
    from pipeline.run.manage.gc import WHOLE, collect

    orphans = collect(Dataset(dataset), dry_run)
    removed = [orphan for orphan in orphans if orphan.why != WHOLE]
    lines = shorten([f"{orphan.path}: {orphan.why}" for orphan in orphans])
    would = "would be" if dry_run else "were"
    if moved := len(orphans) - len(removed):
        where = Dataset(dataset).orphans
        lines.append(f"{moved} whole episodes of no slot {would} moved to {where}")
    size = sum(orphan.size for orphan in removed) / 1e6
    lines.append(f"{len(removed)} files, {size:.1f} MB, {would} removed")
    values = {"removed": not dry_run, "files": [asdict(orphan) for orphan in orphans]}
    print_result(values, as_json, "\n".join(lines))
