"""A build under a seeded schedule of disturbances, against the same build undisturbed.

    python -m benchmarks.chaos [--slots 510] [--real 24] [--lives 12] [--real-lives 2] [--seed 1] [--out FILE.md]

Two datasets are built twice, by the real command with Ray workers: `--real` slots of click_bell with small images, all three
stages; and `--slots` of sixty cells whose stages only sleep, fail by lot and hand out one stored episode (chaos/command.py), around
the real keys, notes, logs, files, ledger, engine and command. The first build is left alone, in one process. The second runs in
lives: in each, workers are killed in every phase, in the middle of writing, and while they start; then the life ends by killing the
driver, Ray's raylet or its control service, by a full disk, or by a signal after which the driver dies while it cleans up. Between
lives files are truncated and bits flipped. The last life is left alone. Then everything is compared. The full disk needs the right
to mount.
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
from benchmarks.chaos.harness import Disk, Driver, Life, Outcome, Site, damage, live
from benchmarks.hardware import hardware
from pipeline.world.vulkan import ensure_renderer

SMALL = ("--render", "raster-fast")
REAL = ("--tasks", "click_bell", "--embodiment", "aloha")
TASKS = (
    "beat_block_hammer,click_alarmclock,click_bell,grab_roller,move_can_pot,"
    "place_fan,place_shoe,rotate_qrcode,stamp_seal,scan_object"
)
STORED = ("--tasks", TASKS, "--embodiment", "aloha,piper", "--attempts", "8")
WORKERS = ("--executor", "ray", "--workers", "2")

IN_LIFE = (
    *("worker planning", "worker drawing", "worker planning", "worker drawing"),
    *("trap episode half", "trap episode whole", "trap episode renamed", "trap asset half", "trap asset whole"),
)
ENDS = (
    *("driver", "raylet", "trap journal half", "terminate ledger half", "gcs_server", "trap journal whole", "full disk"),
    *("terminate ledger renamed", "driver", "trap journal renamed", "interrupt", "terminate attempts half", "raylet"),
    *("terminate ledger whole", "driver", "terminate provenance whole", "gcs_server", "terminate attempts renamed"),
)


@dataclass(frozen=True)
class Part:
    """One of the two datasets: its name, options, slots, lives, worker disturbances a life, and damaged files after a life."""

    name: str
    options: Sequence[str]
    slots: int
    lives: int
    each: int
    damaged: int


def schedule(part: Part, chance: Random) -> Iterator[Life]:
    """What happens in every life but the last."""
    share = part.slots // (part.lives + 1)
    for number in range(part.lives):
        times = sorted(chance.randrange(share) for _ in range(part.each))
        events = [(after, chance.choice(IN_LIFE)) for after in times]
        if number % 3 == 1:
            events.insert(0, (0, "worker starting"))
        if number == 2:
            events.append((share - 1, "worker hangs"))
        yield Life([*events, (share, ENDS[number % len(ENDS)])])


def disturbed(part: Part, site: Site, seed: int) -> tuple[Outcome, Counter[str], float]:
    """Build in lives; what happened, what was damaged, and seconds."""
    chance, outcome, damaged, began = Random(seed), Outcome(), Counter[str](), time.monotonic()
    mark = secrets.token_hex(8)
    for number, life in enumerate(schedule(part, chance), 1):
        code = live(site, life, outcome, mark)
        damaged.update(damage(site.root, chance) for _ in range(part.damaged))
        print(f"{part.name} {number}/{part.lives}: {life.events}, exit {code}, {time.monotonic() - began:.0f} s", flush=True)
        for line in outcome.wrong:
            print(f"    WRONG {line}", flush=True)
    for _ in range(2):  # the second has nothing to do
        live(site, Life(()), outcome, mark)
    return outcome, damaged, time.monotonic() - began


def build(site: Site) -> float:
    """Build undisturbed in one process; seconds."""
    driver = Driver(site, secrets.token_hex(8))
    code = driver.wait()
    if code:
        raise SystemExit(f"the undisturbed build ended with {code}: {driver.said()}")
    return time.monotonic() - driver.began


def kills(done: Counter[str]) -> int:
    """How many processes were killed."""
    fatal = ("worker ", "killed at ", "driver", "raylet", "gcs_server")
    return sum(count for name, count in done.items() if name.startswith(fatal) and name != "worker hangs")


def table(results: dict[str, tuple[Outcome, Counter[str], Comparison, dict[str, float]]]) -> str:
    """A Markdown table: what was done to each part, and what became of it."""
    rows: list[tuple[str, Sequence[object]]] = []
    names = sorted({name for outcome, *_ in results.values() for name in outcome.done})
    rows += [(name, [outcome.done[name] for outcome, *_ in results.values()]) for name in names]
    rows.append(("**processes killed**", [kills(outcome.done) for outcome, *_ in results.values()]))
    ways = sorted({name for _, damaged, *_ in results.values() for name in damaged})
    rows += [(name, [damaged[name] for _, damaged, *_ in results.values()]) for name in ways]
    for name in ("slots", "lost", "duplicated", "left_over", "missing", "different", "same"):
        values = [getattr(found, name) for *_, found, _ in results.values()]
        rows.append((f"**{name.replace('_', ' ')}**", [value if isinstance(value, int) else len(value) for value in values]))
    rows.append(("**not as promised** (exit code, message, processes or files left)", [len(o.wrong) for o, *_ in results.values()]))
    for name in next(iter(results.values()))[3]:
        rows.append((name, [f"{times[name]:.0f}" for *_, times in results.values()]))
    lines = [f"| | {' | '.join(results)} |", f"|---|{'---:|' * len(results)}"]
    return "\n".join([*lines, *(f"| {name} | {' | '.join(map(str, values))} |" for name, values in rows)])


def main() -> None:
    """Build, disturb, compare, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--slots", type=int, default=510)
    parser.add_argument("--real", type=int, default=24)
    parser.add_argument("--lives", type=int, default=12)
    parser.add_argument("--real-lives", type=int, default=2)
    parser.add_argument("--kills", type=int, default=8, help="workers that are killed in a life of the stored episodes")
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
            Part("real stages", (*small, *REAL, "--total", str(given.real)), given.real, given.real_lives, 2, 1),
            Part("stored episode", (*small, *STORED, "--total", str(given.slots)), given.slots, given.lives, given.kills, 2),
        ]
        results = {}
        source = folder / "source" / "dataset"
        source.parent.mkdir()
        build(Site((*small, *REAL, "--total", "1", "--executor", "inline"), source.parent, source))
        for part in (each for each in parts if each.slots):
            folder_of = folder / part.name.split()[0]
            folder_of.mkdir()
            reference, root = folder_of / "reference", (disk.folder if disk else folder_of) / part.name.split()[0]
            stored = source if part.name == "stored episode" else None
            alone = build(Site((*part.options, "--executor", "inline"), folder_of, reference, stored))
            site = Site((*part.options, *WORKERS, "--slot-timeout", "45"), folder_of, root, stored, disk)
            outcome, damaged, seconds = disturbed(part, site, given.seed)
            found = compare(reference, root)
            verified = subprocess.run(
                [sys.executable, "-m", "pipeline.cli", "verify", root, "--json"], check=False, capture_output=True
            )
            if verified.returncode:
                outcome.wrong.append(f"verify: {verified.stdout.decode()[-2000:]}")
            results[part.name] = outcome, damaged, found, {"seconds undisturbed": alone, "seconds disturbed": seconds}
            print(json.dumps({"wrong": outcome.wrong, "missed": outcome.missed, **vars(found)}, indent=1), flush=True)
        text = f"{hardware(ensure_renderer())}; seed {given.seed}\n\n{table(results)}\n"
    print(text)
    if given.out:
        given.out.write_text(text)


if __name__ == "__main__":
    main()
