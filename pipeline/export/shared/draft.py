"""An export while it is written."""

import functools
import hashlib
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any

from pipeline.data.atomic import atomic_directory, exclusive, sweep
from pipeline.data.errors import refusal
from pipeline.data.keys import file_hash
from pipeline.data.names import EXPORT_RECORD
from pipeline.data.slots.select import VALIDATION
from pipeline.data.store.place import is_there

from .episodes import EPISODES, ExportError, Progress, reading, source_of
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
    """One export; `workers` never change it. `describe(folder, summary)` is the card's text,
    `given` joins the options in export.json."""

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


class ExportDraft:
    """An export in `folder` before it becomes the job's `out`."""

    def __init__(self, folder: Path, job: Job[Any], format_: str) -> None:
        self.folder, self._job, self.dataset, self.format = folder, job, job.dataset, format_
        self.validation = job.validation
        self._inputs: dict[str, str | None] = {}

    @functools.cached_property
    def optional(self) -> frozenset[str]:
        """Optional columns of `scalars`, by one episode of each folder. Raises ExportError."""
        found = {"dataset"} if "datasets" in self._job.given else set[str]()
        for path in {path.parent: path for path in self._job.episodes}.values():
            with reading(path) as file:
                found |= {"pair", "arm"} if file.spec.arm else set()
                found |= {"choices"} if file.meta.choices else set()
        return frozenset(found)

    def hash_of(self, path: Path) -> str:
        name = source_of(path, self.dataset)
        sha = self._inputs.get(name)
        if sha is None:
            try:
                self._inputs[name] = sha = file_hash(self._job.origins.get(path, path))
            except OSError as error:
                raise ExportError(f"{path}: cannot be read ({error.strerror})") from error
        return sha

    def note(self, path: Path) -> None:
        """Record an annotation as an input, also a missing one. Raises ExportError."""
        if path.exists():
            self.hash_of(path)
        else:
            self._inputs[source_of(path, self.dataset)] = None

    def finish(self, summary: Mapping[str, Any]) -> dict[str, Any]:
        contents = dict[str, dict[str, Any]]()
        for name in entries(self.folder):
            path = self.folder / name
            contents[name] = {"sha256": file_hash(path), "bytes": path.stat().st_size}
        whole = {**summary, "bytes": sum(entry["bytes"] for entry in contents.values())}
        ExportRecord(self.folder, whole, code(), self._inputs, contents).write()
        return whole


@contextmanager
def stage_directory(out: Path, dataset: Path, format_: str) -> Iterator[Path]:
    """The folder of an export, which replaces `out` at the end. Raises ExportError, Busy."""
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
        problem = f"is not an export (it has no {EXPORT_RECORD})"
    if problem:
        raise ExportError(f"{out}: {problem}; name another directory")
    if is_there(record):
        older = read_record(out)
        if (other := older.summary.get("format")) != format_:
            held = f"holds an export in the format {str(other)[:40]}"
            raise ExportError(f"{out}: {held}: remove it or name another directory")
        if foreign := older.foreign():
            raise ExportError(f"{foreign[0]}: is no part of the export there; move it away")
    try:
        sweep(out.parent, f".{out.name}.*.tmp")
        with exclusive(out) if out.is_dir() else nullcontext(), atomic_directory(out) as temporary:
            yield temporary
    except OSError as error:
        why = f"cannot be written: {refusal(error)}"
        raise ExportError(f"{out}: {why}; nothing was changed there: export again") from error
