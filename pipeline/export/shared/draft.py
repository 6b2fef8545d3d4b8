"""An export while it is written. Unchanged files are linked from the older export; the result
has the bytes of an export to an empty directory."""

import functools
import hashlib
import os
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any

from pipeline.data.atomic import atomic_directory, exclusive, sweep
from pipeline.data.errors import refusal
from pipeline.data.keys import digest, file_hash
from pipeline.data.names import EXPORT_RECORD
from pipeline.data.slots.select import VALIDATION
from pipeline.data.store.place import fetch_below

from .episodes import EPISODES, ExportError, Progress, source_of
from .record import ExportRecord, entries, read_record

OWN = ("episodes", "failures", "ledger", "assets", "annotations", "report")
"""Directories of a dataset that nothing else may be written to."""

ROOMS = ("data", "export", "motion")
"""Packages whose code decides the bytes of exports, beside poses.py."""

PACKAGES = ("av", "h5py", "numpy", "opencv-python-headless", "pyarrow")


@functools.cache
def code() -> dict[str, str]:
    """Hash of the exporting code, and versions of its packages."""
    root, h, versions = Path(__file__).parents[2], hashlib.sha256(), dict[str, str]()
    files = (file for room in ROOMS for file in (root / room).rglob("*.py"))
    for path in sorted([root / "poses.py", *files]):
        h.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes())
    for name in PACKAGES:
        with suppress(metadata.PackageNotFoundError):
            versions[name] = metadata.version(name)
    return {"code": h.hexdigest(), **versions}


@dataclass(frozen=True)
class Job[O]:
    """One export. What is written never depends on `workers`. `describe(folder, summary)` gives
    the card's text; `given` is what export.json has beside the options."""

    dataset: Path
    out: Path
    episodes: Sequence[Path]
    options: O
    progress: Progress = None
    workers: int = 1
    describe: Callable[[Path, Mapping[str, Any]], str] | None = None
    split: str = EPISODES
    where: str = ""
    validation: float = VALIDATION
    origins: Mapping[Path, Path] = field(default_factory=dict[Path, Path])
    given: Mapping[str, Any] = field(default_factory=dict[str, Any])

    def advance(self) -> None:
        if self.progress is not None:
            self.progress(1)


class OlderExport:
    """It lends nothing if options or code differ. Raises ExportError."""

    def __init__(self, root: Path, format_: str, options: Mapping[str, Any]) -> None:
        fetch_below(root)
        self.root, self._sound = root, dict[str, bool]()
        self.record = ExportRecord(root, {}, {}, {}, {})
        if (root / EXPORT_RECORD).exists():
            record = read_record(root)
            if (other := record.summary.get("format")) != format_:
                held = f"holds an export in the format {str(other)[:40]}"
                raise ExportError(f"{root}: {held}: remove it or name another directory")
            if digest([record.summary.get("options"), record.code]) == digest([options, code()]):
                self.record = record
        contents = self.record.contents.items()
        self._names = {entry["from"]: name for name, entry in contents if "from" in entry}

    def made_from(self, key: str) -> str | None:
        """An unchanged file by its sources, or None."""
        name = self._names.get(key)
        return name if name is not None and self.sound(name) else None

    def sound(self, name: str) -> Path | None:
        """A file whose bytes are those that were written, or None."""
        if name not in self._sound:
            self._sound[name] = name in self.record.contents and self.record.problem(name) is None
        return self.root / name if self._sound[name] else None


class ExportDraft:
    """An export in `folder` before it becomes the job's `out`."""

    def __init__(
        self, folder: Path, job: Job[Any], format_: str, options: Mapping[str, Any]
    ) -> None:
        self.folder, self._job, self.dataset, self.format = folder, job, job.dataset, format_
        self.validation = job.validation
        self.mixed = "datasets" in job.given
        self.older = OlderExport(job.out, format_, options)
        self._inputs: dict[str, str | None] = {}
        self._contents: dict[str, dict[str, Any]] = {}

    def hash_of(self, path: Path) -> str:
        """sha256, recorded as an input. Raises ExportError."""
        name = source_of(path, self.dataset)
        sha = self._inputs.get(name)
        if sha is None:
            try:
                self._inputs[name] = sha = file_hash(self._job.origins.get(path, path))
            except OSError as error:
                why = f"cannot be read ({error.strerror})"
                raise ExportError(f"{path}: {why}; make it again") from error
        return sha

    def hash_if_there(self, path: Path) -> str | None:
        """As `hash_of`; None, recorded too, for a missing file."""
        if path.exists():
            return self.hash_of(path)
        self._inputs[source_of(path, self.dataset)] = None
        return None

    def keep(self, path: Path, made_from: Any) -> Mapping[str, Any] | None:
        """Take over the older file of the same plain data: its entry, or None."""
        older = self.older.made_from(_key(path, made_from))
        if older is None:
            return None
        path.parent.mkdir(parents=True, exist_ok=True)
        _link(self.older.root / older, path)
        self._contents[self._name(path)] = entry = dict(self.older.record.contents[older])
        return entry

    def record(self, path: Path, made_from: Any, **facts: Any) -> None:
        """Record what a written file was made from, and `facts`."""
        entry = {"from": _key(path, made_from), **_entry(path), **facts}
        self._contents[self._name(path)] = entry

    def _name(self, path: Path) -> str:
        return path.relative_to(self.folder).as_posix()

    def finish(self, summary: Mapping[str, Any]) -> dict[str, Any]:
        """Write export.json; files with the older bytes become links."""
        for name in entries(self.folder):
            if name not in self._contents:
                self._contents[name] = _entry(self.folder / name)
        whole = {**summary, "bytes": sum(entry["bytes"] for entry in self._contents.values())}
        ExportRecord(self.folder, whole, code(), self._inputs, self._contents).write()
        for name, entry in self._contents.items():
            path, older = self.folder / name, self.older.sound(name)
            if older and not os.path.samefile(older, path) and file_hash(older) == entry["sha256"]:
                path.unlink()
                _link(older, path)
        before, path = self._job.out / EXPORT_RECORD, self.folder / EXPORT_RECORD
        if self.older.record.contents and before.read_bytes() == path.read_bytes():
            path.unlink()
            _link(before, path)
        return whole


def _entry(path: Path) -> dict[str, Any]:
    return {"sha256": file_hash(path), "bytes": path.stat().st_size}


def _key(path: Path, made_from: Any) -> str:
    """Of sources and kind: ".tfrecord" of a.tfrecord-00000-of-00002."""
    return digest([path.suffix.partition("-")[0], made_from])


def _link(older: Path, path: Path) -> None:
    try:
        os.link(older, path)
    except OSError:
        shutil.copy2(older, path)


@contextmanager
def stage_directory(out: Path, dataset: Path) -> Iterator[Path]:
    """It replaces `out` when the block ends well. Raises ExportError, Busy."""
    out, here = Path(os.path.abspath(out)), Path(dataset).resolve()
    real, record = out.resolve(), out / EXPORT_RECORD
    problem = ""
    if out.exists() and not out.is_dir():
        problem = "is a file"
    elif here.is_relative_to(real):
        problem = "holds the dataset itself"
    elif any(real.is_relative_to(here / own) for own in OWN):
        problem = "lies among the dataset's own files"
    elif out.exists() and any(out.iterdir()) and not record.exists():
        problem = f"is not an export (it has no {EXPORT_RECORD}); remove it"
    if problem:
        raise ExportError(f"{out}: {problem}; name another directory")
    if record.exists() and (foreign := read_record(out).foreign()):
        raise ExportError(f"{foreign[0]}: is no part of the export there; move it away")
    try:
        sweep(out.parent, f".{out.name}.*.tmp")
        # what is there lends its files: they must be those that were judged
        with exclusive(out) if out.is_dir() else nullcontext(), atomic_directory(out) as temporary:
            yield temporary
    except OSError as error:
        why = f"cannot be written: {refusal(error)}"
        raise ExportError(f"{out}: {why}; nothing was changed there: export again") from error
