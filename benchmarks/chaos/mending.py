"""Every kind of damage of docs/measurements/corruption.md, repaired by its command.

    python -m benchmarks.chaos.mending [--only TEXT] [--folder DIR]

A dataset of two episodes with flow maps and exports is made by the real commands. For each kind of damage, a copy of it is damaged,
`verify` must find it, and the named command must exit with 0. Then `verify` must find nothing, and every file must have the bytes
of the undamaged dataset. Where the page names `you`, a file is removed or put back, as the message says, and the build resumed.
`--only` takes the kinds whose file or damage contains the text. Exit code 1 where one is not repaired.
"""

import argparse
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import yaml

from benchmarks.chaos.compare import compare
from benchmarks.chaos.exports import GIVEN
from benchmarks.hardware import hardware
from pipeline.export.shared.record import SUMMARY
from pipeline.world.drawing.vulkan import ensure_renderer
from tests.run.command import inside
from tests.run.damage import ANNOTATE, BUILD, EPISODE, EXPORT, LEDGER_FILE, USER, Kind
from tests.run.damages import KINDS
from tests.run.test_corruption import FORMATS, RECIPE, place_of

MANIFEST = "recipe.yaml"
INLINE = ("--executor", "inline", "--quiet")

PATIENCE = 300
"""Seconds that one kind may take."""


def run(*arguments: object) -> str:
    """A command in this process; the last lines that it printed, empty where it ended with exit code 0."""
    code, out, err = inside(*arguments)
    lines = [line for line in (err or out).splitlines() if not line.startswith("ok ")]
    return f"exit code {code}: {' / '.join(lines[-4:])}" if code else ""


def make(folder: Path) -> Path:
    """The undamaged dataset. Raises SystemExit where a command fails."""
    dataset = folder / "whole"
    (folder / MANIFEST).write_text(yaml.safe_dump(RECIPE.model_dump(mode="json", exclude_defaults=True)))
    commands = [COMMANDS[by](dataset, "") for by in (BUILD, ANNOTATE)]
    commands += [COMMANDS[EXPORT](dataset, f"exports/{name}/") for name in FORMATS]
    for command in commands:
        if said := run(*command):
            raise SystemExit(f"{command}: {said}")
    return dataset


def format_of(file: str) -> tuple[str, ...]:
    """Options that name the format of a file of an export."""
    name = file.split("/")[1]
    return ("--format", name, *GIVEN.get(name, ()))


COMMANDS: dict[str, Callable[[Path, str], tuple[object, ...]]] = {
    BUILD: lambda dataset, _: ("build", "--manifest", dataset.parent / MANIFEST, "--out", dataset, *INLINE),
    ANNOTATE: lambda dataset, _: ("annotate", dataset, "--stages", "flow", "--quiet"),
    EXPORT: lambda dataset, file: ("export", dataset, *format_of(file), "--workers", "1", "--quiet"),
}


def copy(kind: Kind, whole: Path, to: Path) -> Path:
    """The dataset with those of its exports that the damage is about."""
    named = kind.file.split("/")[1] if kind.file.startswith("exports/") else ""
    others = [path for path in (whole / "exports").iterdir() if path.name != named]
    return Path(shutil.copytree(whole, to, ignore=lambda place, _: [p.name for p in others if Path(place) == p.parent]))


def by_hand(kind: Kind, whole: Path, dataset: Path, path: Path) -> str:
    """What the messages ask a user to do, then the build; the first thing that fails.

    An episode whose entry does not fit and an export that no longer says what it is are removed and made again. Another file is put
    back from a copy of the dataset, or removed where it never was a part of it.
    """
    commands = [COMMANDS[BUILD](dataset, "")]
    if kind.file == LEDGER_FILE:
        (dataset / EPISODE).unlink()
    elif path.name == SUMMARY:
        shutil.rmtree(path.parent)
        commands.append(COMMANDS[EXPORT](dataset, kind.file))
    else:
        path.unlink(missing_ok=True)
        if (kept := whole / path.relative_to(dataset)).exists():
            shutil.copy2(kept, path)
    return next(filter(None, (run(*command) for command in commands)), "")


def trial(kind: Kind, whole: Path, folder: Path) -> str:
    """Damage a copy and repair it; what is not as promised, empty where all is."""
    reference, dataset = (copy(kind, whole, folder / name) for name in ("reference", "damaged"))
    shutil.copy(whole.parent / MANIFEST, folder)
    path, _ = place_of(kind, dataset)
    kind.damage(path)
    verify = ("verify", dataset, *INLINE, "--draw", kind.draw)
    if not run(*verify):
        return "verify finds nothing"
    said = by_hand(kind, reference, dataset, path) if kind.by == USER else run(*COMMANDS[kind.by](dataset, kind.file))
    if said:
        return f"{kind.by}: {said}"
    if said := run(*verify):
        return f"verify after {kind.by}: {said}"
    found = compare(reference, dataset)
    return "" if found.identical else f"not as before: {vars(found)}"


def within(seconds: int, work: Callable[[], str]) -> str:
    """What `work` returns, or that it did not end in time or raised."""

    def late(*_: object) -> None:
        raise TimeoutError(f"not done after {seconds} s")

    signal.signal(signal.SIGALRM, late)
    signal.alarm(seconds)
    try:
        return work()
    except Exception as error:  # noqa: BLE001 - whatever a command raises is a failure of this kind alone
        return f"{type(error).__name__}: {error}"
    finally:
        signal.alarm(0)


def main() -> None:
    """Try all kinds, print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="")
    parser.add_argument("--folder", type=Path, help="where to work; kept afterwards")
    given = parser.parse_args()
    folder = given.folder or Path(tempfile.mkdtemp(prefix="mending-"))
    folder.mkdir(exist_ok=True)
    whole = folder / "whole"
    if not whole.exists():
        make(folder)
    tried, wrong, start = Counter[str](), Counter[str](), time.monotonic()
    for kind in (k for k in KINDS if given.only in f"{k.file}: {k.what}"):
        with tempfile.TemporaryDirectory(dir=folder) as place:
            said = within(PATIENCE, lambda kind=kind, place=place: trial(kind, whole, Path(place)))
        tried[kind.by] += 1
        if said:
            wrong[kind.by] += 1
            print(f"{kind.file}: {kind.what}: {said}", file=sys.stderr, flush=True)
    print(f"{hardware(ensure_renderer())}; {time.monotonic() - start:.0f} s\n")
    print("| repaired by | kinds | not as promised |\n|---|---:|---:|")
    for by in (BUILD, ANNOTATE, EXPORT, USER):
        print(f"| {by} | {tried[by]} | {wrong[by]} |")
    if not given.folder:
        shutil.rmtree(folder)
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
