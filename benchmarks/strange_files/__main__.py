"""Strange files of robots, objects, textures and light: each is read as it is meant, or refused in
one line.

python -m benchmarks.strange_files [NAME ...]

Every case is read as `robots add`, `objects add` and recipes read it, in a child process with
limits. Prints the processor seconds, and the line of a refusal. It fails for a wrong value, a line
that is none, more than PATIENCE seconds, and for a file beside the case's own folder that is read,
written or removed.
"""

import argparse
import os
import re
import resource
import sys
import tempfile
from pathlib import Path

from benchmarks.strange_files.directories import DIRECTORY_CASES
from benchmarks.strange_files.making import OLD, bomb
from benchmarks.strange_files.meshes import MESH_CASES
from benchmarks.strange_files.robots import ROBOT_CASES
from pipeline.data.errors import DominoError
from pipeline.data.process.limited import LimitError, Limits, run_limited
from pipeline.data.setup.brought import bring_light, bring_textures
from pipeline.world.objects.from_files import ObjectError

PATIENCE = 30.0  # processor seconds of a case
LIMITS = Limits(memory=1 << 30, processor=45, wall=120.0, file=64 << 30)
CASES = ROBOT_CASES + MESH_CASES + DIRECTORY_CASES


def unchanged(place: Path) -> str:
    """What the files of a folder are, with the time at which each was last read."""
    found = []
    for path in sorted(p for p in place.rglob("*") if p.is_file()):
        state = path.stat()
        found.append((path.name, state.st_size, state.st_atime, state.st_mtime))
    return repr(found)


def read_case(number: int, folder: Path) -> tuple[bool, str]:
    """The child's side: whether a case gives its value, and what it gives in short."""
    case = CASES[number]
    value = case.read(folder)
    return (
        not case.words and bool(case.judge(value)),
        f"{type(value).__name__}: {getattr(value, 'notes', '')}"[:120],
    )


def check(number: int, folder: Path) -> tuple[bool, str]:
    """Whether a case does what it should, and its line or value."""
    case = CASES[number]
    try:
        return run_limited(str(folder / "file"), read_case, number, folder, limits=LIMITS)
    except (DominoError, ObjectError) as error:
        line = str(error)
        good = (
            bool(case.words)
            and re.search(case.words, line) is not None
            and "\n" not in line
            and len(line) < 700
        )
        return (
            good or (bool(case.words) and isinstance(error, LimitError) and case.name in BOUNDED),
            line,
        )


BOUNDED = (
    "MJCF of 10^8 replicas",
    "MJCF with a field of 200000^2",
    "PLY of 10^10 vertices",
    "OFF of 10^9 faces",
)
"""Cases that a limit of the child may end."""


def images(place: Path) -> list[tuple[str, bool, str]]:
    """The cases of textures and light, which start a child of their own."""
    (place / "table").mkdir()
    (place / "table" / "bomb.png").write_bytes(bomb())
    (place / "sky.hdr").write_bytes(
        b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 100000 +X 200000\n" + bytes(1000)
    )
    found = []
    for name, bring, given in (
        ("PNG bomb", bring_textures, place),
        ("HDR bomb", bring_light, place / "sky.hdr"),
    ):
        try:
            found.append((name, False, repr(bring(str(given)))))
        except DominoError as error:
            found.append((name, "make it smaller" in str(error), str(error)))
    return found


def spent() -> float:
    """Processor seconds of the children that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def notes_reads(place: Path) -> bool:
    """Whether the file system keeps when a file was last read."""
    probe = place / "probe"
    probe.write_bytes(b"1")
    os.utime(probe, (OLD, OLD + 1))
    probe.read_bytes()
    seen = probe.stat().st_atime > OLD
    probe.unlink()
    return seen


def main() -> None:
    """Print every case, and end with 1 if one is wrong."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*")
    chosen = parser.parse_args().names
    wrong = 0
    with tempfile.TemporaryDirectory() as top:
        elsewhere = Path(top)
        reads = (
            "unread" if notes_reads(elsewhere) else "perhaps read: this file system does not tell"
        )
        for name in ("secret.stl", "secret.bin", "secret.png", "secret.mtl"):
            (elsewhere / name).write_bytes(b"newmtl a\nKd 1 0 0\n" + bytes(100))
            os.utime(elsewhere / name, (OLD, OLD + 1))
        before = unchanged(elsewhere)
        results = []
        for number, case in enumerate(CASES):
            if not chosen or any(name in case.name for name in chosen):
                folder = elsewhere / f"case{number}" / "in"
                folder.mkdir(parents=True)
                began = spent()
                good, line = check(number, folder)
                results.append(
                    (case.name, good and spent() - began < PATIENCE, line, spent() - began)
                )
                print(
                    f"{'ok  ' if results[-1][1] else 'FAIL'} {results[-1][3]:5.1f} s  {case.name}:"
                    f" {line.replace(top, '')[:150]}",
                    flush=True,
                )
                remove(folder)
        place = elsewhere / "images"
        place.mkdir()
        for name, good, line in images(place) if not chosen else ():
            results.append((name, good, line, 0.0))
            print(f"{'ok  ' if good else 'FAIL'}          {name}: {line.replace(top, '')[:150]}")
        remove(place)
        wrong = sum(not good for _, good, _, _ in results)
        kept = unchanged(elsewhere) == before
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss >> 10
    print(
        f"{len(results)} cases, {wrong} wrong, files elsewhere"
        f" {f'as they were, {reads}' if kept else 'TOUCHED'}, at most {peak} MB"
    )
    sys.exit(bool(wrong) or not kept)


def remove(folder: Path) -> None:
    """Remove a case's folder and the one above it."""
    import shutil

    shutil.rmtree(folder)
    if folder.name == "in":
        folder.parent.rmdir()


if __name__ == "__main__":
    main()
