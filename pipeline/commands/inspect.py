"""status, verify, doctor, diff, merge, gc: what a dataset holds, whether it is whole, and what else
is done with datasets."""

import json
import sys
from dataclasses import asdict
from itertools import islice
from pathlib import Path
from typing import Annotated

import typer

from pipeline.commands.common import AsJson, Executor, Quiet, Root, Workers, crew_of, print_result
from pipeline.commands.options import Trust
from pipeline.crew.contract import Crew
from pipeline.data.dataset import EDITED, Dataset

FEW = 50  # slots that are judged sooner than workers are started
MOST_AGAIN = 1_000_000
SHOWN = 40  # lines of a list that are printed for a person; --json prints all


def status(
    dataset: Root,
    rebuild: Annotated[
        bool, typer.Option("--rebuild", help="Read the index again from all files first.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Show what a dataset holds and what went wrong."""
    from pipeline.data.atomic import exclusive
    from pipeline.data.slots.reread import rebuild_index
    from pipeline.run.state import redo_lines
    from pipeline.run.status import status as run_status
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
    lines += [
        f"{s['cell']} is stopped, {s['slots']} slots are not tried: {s['because']}"
        for s in values["stopped"]
    ]
    if pairs := values["pairs"]:
        share = (
            f" ({100 * pairs['complete'] / pairs['finished']:.0f} %)" if pairs["finished"] else ""
        )
        lines.append(
            f"paired scenes: {pairs['scenes']}, finished in every cell: {pairs['finished']}, the"
            f" same in every cell: {pairs['complete']}{share}"
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
        typer.Option(
            min=0,
            max=MOST_AGAIN,
            help="Random episodes to simulate again and compare with those stored.",
        ),
    ] = 0,
    episode: Annotated[
        str | None,
        typer.Option(help="Check this one only and simulate it again: its path below episodes/."),
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
    if (
        executor == "auto"
        and workers is None
        and (episode or not any(islice(source.recipe().slots(), FEW, None)))
    ):
        crew = Crew()
    values = run_verify(source, crew, not quiet and not as_json, again, trust, episode)
    problems = values["problems"]
    lines = problems[:SHOWN] + [f"and {len(problems) - SHOWN} more (--json prints all)"] * (
        len(problems) > SHOWN
    )
    lines += values["again"]
    if missing := again - len(values["again"]):
        lines.append(
            f"{missing} of {again} episodes are not made again: no others are sound and of this"
            " version of code and packages"
        )
    verdict = (
        f"{len(problems)} problems" if problems else "sound" if values["ok"] else "no problem found"
    )
    verdict += f": {values['files']} files, {values['episodes']} sound episodes"
    verdict += f", {values['open']} slots not built yet" if values["open"] else ""
    verdict += (
        f", {values['stale']} made by another version of code or recipe, see status"
        if values["stale"]
        else ""
    )
    print_result(values, as_json, "\n".join([*lines, verdict]))
    if not values["ok"]:
        raise typer.Exit(1)


def doctor(
    out: Annotated[Path, typer.Option(help="Directory for datasets.")] = Path(),
    as_json: AsJson = False,
) -> None:
    """Check whether this machine can build; exit code 1 if it cannot."""
    from pipeline.run.checks.doctor import diagnose

    results = []
    print("examining this machine, about 15 s", file=sys.stderr, flush=True)
    for result in diagnose(out):
        results.append(result)
        if not as_json:
            print(f"{result.verdict}  {result.name}: {result.detail}", flush=True)
            if result.fix:
                print(f"      fix: {result.fix}", flush=True)
    counts = {
        verdict: sum(r.verdict == verdict for r in results) for verdict in ("PASS", "WARN", "FAIL")
    }
    if as_json:
        print(
            json.dumps({"ok": not counts["FAIL"], "checks": [vars(r) for r in results]}, indent=1)
        )
    else:
        print(", ".join(f"{count} {verdict}" for verdict, count in counts.items()))
    if counts["FAIL"]:
        raise typer.Exit(1)


def diff(
    a: Annotated[Path, typer.Argument(help="A dataset directory.", metavar="A")],
    b: Annotated[Path, typer.Argument(help="Another dataset directory.", metavar="B")],
    as_json: AsJson = False,
) -> None:
    """List the slots of two datasets that differ, and why; exit code 1 if any do."""
    from pipeline.run.manage.diff import Difference
    from pipeline.run.manage.diff import diff as run_diff

    values = run_diff(Dataset(a), Dataset(b))
    lines = [f"recipe: {change}" for change in values["recipes"]]
    lines += [Difference(**d).describe() for d in values["differ"][:SHOWN]]
    lines += (
        [f"and {len(values['differ']) - SHOWN} more (--json prints all)"]
        if len(values["differ"]) > SHOWN
        else []
    )
    lines += [f"{count} slots: {reason}" for reason, count in values["why"].items()]
    lines.append(f"{values['same']} slots are the same, {len(values['differ'])} differ")
    print_result(values, as_json, "\n".join(lines))
    if values["differ"]:
        raise typer.Exit(1)


def merge(
    datasets: Annotated[
        list[Path],
        typer.Argument(help="Two or more dataset directories of one recipe.", metavar="A B"),
    ],
    out: Annotated[
        Path, typer.Option(help="Directory of the new dataset; rerun the same command to resume.")
    ],
    as_json: AsJson = False,
) -> None:
    """Join datasets of one recipe and one version of the code."""
    from pipeline.run.manage.merge import merge as run_merge

    merged = run_merge([Dataset(path) for path in datasets], Dataset(out))
    parts = ", ".join(
        f"{count} from {path}" for count, path in zip(merged.taken, datasets, strict=True)
    )
    print_result(
        asdict(merged),
        as_json,
        f"{merged.accepted} of {merged.slots} episodes in {out} ({merged.given_up} given up;"
        f" {parts})",
    )


def gc(
    dataset: Root,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only list what would be removed.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Remove damaged episodes of no slot, annotations of no episode, assets of no episode, and
    partial files.

    Whole episodes of no slot go to DATASET/orphans."""
    from pipeline.run.manage.gc import WHOLE, collect

    orphans = collect(Dataset(dataset), dry_run)
    lines = [f"{orphan.path}: {orphan.why}" for orphan in orphans[:SHOWN]]
    lines += (
        [f"and {len(orphans) - SHOWN} more (--json prints all)"] if len(orphans) > SHOWN else []
    )
    would, removed = (
        "would be" if dry_run else "were",
        [orphan for orphan in orphans if orphan.why != WHOLE],
    )
    if moved := len(orphans) - len(removed):
        lines.append(
            f"{moved} whole episodes of no slot {would} moved to {Dataset(dataset).orphans}"
        )
    lines.append(
        f"{len(removed)} files, {sum(orphan.size for orphan in removed) / 1e6:.1f} MB, {would}"
        " removed"
    )
    print_result(
        {"removed": not dry_run, "files": [asdict(orphan) for orphan in orphans]},
        as_json,
        "\n".join(lines),
    )
