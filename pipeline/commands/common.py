"""What the verbs share: options, printing, and the crew that options describe."""

import json
import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, cast

import typer

from pipeline.crew.contract import EXECUTORS, Crew, pick_executor
from pipeline.crew.progress import SHOWN, Kind
from pipeline.crew.signals import Stopped, stop_on_signal
from pipeline.data.dataset import Dataset
from pipeline.data.errors import DominoError
from pipeline.data.intact import missed
from pipeline.data.parsing import ParseError, read_mapping, show_value
from pipeline.data.process.own_code import Finding
from pipeline.data.reading import printable
from pipeline.data.recipe.model import Recipe
from pipeline.data.store.place import with_urls

GIVEN_UP = 3
"""Exit code of a build that gave slots up (docs/quickstart.md)."""

MOST_WORKERS = 10_000

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON for a program to read.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="Show no progress.")]
Root = Annotated[
    Path,
    typer.Argument(help="The dataset, a directory or URL (docs/storage.md).", metavar="DATASET"),
]


class UsageError(DominoError):
    """Bad input that no other error describes."""


def print_result(values: Any, as_json: bool, text: str) -> None:
    """Print JSON for a program, or text for a person."""
    lines = with_urls(json.dumps(values, indent=1) if as_json else text).split("\n")
    print("\n".join(map(printable, lines)))  # files of others name what a terminal would obey


def at_terminal() -> bool:
    """Whether a person types here and can end the command by Ctrl-C."""
    streams = (sys.stdin, sys.stdout)
    return not os.environ.get("CI") and all(stream and stream.isatty() for stream in streams)


def has_screen() -> bool:
    """Whether a browser with windows can open here: one for the terminal would take it over."""
    wanted = ("DISPLAY", "WAYLAND_DISPLAY")
    return sys.platform in ("darwin", "win32") or any(os.environ.get(name) for name in wanted)


def table(headers: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Rows under their headers, columns as wide as their longest entry."""
    lines = [list(map(str, line)) for line in (headers, *rows)]
    right = [
        all(line[i].replace(".", "", 1).isdigit() for line in lines[1:])
        for i in range(len(headers))
    ]
    wide = [max(len(line[i]) for line in lines) for i in range(len(headers))]
    shown = []
    for line in lines:
        cells = zip(line, wide, right, strict=True)
        shown.append("  ".join(t.rjust(n) if number else t.ljust(n) for t, n, number in cells))
    return "\n".join(line.rstrip() for line in shown)


def warn_of_stale(dataset: Dataset, recipe: Recipe) -> None:
    """Warn of episodes that are of another version of code or recipe."""
    from pipeline.run.names import missing_names
    from pipeline.run.state import DONE, OPEN, states

    if missing := missing_names(recipe):
        return _warn(
            f"{missing} is not installed: give --plugins with its directory to learn whether the"
            " episodes are of this version of code and recipe"
        )
    stale = sum(
        state.todo not in (DONE, OPEN) and bool(state.accepted)
        for _, state in states(dataset, recipe)
    )
    if stale:
        _warn(
            f"{stale} episodes are of another version of code or recipe and are used as they are;"
            f" `domino-data status {with_urls(str(dataset.root))}` shows what changed"
        )


def warn_of_missing(dataset: Dataset, recipe: Recipe) -> None:
    """Warn of finished episodes that are missing."""
    if missing := dataset.missing(recipe):
        _warn(with_urls(missed(missing)))


def warn_of_pattern(path: Path) -> None:
    """Warn of a path in which other libraries see a pattern."""
    if set("[]*?") & set(str(path.absolute())):
        _warn(
            f"{path}: `datasets` and other readers take [ ] * ? in a path for a pattern and find no"
            " files there: choose another name"
        )


def _warn(text: str) -> None:
    print(f"domino-data: warning: {text}", file=sys.stderr)


@contextmanager
def resumable(out: Path) -> Iterator[None]:
    """End the command with one line and exit code 130 if a signal stops the work."""
    try:
        with stop_on_signal():
            yield
    except Stopped:
        print(
            f"stopped; finished work is in {with_urls(str(out))}; rerun the same command to resume",
            file=sys.stderr,
        )
        raise typer.Exit(130) from None


def split_list(text: str | None) -> list[str] | None:
    """A comma-separated option as a list."""
    return None if text is None else [part.strip() for part in text.split(",") if part.strip()]


def numbers[T](text: str | None, parse: Callable[[str], T], option: str) -> list[T] | None:
    """A comma-separated option as numbers. Raises UsageError."""
    try:
        return None if text is None else [parse(part) for part in split_list(text) or []]
    except ParseError as error:
        raise UsageError(
            f"{option} {show_value(text)} is not a list of numbers like 1,2,3"
        ) from error


Executor = Annotated[
    str,
    typer.Option(help="inline, ray or auto (inline for one worker, or a build of two episodes)."),
]
Workers = Annotated[
    int | None,
    typer.Option(min=1, max=MOST_WORKERS, help="Worker processes.", show_default="all cores"),
]
Address = Annotated[
    str | None, typer.Option(help="A running Ray cluster to work on, host:port (docs/cluster.md).")
]
Gpus = Annotated[
    float | None,
    typer.Option(
        min=0.001,
        max=64,
        help="Each worker's share of a GPU, e.g. 0.25 if four workers share one (docs/cluster.md).",
        show_default="none",
    ),
]
RuntimeEnv = Annotated[
    Path | None,
    typer.Option(
        help=(
            "A YAML or JSON file with Ray's runtime_env for the processes on the nodes of"
            " --address."
        )
    ),
]


def check_file(path: Path | None, option: str, kind: str, suffix: str) -> None:
    """Raise UsageError for the place of a page, an image or a film with another suffix."""
    if path is not None and path.suffix != suffix:
        raise UsageError(f"{option} {path}: is not the name of {kind}: let it end in {suffix}")


def kind_of(progress: str) -> Kind:
    """How progress is shown, by its name."""
    if progress not in SHOWN:
        raise UsageError(f"--progress {progress!r} is unknown: choose {', '.join(SHOWN)}")
    return cast(Kind, progress)


def crew_of(
    executor: str,
    workers: int | None,
    address: str | None,
    gpus: float | None = None,
    runtime_env: Path | None = None,
    jobs: int | None = None,
) -> Crew:
    """The workers that the options select for a number of jobs; an address selects Ray."""
    if address is not None and executor == "inline":
        raise UsageError(
            "--address names a Ray cluster and --executor inline uses none: leave one of them out"
        )
    if address is not None and not re.fullmatch(r"[A-Za-z0-9._-]{1,253}:[0-9]{1,5}", address):
        raise UsageError(f"--address {show_value(address)} is not HOST:PORT, e.g. 10.0.0.1:6379")
    if executor not in EXECUTORS:
        raise UsageError(f"--executor {executor!r} is unknown: choose {', '.join(EXECUTORS)}")
    name, count = pick_executor("ray" if address else executor, workers, jobs)
    return Crew(name, count, address, gpus=gpus or 0.0, runtime_env=runtime_env_of(runtime_env))


def runtime_env_of(path: Path | None) -> dict[str, Any]:
    """Ray's runtime_env from a file; empty without one. Raises UsageError in one line."""
    if path is None:
        return {}
    try:
        values = read_mapping(path, "env_vars: {NAME: value}")
    except ParseError as error:
        raise UsageError(f"--runtime-env {error}") from error
    variables = values.get("env_vars", {})
    if not isinstance(variables, dict) or not all(
        isinstance(word, str) for pair in variables.items() for word in pair
    ):
        raise UsageError(
            f"--runtime-env {path}: env_vars is not a mapping of names to texts, like {{NAME:"
            " 'value'}"
        )
    return values


def print_findings(findings: Mapping[str, Sequence[Finding]], as_json: bool) -> None:
    """Print what checks found, by name. Raises typer.Exit(1) if a clause does not hold."""
    lines = [
        f"{'ok  ' if f.ok else 'FAIL'} {name}: {f.name}: {f.detail}"
        for name, all_of in findings.items()
        for f in all_of
    ]
    values = {name: [vars(f) for f in all_of] for name, all_of in findings.items()}
    print_result(values, as_json, "\n".join(lines))
    if not all(f.ok for all_of in findings.values() for f in all_of):
        raise typer.Exit(1)
