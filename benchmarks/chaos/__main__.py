"""A build under a seeded schedule of disturbances, against the same build undisturbed.

    python -m benchmarks.chaos [--slots 510] [--real 24] [--lives 6] [--real-lives 2] [--quick 70] [--seed 1] [--out FILE.md]

Two datasets are built twice, by the real command with Ray workers: `--real` slots of click_bell with small images, all three
stages; and `--slots` of sixty cells whose stages only sleep, fail by lot and hand out one stored episode (chaos/command.py),
around the real keys, notes, logs, files, index, crew and command. The first build is left alone, in one process. The second
runs in lives: in each, workers are killed in every phase, in the middle of writing, and while they start; then the life ends by
killing the driver, Ray's raylet or its control service, by a full disk, or by a signal after which the driver dies while it cleans
up. `--quick` builds in one process follow, each killed in the middle of writing something. Between lives files are truncated and
bits flipped. Bits of the finished real dataset are flipped while lengths and times stay, and `verify` is run. The last life is
left alone. Then everything is compared. The full disk needs the right to mount.
"""

import argparse
import json
import secrets
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from random import Random

from benchmarks.chaos.compare import Comparison, compare
from benchmarks.chaos.harness import Disk, Driver, Fresh, Life, Outcome, Site, damage, decay, live
from benchmarks.chaos.traps import Control
from benchmarks.hardware import hardware
from pipeline.data.dataset import Dataset
from pipeline.world.drawing.vulkan import ensure_renderer

SMALL = ("--render", "raster-fast")
REAL = ("--tasks", "click_bell", "--embodiment", "aloha")
TASKS = (
    "beat_block_hammer,click_alarmclock,click_bell,grab_roller,move_can_pot,"
    "place_fan,place_shoe,rotate_qrcode,stamp_seal,scan_object"
)
STORED = ("--tasks", TASKS, "--embodiment", "aloha,piper", "--attempts", "8")
WORKERS = ("--executor", "ray", "--workers", "2")

IN_LIFE = (
    *("trap worker planning", "trap worker drawing", "trap worker writing"),
    *("trap episode half", "trap episode whole", "trap episode renamed", "trap asset half", "trap asset whole"),
)
ENDS = (
    *("full disk", "raylet", "driver", "terminate attempts whole", "gcs_server", "driver", "raylet", "interrupt"),
    *("terminate attempts half", "driver", "trap provenance half", "terminate provenance whole"),
)
MID_WRITE = (
    *(
        ("episode", "half"),
        ("episode", "whole"),
        ("episode", "renamed"),
        ("asset", "half"),
        ("asset", "whole"),
    ),
    *(("worker", "planning"), ("worker", "drawing")),
)
"""Where a build in one process is killed."""


DECAYED = 6
"""Bits of the finished real dataset that are inverted while lengths and times stay."""


@dataclass(frozen=True)
class Part:
    """One of the two datasets: its name, options, slots, lives, worker disturbances a life, damaged files after a life,
    and how many builds in one process are killed besides."""

    name: str
    options: Sequence[str]
    slots: int
    lives: int
    each: int
    damaged: int
    quick: int = 0


def schedule(part: Part, chance: Random) -> Iterator[Life]:
    """What happens in every life but the last."""
    share = part.slots // (part.lives + 1) // (3 if part.quick else 1)
    for number in range(part.lives):
        times = sorted(chance.randrange(share) for _ in range(part.each))
        events = [(after, chance.choice(IN_LIFE)) for after in times]
        if number % 3 == 1:
            events.insert(0, (0, "worker starting"))
        yield Life([*events, (share, ENDS[number % len(ENDS)])])


def disturbed(part: Part, site: Site, chance: Random) -> tuple[Outcome, Counter[str]]:
    """Build in lives; what happened, and what was damaged."""
    outcome, damaged, began = Outcome(), Counter[str](), time.monotonic()
    mark = secrets.token_hex(8)
    for number, life in enumerate(schedule(part, chance), 1):
        code = live(site, life, outcome, mark)
        damaged.update(damage(site.root, chance) for _ in range(part.damaged))
        print(f"{part.name} {number}/{part.lives}: {life.events}, exit {code}, {time.monotonic() - began:.0f} s", flush=True)
        for line in outcome.wrong:
            print(f"    WRONG {line}", flush=True)
    if part.quick and site.stored is not None:
        mid_write(part, site, chance, outcome, damaged)
        print(f"{part.name}: {part.quick} lives in one process, {time.monotonic() - began:.0f} s", flush=True)
    live(site, Life(()), outcome, mark)
    if site.stored is None:  # of the stored episode verify says that it is that of no slot
        damaged.update(decay(site.root, chance) for _ in range(DECAYED))
        if '"ok": false' not in verified(site.root):  # and gives it another time, so that the build reads it
            outcome.wrong.append("verify: finds nothing wrong where bits were inverted")
    for _ in range(2):  # the second has nothing to do
        live(site, Life(()), outcome, mark)
    return outcome, damaged


def mid_write(part: Part, site: Site, chance: Random, outcome: Outcome, damaged: Counter[str]) -> None:
    """Builds in one process, each killed in the middle of something, every fifth followed by damage."""
    assert site.stored is not None
    fresh = Fresh(Dataset(site.root).recipe(), Control(site.folder / "control"), site.stored)
    before = len(fresh.control.sprung)
    for number in range(part.quick):
        trap = chance.choice(MID_WRITE)
        passes = chance.randrange(2 * part.slots // part.quick) if trap[0] in ("episode", "asset", "worker") else 0
        code = fresh.live(site.root, *trap, passes)
        outcome.codes[code or 0] += 1
        outcome.missed.update(f"trap {path.name.rpartition('-')[0]}" for path in fresh.control.traps.iterdir())
        if code not in (0, -9):
            outcome.wrong.append(f"{trap}: exit code {code}")
        if number % 5 == 4:
            damaged[damage(site.root, chance)] += 1
    fresh.control.clear()
    outcome.done.update(f"killed at {name} (one process)" for name in fresh.control.sprung[before:])


def build(site: Site) -> None:
    """Build undisturbed."""
    driver = Driver(site, secrets.token_hex(8))
    if driver.wait():
        raise SystemExit(f"the undisturbed build failed: {driver.describe()}")


def kills(done: Counter[str]) -> int:
    """How many processes were killed."""
    fatal = ("worker ", "killed at ", "driver", "raylet", "gcs_server")
    return sum(count for name, count in done.items() if name.startswith(fatal))


def table(results: dict[str, tuple[Outcome, Counter[str], Comparison]]) -> str:
    """A Markdown table: what was done to each part, and what became of it."""
    rows: list[tuple[str, Sequence[object]]] = []
    names = sorted({name for outcome, *_ in results.values() for name in outcome.done})
    rows += [(name, [outcome.done[name] for outcome, *_ in results.values()]) for name in names]
    rows.append(("**processes killed**", [kills(outcome.done) for outcome, *_ in results.values()]))
    ways = sorted({name for _, damaged, *_ in results.values() for name in damaged})
    rows += [(name, [damaged[name] for _, damaged, *_ in results.values()]) for name in ways]
    for name in ("slots", "lost", "duplicated", "left_over", "missing", "different", "same"):
        values = [getattr(found, name) for *_, found in results.values()]
        rows.append((f"**{name.replace('_', ' ')}**", [value if isinstance(value, int) else len(value) for value in values]))
    rows.append(("**not as promised** (exit code, message, processes or files left)", [len(o.wrong) for o, *_ in results.values()]))
    lines = [f"| | {' | '.join(results)} |", f"|---|{'---:|' * len(results)}"]
    return "\n".join([*lines, *(f"| {name} | {' | '.join(map(str, values))} |" for name, values in rows)])


def verified(root: Path) -> str:
    """The result of `verify` on a dataset."""
    command = [sys.executable, "-m", "pipeline.cli", "verify", root, "--json"]
    return subprocess.run(command, check=False, capture_output=True, text=True).stdout


def main() -> None:
    """Build, disturb, compare, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--slots", type=int, default=510)
    parser.add_argument("--real", type=int, default=24)
    parser.add_argument("--lives", type=int, default=6)
    parser.add_argument("--real-lives", type=int, default=2)
    parser.add_argument("--kills", type=int, default=5, help="workers that are killed in a life of the stored episodes")
    parser.add_argument("--quick", type=int, default=70, help="builds of the stored episodes in one process that are killed")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--folder", type=Path, help="where to work; kept afterwards")
    parser.add_argument("--out", type=Path, help="write the table to this file as well")
    given = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("terminated"))
    with ExitStack() as cleared:
        # with a short path: sockets of Ray are below it
        folder = given.folder or Path(tempfile.mkdtemp(prefix="ch-", dir="/tmp"))
        if not given.folder:
            cleared.callback(shutil.rmtree, folder, ignore_errors=True)
        disk = Disk(folder / "disk")
        try:
            cleared.enter_context(disk.mounted())
        except subprocess.CalledProcessError as error:
            print(f"no full disk: {error.stderr.decode().strip()}", file=sys.stderr)
            disk = None
        manifest = folder / "small.yaml"
        manifest.write_text("size: [64, 48]\nlevels: [1, 2, 3]\n")
        small = ("--manifest", str(manifest), *SMALL)
        parts = [
            Part(
                "stored episode",
                (*small, *STORED, "--total", str(given.slots)),
                given.slots,
                given.lives,
                given.kills,
                2,
                given.quick,
            ),
            Part("real stages", (*small, *REAL, "--total", str(given.real)), given.real, given.real_lives, 2, 1),
        ]
        results = {}
        source = folder / "source" / "dataset"
        source.parent.mkdir()
        build(Site((*small, *REAL, "--total", "1", "--executor", "inline"), source.parent, source))
        for part in (each for each in parts if each.slots):
            folder_of = folder / part.name.split()[0]
            alone = folder_of / "alone"
            alone.mkdir(parents=True)
            stored = source if part.name == "stored episode" else None
            # meanwhile: it takes one core
            undisturbed = Driver(Site((*part.options, "--executor", "inline"), alone, alone / "data", stored), secrets.token_hex(8))
            root = (disk.folder if disk else folder_of) / part.name.split()[0]
            site = Site((*part.options, *WORKERS), folder_of, root, stored, disk)
            outcome, damaged = disturbed(part, site, Random(given.seed))
            if undisturbed.wait():
                raise SystemExit(f"the undisturbed build failed: {undisturbed.describe()}")
            found = compare(alone / "data", root)
            # of the stored episode it says that its motion is not that of the slots it was handed to, in both datasets
            if (said := verified(root)) != verified(alone / "data"):
                outcome.wrong.append(f"verify: {said[-2000:]}")
            results[part.name] = outcome, damaged, found
            print(json.dumps({"wrong": outcome.wrong, "missed": outcome.missed, **vars(found)}, indent=1), flush=True)
        text = f"{hardware(ensure_renderer())}; seed {given.seed}\n\n{table(results)}\n"
    print(text)
    if given.out:
        given.out.write_text(text)


if __name__ == "__main__":
    main()
