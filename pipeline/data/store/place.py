"""A dataset on an object store: the directory in which a command works on it,
CACHE/places/URL~HOST.PROCESS.X/.

Files are pulled when read (data/reading.py) and put by the process that made them.
"""

import os
import re
import socket
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from functools import lru_cache
from pathlib import Path
from tempfile import mkdtemp
from urllib.parse import quote, unquote

from pipeline.data.atomic import file_state, remove, temporary_name
from pipeline.data.names import MANIFEST
from pipeline.data.process.machine import CACHE, user_cache

from .files import Store, StoreError

FOLDER = "places"

SMALL = r"[^/]+|assets/robots/.*|report/failed/.*|annotations/[^/]+/stage\.json"
"""What every command pulls first: what is small, and what libraries read by themselves."""

REPORT, ALL = rf"{SMALL}|report/.*", r"(?!exports/|logs/).*"

_LAST = re.compile(r"[^/]+$|report/|exports/[^/]+/export\.json$")
"""What names other files, and is put after them."""

_THREADS, USUAL = 8, 10**7  # bytes of a file of unknown size


class Place:
    """A directory for what a store holds. Raises StoreError."""

    def __init__(self, root: Path, url: str) -> None:
        self.root, self.store = root, Store(url)
        self._sizes: dict[str, int] | None = None
        self._same = dict[str, tuple[int, int]]()

    def name(self, path: Path) -> str:
        """The name of a file's object."""
        return path.relative_to(self.root).as_posix()

    def sizes(self) -> Mapping[str, int]:
        """The bytes of all objects by name, listed once."""
        if self._sizes is None:
            self._sizes = self.store.list()
        return self._sizes

    def note(self, path: Path, size: int) -> None:
        """Note the bytes of a file that is on the store now."""
        if self._sizes is not None:
            self._sizes[self.name(path)] = size

    def size(self, path: Path) -> int:
        """The bytes of a file's object, -1 if there is none."""
        return self.sizes().get(self.name(path), -1)

    def files(self, pattern: str = ALL) -> list[Path]:
        """The files of all objects whose names match a pattern, sorted."""
        return sorted(self.root / name for name in self.sizes() if re.fullmatch(pattern, name))

    def below(self, folder: Path) -> list[Path]:
        """The files of all objects below a directory."""
        return self.files(f"{re.escape(self.name(folder))}/.*")

    def pull(self, paths: Iterable[Path]) -> None:
        """Fetch files."""
        _on_threads(self.fetch, paths)

    def fetch(self, path: Path) -> bool:
        """Get a file that is not here; whether there is one."""
        size = USUAL if self._sizes is None else self.size(path)
        # two threads may want the same file
        temporary = temporary_name(path.with_name(f"{path.name}.{threading.get_ident()}"))
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            if size < 0 or not self.store.get(self.name(path), temporary, size):
                return False
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)
        self._same[self.name(path)] = file_state(path)
        return True

    def has(self, path: Path) -> bool:
        """Whether the store has the file as it is here."""
        return path.exists() and self._same.get(self.name(path)) == file_state(path)

    def put(self, paths: Iterable[Path]) -> None:
        """Put files that the store does not have from here, those that name others last."""
        new = [path for path in paths if not self.has(path)]
        last = {path for path in new if _LAST.match(self.name(path))}
        _on_threads(self._put, (path for path in new if path not in last))
        _on_threads(self._put, last)

    def _put(self, path: Path) -> None:
        state = file_state(path)
        self.store.put(path, self.name(path))
        self._same[self.name(path)] = state
        self.note(path, state[0])

    def put_new(self) -> None:
        """Put what is whole here and not on the store."""
        files = (path for path in self.root.rglob("*") if path.is_file())
        self.put(path for path in files if path.suffix != ".tmp")

    def delete(self, paths: Iterable[Path]) -> None:
        names = [self.name(path) for path in paths]
        self.store.delete(names)
        if self._sizes is not None:
            for name in names:
                self._sizes.pop(name, None)


@lru_cache(64)
def _place(root: Path) -> Place:
    return Place(root, unquote(root.name.rpartition("~")[0]))


def place_of(path: Path) -> Place | None:
    """The place in whose directory a path is, if any."""
    for each in (path, *path.parents):
        if each.parent.name == FOLDER and "%3A%2F%2F" in each.name:
            return _place(each)
    return None


@contextmanager
def open_place(url: str, pattern: str = SMALL, writes: bool = False) -> Iterator[Path]:
    """A directory with what matches below a URL; what is written there is put to the store.
    Raises StoreError, Busy.
    """
    place = _place(_new_root(url))
    try:
        place.store.read(MANIFEST)  # a silent store is known soon
        with place.store.hold() if writes else nullcontext():
            place.pull(place.files(pattern))
            try:
                yield place.root
            except StoreError:
                writes = False
                raise
            finally:
                if writes:
                    place.put_new()
    finally:
        remove(place.root)


def _new_root(url: str) -> Path:
    """This process's directory; removes those of dead local ones."""
    name, host, folder = quote(url, safe=""), socket.gethostname(), user_cache(FOLDER)
    if folder is None or len(name) > 180:
        raise StoreError(f"{url}: is too long: name a shorter one" if folder else f"set {CACHE}")
    folder.mkdir(parents=True, exist_ok=True)
    for left in folder.glob(f"*~{host}.*"):
        if not Path("/proc", left.name.split(".")[-2]).exists():
            remove(left)
    return Path(mkdtemp(prefix=f"{name}~{host}.{os.getpid()}.", dir=folder))


def is_there(path: Path) -> bool:
    """Whether a file is here, or on its dataset's store."""
    return path.exists() or bool((place := place_of(path)) and place.size(path) >= 0)


def put(*paths: Path) -> None:
    """Put files to their dataset's store, if any. Raises StoreError."""
    if paths and (place := place_of(paths[0])):
        place.put(paths)


def delete(*paths: Path) -> None:
    """Delete files that are gone from their dataset's store, if any."""
    if paths and (place := place_of(paths[0])):
        place.delete(paths)


def drop(path: Path) -> None:
    """Remove a file from this machine if its store has it."""
    if (place := place_of(path)) and place.has(path):
        path.unlink()


@contextmanager
def replace_directory(folder: Path) -> Iterator[None]:
    """Replace a directory; its store objects are replaced at the block's end. Raises StoreError."""
    place = place_of(folder)
    before = place.below(folder) if place else []
    yield
    if place:
        place.put_new()
        place.delete(path for path in before if not path.exists())


def _on_threads(work: Callable[[Path], object], paths: Iterable[Path]) -> None:
    with ThreadPoolExecutor(_THREADS) as threads:
        list(threads.map(work, paths))


def with_urls(text: str) -> str:
    """A text with the URLs of places for their directories."""
    folder = re.escape(str(user_cache(FOLDER)))
    pattern = rf"{folder}/(\w+%3A%2F%2F[^\s/~:;,'\"]+)~[\w.-]+\.\d+\.\w+"
    return re.sub(pattern, lambda match: unquote(match[1]), text)
