"""status, verify, doctor: what a dataset holds, whether it is whole, and whether this machine can
build."""

import json
import sys
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
SHOWN = 40  # problems that are printed for a person; --json prints all


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
    from pipeline.run.verify import verify as run_verify

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
    from pipeline.run.doctor import diagnose

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
