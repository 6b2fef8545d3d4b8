"""Shared options, printing, and the crew of the options."""

import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from pipeline.crew.contract import Crew, pick_executor
from pipeline.crew.signals import Stopped, stop_on_signal
from pipeline.data.errors import DominoError
from pipeline.data.parsing import ParseError, read_mapping, show_value
from pipeline.data.process.own_code import Finding
from pipeline.data.reading import printable
from pipeline.data.store.place import with_urls

GIVEN_UP = 3
"""Exit code of a build that gave slots up (docs/quickstart.md)."""

MOST_WORKERS = 10_000
SHOWN = 40  # lines of a list that are printed for a person; --json prints all


def option(text: str, *names: str, **more: Any) -> Any:
    """An option with this help."""
    return typer.Option(*names, help=text, **more)


def number(low: float, high: float, text: str, *names: str, **more: Any) -> Any:
    """An option that is a number within bounds."""
    return typer.Option(*names, min=low, max=high, help=text, **more)


def argument(text: str, **more: Any) -> Any:
    """An argument with this help."""
    return typer.Argument(help=text, **more)


AsJson = Annotated[bool, option("Print JSON for a program to read.", "--json")]
Quiet = Annotated[bool, option("Show no progress.", "--quiet")]
Root = Annotated[
    Path, argument("The dataset, a directory or URL (docs/storage.md).", metavar="DATASET")
]
Executor = Annotated[
    Literal["auto", "inline", "ray"],
    option("auto is inline for one worker, or a build of two episodes."),
]
Workers = Annotated[
    int | None, number(1, MOST_WORKERS, "Worker processes.", show_default="all cores")
]
Address = Annotated[
    str | None, option("A running Ray cluster to work on, host:port (docs/cluster.md).")
]
Gpus = Annotated[
    float | None,
    number(
        0.001,
        64,
        "Each worker's share of a GPU, e.g. 0.25 if four workers share one (docs/cluster.md).",
        show_default="none",
    ),
]
RuntimeEnv = Annotated[
    Path | None, option("A YAML or JSON file: Ray's runtime_env for the processes of --address.")
]


class UsageError(DominoError):
    """Bad input that no other error describes."""


def names_nothing(option: str, given: str) -> UsageError:
    """The error of a list without names."""
    return UsageError(
        f"{option} {given!r} names nothing: leave it out, or name some, separated by commas"
    )


def print_result(values: Any, as_json: bool, text: str) -> None:
    """Print JSON for a program, or text for a person."""
    lines = with_urls(json.dumps(values, indent=1) if as_json else text).split("\n")
    print("\n".join(map(printable, lines)))  # files of others name what a terminal would obey


def note(text: str) -> None:
    """Print a line for a person on standard error."""
    print(f"domino-data: {text}", file=sys.stderr)


def shorten(lines: Sequence[str]) -> list[str]:
    """The first SHOWN lines, and how many more there are."""
    more = len(lines) - SHOWN
    return [*lines[:SHOWN], *([f"and {more} more (--json prints all)"] if more > 0 else [])]


def at_terminal() -> bool:
    """Whether a person types here and can end the command by Ctrl-C."""
    streams = (sys.stdin, sys.stdout)
    return not os.environ.get("CI") and all(stream and stream.isatty() for stream in streams)


def has_screen() -> bool:
    """Whether a browser with windows can open here: one for the terminal would take it over."""
    screens = ("DISPLAY", "WAYLAND_DISPLAY")
    return sys.platform in ("darwin", "win32") or any(os.environ.get(name) for name in screens)


def table(headers: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Rows under their headers, columns as wide as their longest entry, numbers to the right."""
    columns = [list(map(str, column)) for column in zip(headers, *rows, strict=True)]
    for column in columns:
        width = max(map(len, column))
        numbers = all(text.replace(".", "", 1).isdigit() for text in column[1:])
        column[:] = [text.rjust(width) if numbers else text.ljust(width) for text in column]
    return "\n".join("  ".join(line).rstrip() for line in zip(*columns, strict=True))


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


def numbers[T](text: str | None, parse: Callable[[str], T], option: str) -> tuple[T, ...]:
    """A comma-separated option as numbers. Raises UsageError."""
    try:
        return tuple(parse(part) for part in split_list(text) or ())
    except ParseError as error:
        raise UsageError(
            f"{option} {show_value(text)} is not a list of numbers like 1,2,3"
        ) from error


def check_file(path: Path | None, option: str, kind: str, suffix: str) -> None:
    """Raise UsageError for the place of a page, an image or a film with another suffix."""
    if path is not None and path.suffix != suffix:
        raise UsageError(f"{option} {path}: is not the name of {kind}: let it end in {suffix}")


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
        raise UsageError("--executor inline does not use the cluster of --address: leave one out")
    name, count = pick_executor("ray" if address else executor, workers, jobs)
    environment = read_mapping(runtime_env, "env_vars: {NAME: value}") if runtime_env else {}
    return Crew(name, count, address, gpus=gpus or 0.0, runtime_env=environment)


def print_findings(findings: Mapping[str, Sequence[Finding]], as_json: bool) -> None:
    """Print what checks found, by name. Raises typer.Exit(1) if a clause does not hold."""
    each = [(name, finding) for name, all_of in findings.items() for finding in all_of]
    lines = [f"{'ok  ' if f.ok else 'FAIL'} {name}: {f.name}: {f.detail}" for name, f in each]
    values = {name: [vars(finding) for finding in all_of] for name, all_of in findings.items()}
    print_result(values, as_json, "\n".join(lines))
    if not all(finding.ok for _, finding in each):
        raise typer.Exit(1)
