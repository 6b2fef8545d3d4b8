"""doctor: whether this machine can build, export and annotate, and how to fix what is missing."""

from pathlib import Path
from typing import Annotated

import typer

from pipeline.commands.common import AsJson


def doctor(
    out: Annotated[Path, typer.Option(help="Directory for datasets.")] = Path(),
    as_json: AsJson = False,
) -> None:
    """Check whether this machine can build; exit code 1 if it cannot."""
    import json
    import sys

    from pipeline.run.doctor import diagnose

    results = []
    print("examining this machine, about 15 s", file=sys.stderr, flush=True)
    for result in diagnose(out):
        results.append(result)
        if not as_json:
            print(f"{result.verdict}  {result.name}: {result.detail}", flush=True)
            if result.fix:
                print(f"      fix: {result.fix}", flush=True)
    counts = {verdict: sum(r.verdict == verdict for r in results) for verdict in ("PASS", "WARN", "FAIL")}
    if as_json:
        print(json.dumps({"ok": not counts["FAIL"], "checks": [vars(r) for r in results]}, indent=1))
    else:
        print(", ".join(f"{count} {verdict}" for verdict, count in counts.items()))
    if counts["FAIL"]:
        raise typer.Exit(1)
