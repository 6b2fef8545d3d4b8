"""What an export takes over from the older one at its place: a dataset that grew is exported again at the price of what is new.

`sources.json` of an export says with which code, packages and options it was made, the sha256 of every episode file and of
every file of the export, and what each file was made from that takes long to make. A file that would be made from the same by the
same is linked into the new export instead, if its bytes are still those; so is every other file that came out the same. An export
always is, byte for byte, what one to an empty directory would be; files that do not change keep their inode and time.
"""

import filecmp
import functools
import hashlib
import os
import shutil
from collections.abc import Mapping, Sequence
from contextlib import suppress
from importlib import metadata
from pathlib import Path
from typing import Any

from pipeline.data.keys import digest, file_hash
from pipeline.data.parsing import parse_json
from pipeline.data.reading import read_regular
from pipeline.data.store.mirror import fetch_below, mirror_of
from pipeline.export.shared.common import SOURCES, ExportError, foreign_files, source_of, write_json

ROOMS = ("data", "export", "motion")
"""Packages whose code decides the bytes of exports, beside poses.py."""

PACKAGES = ("av", "h5py", "lerobot", "numpy", "opencv-python-headless", "pandas", "pyarrow")


@functools.cache
def code() -> dict[str, str]:
    """Hash of the code that writes exports, and versions of the packages it uses."""
    root, h = Path(__file__).parents[2], hashlib.sha256()
    for path in sorted([root / "poses.py", *(file for room in ROOMS for file in (root / room).rglob("*.py"))]):
        h.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes())
    versions = {}
    for name in PACKAGES:
        with suppress(metadata.PackageNotFoundError):
            versions[name] = metadata.version(name)
    return {"code": h.hexdigest(), **versions}


class Older:
    """The export that a new one replaces; it lends nothing if it was made otherwise, or there is none."""

    def __init__(self, root: Path, made_with: Mapping[str, Any]) -> None:
        self.root = root
        fetch_below(root)
        self._sound: dict[str, bool] = {}
        self.files: dict[str, dict[str, Any]] = {}
        try:
            said = parse_json(read_regular(root / SOURCES))
            if digest(said["made_with"]) == digest(made_with):
                self.files = {str(name): dict(entry) for name, entry in said["files"].items()}
            self._names = {entry["from"]: name for name, entry in self.files.items()}
        except (OSError, ValueError, TypeError, KeyError, AttributeError):
            self.files, self._names = {}, {}

    def made_from(self, key: str) -> str | None:
        """Name of a file that was made from that and is as it was written, or None."""
        name = self._names.get(key)
        return name if name is not None and self.sound(name) else None

    def sound(self, name: str) -> Path | None:
        """A file by its relative name if its bytes are those that were written, or None."""
        path = self.root / name
        if name not in self._sound:
            inside = name in self.files and path.resolve().is_relative_to(self.root.resolve())
            try:
                self._sound[name] = inside and not path.is_symlink() and file_hash(path) == self.files[name].get("sha256")
            except OSError:
                self._sound[name] = False
        return path if self._sound[name] else None


class Draft:
    """An export while it is written to `folder`: take over what the older one has by `keep`, name what is written by `made`."""

    def __init__(self, folder: Path, out: Path, made_with: Mapping[str, Any]) -> None:
        self.folder, self.out = folder, out
        self.made_with = {**made_with, "with": code()}
        self.older = Older(out, self.made_with)
        self._hashes: dict[Path, str] = {}
        self._files: dict[str, dict[str, Any]] = {}

    def hash_of(self, episode: Path) -> str:
        """sha256 of an episode file. Raises ExportError for one that cannot be read."""
        if episode not in self._hashes:
            try:
                self._hashes[episode] = file_hash(episode)
            except OSError as error:
                raise ExportError(f"{episode}: cannot be read ({error.strerror}); run the build again") from error
        return self._hashes[episode]

    def keep(self, path: Path, made_from: Any, **facts: Any) -> bool:
        """Whether the older export has a file made from the same (plain data); it then is at `path`, below `folder`, too."""
        key = digest([_kind(path), made_from])
        older = self.older.made_from(key)
        if older is None:
            return False
        path.parent.mkdir(parents=True, exist_ok=True)
        _link(self.older.root / older, path)
        if older != self._name(path) and mirror_of(self.out):
            os.utime(path)  # an object of that name has other bytes
        self._files[self._name(path)] = {"from": key, "sha256": self.older.files[older]["sha256"], **facts}
        return True

    def record(self, path: Path, made_from: Any, **facts: Any) -> None:
        """Record what a written file was made from; `facts` are stored with it."""
        self._files[self._name(path)] = {"from": digest([_kind(path), made_from]), "sha256": file_hash(path), **facts}

    def _name(self, path: Path) -> str:
        return path.relative_to(self.folder).as_posix()

    def finish(self, dataset: Path, episodes: Sequence[Path]) -> None:
        """Write sources.json, and take over every other file that the older export has with the same name and bytes."""
        hashes = {source_of(path, dataset): self.hash_of(path) for path in episodes}
        others = {name: file_hash(self.folder / name) for name in hashed_names(self.folder) if name not in self._files}
        said = {"made_with": self.made_with, "episodes": hashes, "files": self._files, "sha256": others}
        write_json(self.folder / SOURCES, said)
        for path in sorted(self.folder.rglob("*")):
            older = self.out / path.relative_to(self.folder)
            if path.is_file() and older.is_file() and not older.is_symlink() and _same(path, older):
                path.unlink()
                _link(older, path)


def _kind(path: Path) -> str:
    """The suffix of a file without what numbers it: ".tfrecord" of a.tfrecord-00000-of-00002."""
    return path.suffix.partition("-")[0]


def hashed_names(folder: Path) -> list[str]:
    """Names of the files of an export whose hashes are kept, sorted: not sources.json itself, nor cards, which people edit."""
    found = (path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
    return sorted(name for name in found if name != SOURCES and not name.endswith(".md"))


def changed_files(out: Path) -> list[str]:
    """Files of an export that are missing, changed, or not written by it though they have a name of its own; one line each.

    Raises ExportError if its sources.json cannot be read."""
    try:
        said = parse_json(read_regular(out / SOURCES))
        written = {name: entry["sha256"] for name, entry in said["files"].items()} | said["sha256"]
        found = hashed_names(out)
        problems = [f"{out / name}: is missing" for name in sorted(set(written) - set(found))]
        foreign = {path.relative_to(out).as_posix() for path in foreign_files(out)}
        problems += [f"{out / name}: belongs to nothing that was exported" for name in found if name not in {*written, *foreign}]
        changed = (name for name in found if name in written and file_hash(out / name) != written[name])
        return problems + [f"{out / name}: is not what was written" for name in changed]
    except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
        raise ExportError(f"{out / SOURCES}: cannot be read ({' '.join(str(error).split())[:200]})") from error


def _same(path: Path, other: Path) -> bool:
    return not os.path.samefile(path, other) and filecmp.cmp(path, other, shallow=False)


def _link(older: Path, path: Path) -> None:
    """Make `path` the same file, or where the file system has no links, a copy with the same time."""
    try:
        os.link(older, path)
    except OSError:
        shutil.copy2(older, path)
