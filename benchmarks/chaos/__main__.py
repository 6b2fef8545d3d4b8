"""A build whose processes are killed at random, against the same build undisturbed.

    python -m benchmarks.chaos [--slots 900] [--kills 100] [--workers 2] [--seed 1] [--out FILE.md]

One dataset is built twice by the real command, with stages that only sleep (chaos/command.py): once
in one process and left alone; once with Ray workers while SIGKILL is sent to workers, to the
driver, to Ray's raylet and to its control service. When the command has ended, it is started again.
Half-way, the index is deleted. Then every file is compared.
"""

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path
from random import Random

from benchmarks.chaos.command import STORED
from benchmarks.chaos.compare import compare
from benchmarks.hardware import hardware
from tests.run.processes import of_session, title

TASKS = (
    "beat_block_hammer,click_alarmclock,click_bell,grab_roller,move_can_pot,"
    "place_fan,place_shoe,rotate_qrcode,stamp_seal,scan_object"
)
RECIPE = ("--levels", "1,2,3", "--render", "raster-fast", "--size", "64x48")
VICTIMS = {"ray::CrewWorker": 86, "driver": 8, "raylet": 4, "gcs_server": 2}
"""Whom SIGKILL is sent to, and how often in a hundred."""

LAST = 0.9
"""Share of the slots after which nobody is killed: a job that lost a worker is tried again at the
end, and a second kill at the same attempt would record its seed as failed."""


class Driver:
    """The command in a process of its own."""

    def __init__(self, root: Path, stored: Path, words: list[str]) -> None:
        command = [sys.executable, "-m", "benchmarks.chaos.command", "build", *RECIPE, *words]
        self.process = subprocess.Popen(
            [*command, "--out", str(root), "--progress", "json"],
            env=os.environ
            | {STORED: str(stored), "TMPDIR": str(root.parent), "PYTHONPATH": os.getcwd()},
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        self.done = 0
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        for line in self.process.stdout or ():
            with suppress(json.JSONDecodeError):
                self.done = json.loads(line).get("done", self.done)

    def kill(self, victim: str) -> bool:
        """Kill the driver or one of its processes; whether there was one."""
        if victim == "driver":
            self.process.kill()
            return True
        for pid in of_session(self.process.pid):
            words = title(pid).split(" ")
            if os.path.basename(words[0]).partition(".")[0] == victim:
                with suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
                    return True
        return False


def disturb(root: Path, stored: Path, words: list[str], given: argparse.Namespace) -> Counter[str]:
    """Build to the end, disturbed; how often each victim was killed, and lives by exit code."""
    chance, done = Random(given.seed), Counter[str]()
    names, weights = list(VICTIMS), list(VICTIMS.values())
    moments = sorted(chance.random() * LAST * given.slots for _ in range(given.kills))
    kills = [(moment, chance.choices(names, weights)[0]) for moment in moments]
    driver = Driver(root, stored, words)
    while True:
        if (code := driver.process.poll()) is not None:
            done[f"lives that ended with exit code {code}"] += 1
            if code == 0:
                return done
            if len(kills) < given.kills / 2 and not done["index deleted"]:
                for path in root.glob("index.*"):
                    path.unlink()
                done["index deleted"] += 1
            driver = Driver(root, stored, words)
        if kills and driver.done >= kills[0][0] and driver.kill(kills[0][1]):
            done[kills.pop(0)[1]] += 1
        time.sleep(0.02)


def build(root: Path, words: list[str], module: str, stored: Path | None = None) -> None:
    """Build undisturbed, in one process."""
    environment = os.environ | ({STORED: str(stored)} if stored else {})
    command = [sys.executable, "-m", module, "build", *RECIPE, *words, "--out", str(root)]
    subprocess.run([*command, "--executor", "inline", "--quiet"], env=environment, check=True)


def main() -> None:
    """Build, disturb, compare, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--slots", type=int, default=900)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, help="write the table to this file as well")
    given = parser.parse_args()
    # with a short path: sockets of Ray are below it
    folder = Path(tempfile.mkdtemp(prefix="ch-", dir="/tmp"))
    try:
        source = folder / "source"
        build(source, ["--tasks", "click_bell", "--total", "1"], "pipeline.cli")
        words = ["--tasks", TASKS, "--embodiment", "aloha,piper", "--attempts", "8"]
        words += ["--total", str(given.slots)]
        build(folder / "alone", words, "benchmarks.chaos.command", source)
        crew = ["--executor", "ray", "--workers", str(given.workers)]
        done = disturb(folder / "killed", source, [*words, *crew], given)
        found = compare(folder / "alone", folder / "killed")
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    rows = [*sorted(done.items()), ("**processes killed**", sum(done[name] for name in VICTIMS))]
    rows += [("slots", found.slots), ("files with the same bytes", found.same)]
    differ = {name: getattr(found, name) for name in ("lost", "left_over", "missing", "different")}
    rows += [(name.replace("_", " "), len(paths)) for name, paths in differ.items()]
    lines = [f"{hardware()}; seed {given.seed}\n", "| | |", "|---|---:|"]
    text = "\n".join([*lines, *(f"| {name} | {count} |" for name, count in rows)])
    print(text)
    if given.out:
        given.out.write_text(text + "\n")
    if not found.identical:
        sys.exit(str({name: paths[:10] for name, paths in differ.items() if paths}))


if __name__ == "__main__":
    main()
