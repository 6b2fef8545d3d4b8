"""diff, merge, gc: datasets compared, joined and cleaned."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from pipeline.commands.common import AsJson, Root, print_result
from pipeline.data.dataset import Dataset

SHOWN = 40  # lines of a list that are printed for a person; --json prints all


def diff(
    a: Annotated[Path, typer.Argument(help="A dataset directory.", metavar="A")],
    b: Annotated[Path, typer.Argument(help="Another dataset directory.", metavar="B")],
    as_json: AsJson = False,
) -> None:
    """List the slots of two datasets that differ, and why; exit code 1 if any do."""
    from pipeline.run.diff import Difference
    from pipeline.run.diff import diff as run_diff

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
    from pipeline.run.merge import merge as run_merge

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
    from pipeline.run.gc import WHOLE, collect

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
