"""Traps: places at which a process of a build kills itself, or finds the disk full.

A trap is a file <kind>-<moment>-<number> in the control directory, with a count of how often it is passed before it springs.
Every file of a dataset is flushed (os.fsync) under a temporary name and then renamed (os.replace), so the moments of its writing
are `half` (half of the temporary file is there), `whole` (all of it, before the rename), `renamed` (just after it), and `full` (the
flush fails). Of the kind `worker`, the moments are the phases of a slot.
"""

import errno
import os
import signal
import threading
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

KINDS = {
    "/episodes/": "episode",
    "/assets/": "asset",
    "index.sqlite": "index",
    "attempts.parquet": "attempts",
    "provenance.json": "provenance",
    "/report/": "report",
}
"""Kinds of files by what their path has in it, in this order."""

MOMENTS = ("half", "whole", "renamed")
CONTROL = "CHAOS_CONTROL"


@dataclass(frozen=True)
class Control:
    """The directory through which the harness and the processes of a build know of one another.

    at/PID says which slot a worker is at, and in which phase; struck/SLOT that a worker was lost at a slot in this run of the
    driver: no second one is killed there, because two lost workers count as the fault of the seed, which is then not tried again.
    """

    root: Path

    @classmethod
    def here(cls) -> "Control":
        """The one that the environment names."""
        return cls(Path(os.environ[CONTROL]))

    @property
    def at(self) -> Path:
        """Notes of workers."""
        return self.root / "at"

    @property
    def struck(self) -> Path:
        """Slots that have lost a worker."""
        return self.root / "struck"

    @property
    def traps(self) -> Path:
        """Traps that are set."""
        return self.root / "traps"

    @property
    def sprung(self) -> list[str]:
        """Names of the traps that have sprung, in this order."""
        path = self.root / "sprung"
        return path.read_text().split() if path.exists() else []

    def clear(self) -> None:
        """No worker, no struck slot, no trap."""
        for folder in (self.at, self.struck, self.traps):
            folder.mkdir(parents=True, exist_ok=True)
            for path in folder.iterdir():
                path.unlink()

    def set(self, kind: str, moment: str, passes: int = 0) -> None:
        """Set a trap that lets so many pass."""
        name = f"{kind}-{moment}"
        (self.traps / f"{name}-{len(list(self.traps.glob(f'{name}-*')))}").write_text(str(passes))

    def springs(self, kind: str, moment: str) -> bool:
        """Whether this process is in a trap now. Workers are not killed at a slot that has lost one."""
        trap = min(self.traps.glob(f"{kind}-{moment}-*"), default=None)
        if trap is None or threading.current_thread() is not threading.main_thread():
            return False
        with suppress(FileNotFoundError, ValueError):
            left = int(trap.read_text())
            if left:
                trap.write_text(str(left - 1))
                return False
            at = self.read_note(os.getpid())
            if moment != "full" and at is not None and not self.strike(at[0]):
                return False
            trap.unlink()
            with open(self.root / "sprung", "a", encoding="utf-8") as file:
                file.write(f"{kind}-{moment}\n")
            return True
        return False

    def strike(self, slot: str) -> bool:
        """Note that the worker at a slot is to be killed; false if one was killed already."""
        try:
            (self.struck / slot.replace("/", "__")).touch(exist_ok=False)
        except FileExistsError:
            return False
        return True

    def note(self, slot: str, phase: str) -> None:
        """Note the slot and phase of this process."""
        path = self.at / str(os.getpid())
        fresh = path.with_suffix(".new")
        fresh.write_text(f"{slot} {phase}")
        os.rename(fresh, path)

    def read_note(self, pid: int) -> tuple[str, str] | None:
        """The slot and phase that a process noted."""
        try:
            slot, phase = (self.at / str(pid)).read_text().split()
        except (FileNotFoundError, ValueError):
            return None
        return slot, phase

    def leave(self) -> None:
        """This process is at nothing."""
        (self.at / str(os.getpid())).unlink(missing_ok=True)


def install(control: Control) -> None:
    """Have this process spring traps from now on."""
    flush, replace = os.fsync, os.replace
    if replace.__module__ == __name__:  # they are there already
        return

    def fsync(file: int) -> None:
        path = Path(os.readlink(f"/proc/self/fd/{file}"))
        if control.springs(kind_of(path), "full"):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        if control.springs(kind_of(path), "half"):
            os.truncate(path, path.stat().st_size // 2)
            die()
        flush(file)

    def renaming(source: str | Path, target: str | Path) -> None:
        if control.springs(kind_of(Path(target)), "whole"):
            die()
        replace(source, target)
        if control.springs(kind_of(Path(target)), "renamed"):
            die()

    os.__dict__.update(fsync=fsync, replace=renaming)


def kind_of(path: Path) -> str:
    """The kind of a dataset's file."""
    text = str(path)
    return next((kind for part, kind in KINDS.items() if part in text), "other")


def die() -> None:
    """End this process as the kernel does that has no memory left."""
    os.kill(os.getpid(), signal.SIGKILL)
