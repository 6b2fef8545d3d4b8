"""The memory of one worker over consecutive slots of all tasks and robots, levels and domains.

    python -m benchmarks.worker_memory [--slots 200] [--out FILE.md]

One Ray worker, as a build has them, fills slot after slot, each of another task than the one
before; after 175 slots every task was made with every robot. After each slot it says what memory
its process holds: resident, and of that private (neither a shared library nor a mapped file).
Growth is from slot 20, when every robot has been at work, to the last.
"""

import argparse
import re
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from benchmarks.hardware import hardware
from pipeline.crew.contract import Crew, Done
from pipeline.crew.loop import run
from pipeline.data.dataset import Dataset
from pipeline.data.recipe.model import Recipe, Slot
from pipeline.run.build import ATTEMPT_SECONDS
from pipeline.run.names import recipe_from
from pipeline.run.slot.fill import FillJob, fill_slot
from pipeline.world.drawing.renderer import device_of

ROBOTS = ("aloha-agilex", "arx-x5", "franka-panda", "piper", "ur5-wsg")
LEVELS, DOMAINS = (1, 2, 3), ("clean", "randomized")
FIRST = 20
LIMIT_MB, LIMIT_GROWTH = 1000, 0.05


@dataclass(frozen=True)
class MemorySeen:
    """After one slot: the cell it belongs to, attempts, whether it was accepted, and resident,
    private and peak memory in MB."""

    cell: str
    attempts: int
    accepted: bool
    resident: float
    private: float
    peak: float


def memory() -> tuple[float, float, float]:
    """Resident, private and peak memory of this process, in MB (10^6 bytes)."""
    text = Path("/proc/self/smaps_rollup").read_text() + Path("/proc/self/status").read_text()
    kilobytes = {
        name: int(value) for name, value in re.findall(r"^(\w+):\s+(\d+) kB", text, re.MULTILINE)
    }
    private = kilobytes["Private_Clean"] + kilobytes["Private_Dirty"]
    return kilobytes["Rss"] * 1.024e-3, private * 1.024e-3, kilobytes["VmHWM"] * 1.024e-3


def measuring() -> Callable[[FillJob], MemorySeen]:
    """The work of a build's worker, which then looks at its memory."""

    def work(job: FillJob) -> MemorySeen:
        record = fill_slot(job)
        return MemorySeen(job.slot.cell.path, len(record.attempts), record.accepted, *memory())

    return work


def order(recipe: Recipe) -> Iterator[Slot]:
    """Slots without end: the next task every time, the robots in turn so that all pairs come,
    levels and domains in turn."""
    cells = {(c.task, c.embodiment, c.level, c.domain): c for c in recipe.cells()}
    tasks, robots = recipe.tasks, recipe.embodiments
    number = 0
    while True:
        robot = robots[(number + number // len(tasks)) % len(robots)]
        domain = DOMAINS[number // 2 % len(DOMAINS)]
        cell = cells[tasks[number % len(tasks)], robot, LEVELS[number % len(LEVELS)], domain]
        yield Slot(cell, number // (len(tasks) * len(robots)))
        number += 1


def measure(count: int) -> list[MemorySeen]:
    """One worker, so many slots."""
    recipe = recipe_from(
        {"embodiments": ROBOTS, "levels": LEVELS, "domains": DOMAINS, "episodes": 1}
    )
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder) / "data"
        Dataset(root).create(recipe)
        slots = order(recipe)
        jobs = deque(FillJob(str(root), recipe, next(slots)) for _ in range(count))
        seconds = ATTEMPT_SECONDS * recipe.attempts
        with closing(run(measuring, jobs, Crew("ray", 1, recycle=count + 1), seconds)) as ends:
            found = []
            for number, end in enumerate(ends, 1):
                assert isinstance(end, Done), end
                found.append(end.result)
                seen = end.result
                print(
                    f"{number} {time.strftime('%H:%M:%S')} {seen.cell} {seen.resident:.0f}"
                    f" {seen.private:.0f}",
                    flush=True,
                )
                Dataset(root).episode(end.job.slot).unlink(missing_ok=True)
            return found


def report(found: list[MemorySeen]) -> str:
    """A Markdown table and the verdict."""
    rows = sorted({n for n in (1, 5, FIRST, 35, 70, 105, 140, 175, len(found)) if n <= len(found)})
    lines = ["| after slots | resident MB | private MB | peak MB |", "|---:|---:|---:|---:|"]
    lines += [
        f"| {n} | {found[n - 1].resident:.0f} | {found[n - 1].private:.0f} |"
        f" {found[n - 1].peak:.0f} |"
        for n in rows
    ]
    start, last = found[min(FIRST, len(found)) - 1], found[-1]
    growth, peak = last.resident / start.resident - 1, max(seen.peak for seen in found)
    attempts, accepted = sum(seen.attempts for seen in found), sum(seen.accepted for seen in found)
    verdict = "holds" if peak < LIMIT_MB and growth < LIMIT_GROWTH else "does NOT hold"
    lines += [
        "",
        (
            f"{len(found)} slots, {attempts} attempts, {accepted} accepted. Peak {peak:.0f} MB,"
            f" growth from slot {FIRST} to {len(found)} {100 * growth:+.1f} %: under {LIMIT_MB} MB"
            f" and {100 * LIMIT_GROWTH:.0f} % {verdict}."
        ),
    ]
    return "\n".join(lines)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--slots", type=int, default=200)
    parser.add_argument("--out", type=Path, help="write the table to this file as well")
    given = parser.parse_args()
    text = f"{hardware(device_of('raster'))}\n\n{report(measure(given.slots))}\n"
    print(text)
    if given.out:
        given.out.write_text(text)


if __name__ == "__main__":
    main()
