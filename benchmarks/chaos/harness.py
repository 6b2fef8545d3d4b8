"""Runs of a build command that are disturbed, and what is left of each when it has ended."""

import json
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from benchmarks.chaos.command import STORED, build_here
from benchmarks.chaos.traps import CONTROL, Control
from pipeline.data.recipe.model import Recipe

MARK = "CHAOS_MARK"
PATIENCE = 60.0
"""Seconds to wait for a moment at which to disturb, and for what is left of a driver to go."""
MOST_SECONDS = 900.0
"""Seconds after which a driver that was told to stop, or that has lost what it needs, counts as hung."""

REPO = Path(__file__).parents[2]
FILLED = 96 * 1024
"""Bytes left on a disk that is made full."""

STOPS = {"interrupt": (signal.SIGINT, 130), "terminate": (signal.SIGTERM, 130), "driver": (signal.SIGKILL, -9)}
"""Signals to the driver, and the exit codes that they must have."""


@dataclass(frozen=True)
class Life:
    """One run of the command: after how many ended slots what happens, the last of which ends it; "" lets it end by itself.

    `worker starting` kills a worker that starts, `trap KIND MOMENT` sets a trap; `driver`, `raylet`, `gcs_server` are killed;
    `interrupt` and `terminate` stop the driver, which then falls into the trap that is named behind, if any; `full disk` leaves
    no space.
    """

    events: Sequence[tuple[int, str]]


@dataclass
class Outcome:
    """The result of a run: disturbances by name, exit codes, and faults, one line each.

    Also the disturbances that could not be done and the traps that did not spring."""

    done: Counter[str] = field(default_factory=Counter)
    missed: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)
    codes: Counter[int] = field(default_factory=Counter)


@dataclass(frozen=True)
class Site:
    """Where a build is disturbed: its options, the directory with everything that the harness writes, the dataset, the dataset
    whose first episode stands for all (None: the real stages), and the file system of the dataset where it can be made full."""

    options: Sequence[str]
    folder: Path
    root: Path
    stored: Path | None = None
    disk: "Disk | None" = None


class Disk:
    """A file system in memory that can be made full. Needs the right to mount."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @contextmanager
    def mounted(self) -> Iterator[None]:
        """It is there within. Raises CalledProcessError without the right to mount."""
        self.folder.mkdir(parents=True)
        subprocess.run(["mount", "-t", "tmpfs", "-o", "size=4g", "chaos", self.folder], check=True, capture_output=True)
        try:
            yield
        finally:
            subprocess.run(["umount", "-l", self.folder], check=True)

    def resize(self, full: bool) -> None:
        """Leave no space on it, or all that it had."""
        status = os.statvfs(self.folder)
        used = (status.f_blocks - status.f_bfree) * status.f_frsize
        size = used + FILLED if full else 4 * 2**30
        subprocess.run(["mount", "-o", f"remount,size={size}", self.folder], check=True, capture_output=True)


class Driver:
    """A run of the command, its standard output read as it comes."""

    def __init__(self, site: Site, mark: str) -> None:
        self.control, self.mark, self.began = Control(site.folder / "control"), mark, time.monotonic()
        self.control.clear()
        self.temporary = site.folder / "t"
        self.temporary.mkdir(exist_ok=True)
        environment = os.environ | {
            "PYTHONPATH": str(REPO),
            CONTROL: str(self.control.root),
            MARK: mark,
            "TMPDIR": str(self.temporary),
        }
        if site.stored is not None:
            environment[STORED] = str(site.stored)
        command = [sys.executable, "-m", "benchmarks.chaos.command", "build", *site.options, "--out", str(site.root)]
        self.errors = open(site.folder / "errors", "w+", encoding="utf-8")  # noqa: SIM115  (open as long as the driver)
        self.process = subprocess.Popen(
            [*command, "--progress", "json"],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=self.errors,
            text=True,
            start_new_session=True,
        )
        self.ended, self.lost, self.result = 0, 0, dict[str, object]()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            with suppress(json.JSONDecodeError):
                values = json.loads(line)
                self.ended += values["event"] == "slot"
                self.lost += values["event"] == "worker_lost"
                if values["event"] == "result":
                    self.result = values

    @property
    def alive(self) -> bool:
        """Whether it runs."""
        return self.process.poll() is None

    def starting(self) -> bool:
        """Whether a worker starts."""
        return any("ray::CrewWorker" in line for line in self.marked().values())

    def begun(self) -> bool:
        """Whether a worker is, or was, at a slot."""
        return self.ended > 0 or any(self.control.at.iterdir())

    def marked(self) -> dict[int, str]:
        """Living processes of this run, with their command lines."""
        found, mark = {}, f"{MARK}={self.mark}".encode()
        for pid in (int(name) for name in os.listdir("/proc") if name.isdigit()):
            try:
                if mark in Path(f"/proc/{pid}/environ").read_bytes().split(b"\0"):
                    found[pid] = Path(f"/proc/{pid}/cmdline").read_text().replace("\0", " ").strip()
            except OSError:
                continue
        return found

    def wait(self) -> int:
        """Its exit code; it is killed where it hangs."""
        try:
            self.process.wait(MOST_SECONDS)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self._reader.join(10)
        return self.process.returncode

    def describe(self) -> list[str]:
        """What it printed as errors."""
        self.errors.seek(0)
        return self.errors.read().splitlines()


def live(site: Site, life: Life, outcome: Outcome, mark: str) -> int:
    """Run the command once, disturbed; its exit code. What it should not have done or left is added to the outcome."""
    driver = Driver(site, mark)
    before, expected = len(driver.control.sprung), {0}
    for after, event in life.events:
        begun = driver.begun if event != "worker starting" else driver.starting
        _until(lambda after=after, begun=begun: (begun() and driver.ended >= after) or not driver.alive, MOST_SECONDS)
        if not driver.alive:
            break
        happened = _disturb(driver, site, event)
        if not happened:
            outcome.missed[event] += 1
        elif not event.startswith("trap "):  # which are counted as they spring
            outcome.done[event] += 1
        head = event.partition(" ")[0]
        if head in STOPS:
            expected = {STOPS[head][1], -9} if " " in event else {STOPS[head][1]}
        elif head == "trap":
            expected |= {-9}
        elif head != "worker":
            expected = {2}
    code = driver.wait()
    outcome.codes[code] += 1
    if site.disk is not None:
        site.disk.resize(full=False)
    outcome.missed.update(f"trap {path.name.rpartition('-')[0]}" for path in driver.control.traps.iterdir())
    outcome.done.update(f"killed at {name}" for name in driver.control.sprung[before:])
    said = driver.describe()
    if code not in expected or (code in (0, -9) and said) or (code in (2, 130) and len(said) != 1):
        outcome.wrong.append(f"{life.events}: exit code {code}, {' | '.join(said)[-400:]}")
    if not _until(lambda: not driver.marked(), PATIENCE):
        outcome.wrong.append(f"{life.events}: processes left: {sorted(driver.marked().values())}")
        for pid in driver.marked():
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
    if not _until(lambda: not any(driver.temporary.iterdir()), PATIENCE):
        outcome.wrong.append(f"{life.events}: left in TMPDIR: {[path.name for path in driver.temporary.iterdir()]}")
    return code


def _disturb(driver: Driver, site: Site, event: str) -> bool:
    """Do it; whether it could be done."""
    match event.split():
        case ["worker", "starting"]:
            return _until(lambda: _kill_named(driver, "ray::CrewWorker.begin"), PATIENCE)
        case ["trap", kind, moment]:
            driver.control.set(kind, moment)
            return True
        case ["full", "disk"]:
            if site.disk is None:
                return False
            site.disk.resize(full=True)
            return True
        case [name, *trap] if name in STOPS:
            if trap:
                driver.control.set(trap[0], trap[1])
            driver.process.send_signal(STOPS[name][0])
            return True
        case [daemon]:
            return _kill_named(driver, daemon)
        case _:
            raise ValueError(event)


def _kill_named(driver: Driver, name: str) -> bool:
    """Kill a process of the run by the first word of its command line."""
    for pid, line in driver.marked().items():
        if os.path.basename(line.split(" ")[0]) == name:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
                return True
    return False


def _until(found: Callable[[], object], seconds: float) -> bool:
    """Wait until that is so; false where it takes longer."""
    deadline = time.monotonic() + seconds
    while not found():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.005)
    return True


class Fresh:
    """Builds in processes that have imported everything and started nothing: they begin in a moment."""

    def __init__(self, recipe: Recipe, control: Control, stored: Path) -> None:
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload(["benchmarks.chaos.command"])
        self._recipe, self.control, self._stored = recipe, control, stored

    def live(self, root: Path, kind: str = "", moment: str = "", passes: int = 0) -> int | None:
        """Build with one trap set, or none; the exit code."""
        self.control.clear()
        if kind:
            self.control.set(kind, moment, passes)
        process = self._context.Process(target=build_here, args=(root, self._recipe, self.control.root, self._stored))
        process.start()
        process.join(MOST_SECONDS)
        return process.exitcode


def damage(root: Path, chance: Random) -> str:
    """Truncate a file of the dataset, or invert one bit of it; what was done. An asset is removed: a build reads none."""
    kinds = {
        "episode": sorted(root.glob("episodes/**/*.hdf5")),
        "asset": sorted(root.glob("assets/bodies/*/*.npz")),
        "index": sorted(root.glob("index.sqlite")),
        "attempts": sorted(root.glob("attempts.parquet")),
        "provenance": sorted(root.glob("provenance.json")),
    }
    weights = {"episode": 6, "asset": 3, "index": 3, "attempts": 1, "provenance": 1}
    there = [kind for kind, paths in kinds.items() if paths]
    if not there:
        return "nothing there"
    (kind,) = chance.choices(there, [weights[kind] for kind in there])
    path = chance.choice(kinds[kind])
    if kind == "asset":
        path.unlink()
        return "asset removed"
    data = bytearray(path.read_bytes())
    if chance.random() < 0.5 or not data:
        path.write_bytes(data[: chance.randrange(max(1, len(data)))])
        return f"{kind} truncated"
    data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
    path.write_bytes(data)
    return f"{kind} flipped"


def decay(root: Path, chance: Random) -> str:
    """Invert one bit of an episode, whose length and time stay; what was done."""
    path = chance.choice(sorted(root.glob("episodes/**/*.hdf5")))
    before, data = path.stat(), bytearray(path.read_bytes())
    data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
    path.write_bytes(data)
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    return "episode flipped, length and time kept"
