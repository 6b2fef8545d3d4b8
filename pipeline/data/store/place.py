"""A dataset on an object store: the directory in which a command works on it,
CACHE/places/URL~HOST.PROCESS.X/.

Files are pulled when read (data/reading.py) and put by the process that made them.
"""

import hashlib
import os
import re
import socket
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from functools import lru_cache
from pathlib import Path, PurePosixPath
from tempfile import mkdtemp
from urllib.parse import quote, unquote

from pipeline.data.atomic import remove, temporary_name
from pipeline.data.names import MANIFEST
from pipeline.data.process.machine import CACHE, user_cache

from .files import LEASE, Listed, Store, StoreError

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
        self._sizes: dict[str, dict[str, int]] | None = None
        self._same = dict[str, tuple[int, int]]()

    def name(self, path: Path) -> str:
        """The name of a file's object."""
        return path.relative_to(self.root).as_posix()

    def sizes(self) -> Mapping[str, Mapping[str, int]]:
        """The bytes of all objects, by directory and name, listed once."""
        if self._sizes is None:
            self._sizes = {}
            for name, each in _objects(self.store).items():
                self.note(self.root / name, each.size)
        return self._sizes

    def note(self, path: Path, size: int | None) -> None:
        """Note the bytes of a file that is on the store now, None for one that is not."""
        if self._sizes is not None:
            folder = self._sizes.setdefault(str(path.parent), {})
            folder.pop(path.name, None) if size is None else folder.update({path.name: size})

    def size(self, path: Path) -> int:
        """The bytes of a file's object, -1 if there is none."""
        return self.sizes().get(str(path.parent), {}).get(path.name, -1)

    def files(self, pattern: str = ALL) -> list[Path]:
        """The files of all objects that match a pattern, sorted."""
        paths = (Path(folder, name) for folder, each in self.sizes().items() for name in each)
        return sorted(path for path in paths if re.fullmatch(pattern, self.name(path)))

    def pull(self, pattern: str) -> None:
        """Fetch the matching objects that are not here."""
        _on_threads(self.fetch, (path for path in self.files(pattern) if not path.exists()))

    def fetch(self, path: Path) -> bool:
        """Get a file that is not here; whether there is one."""
        size = USUAL if self._sizes is None else self.size(path)
        if size < 0 or not _get(self.store, self.name(path), path, size):
            return False
        self._same[self.name(path)] = _state(path)
        return True

    def has(self, path: Path) -> bool:
        """Whether the store has the file as it is here."""
        return path.exists() and self._same.get(self.name(path)) == _state(path)

    def put(self, paths: Iterable[Path]) -> None:
        """Put files that the store does not have from here."""
        _on_threads(self._put, (path for path in paths if not self.has(path)))

    def _put(self, path: Path) -> None:
        state = _state(path)
        self.store.put(path, self.name(path))
        self._same[self.name(path)] = state
        self.note(path, state[0])

    def put_new(self) -> None:
        for paths in _in_order(self.root):
            self.put(path for path in paths if not path.name.endswith(".tmp"))

    def delete(self, paths: Iterable[Path]) -> None:
        paths = list(paths)
        self.store.delete([self.name(path) for path in paths])
        for path in paths:
            self.note(path, None)


@lru_cache(64)
def _place(root: Path) -> Place:
    return Place(root, unquote(root.name.rpartition("~")[0]))


def place_of(path: Path) -> Place | None:
    """The place in whose directory a path is, if any."""
    parts = Path(path).parts
    for number in range(1, len(parts)):
        if parts[number - 1] == FOLDER and "%3A%2F%2F" in parts[number]:
            return _place(Path(*parts[: number + 1]))
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
            place.pull(pattern)
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


def fetch_below(folder: Path) -> None:
    """Get all files below a directory from its store, if any. Raises StoreError."""
    if place := place_of(folder):
        place.pull(f"{re.escape(place.name(folder))}/.*")


@contextmanager
def replace_directory(folder: Path) -> Iterator[None]:
    """Replace a directory; its store objects are replaced at the block's end. Raises StoreError."""
    place = place_of(folder)
    before = place.files(f"{re.escape(place.name(folder))}/.*") if place else []
    yield
    if place:
        place.put_new()
        place.delete(path for path in before if not path.exists())


def pull(url: str, folder: Path) -> tuple[int, int]:
    """Fetch what differs below a URL: how many files there are, and were fetched. Raises
    StoreError.
    """
    store = Store(url)
    there = {folder / name: (name, each) for name, each in _objects(store).items()}
    if not there:
        raise StoreError(f"{url}: there is nothing: name the URL of a dataset or an export")
    new = [path for path, (_, each) in there.items() if not _is_same(path, each)]
    _on_threads(lambda path: _get(store, there[path][0], path, there[path][1].size), new)
    return len(there), len(new)


def push(folder: Path, url: str) -> tuple[int, int]:
    """Put the files that differ below a URL: how many there are, and were put. Raises
    StoreError, Busy.
    """
    store, count = Store(url), [0, 0]

    def name(path: Path) -> str:
        return path.relative_to(folder).as_posix()

    with store.hold():
        there = _objects(store)
        for paths in _in_order(folder):
            new = [path for path in paths if not _is_same(path, there.get(name(path)))]
            _on_threads(lambda path: store.put(path, name(path)), new)
            count = [count[0] + len(paths), count[1] + len(new)]
    return count[0], count[1]


def _objects(store: Store) -> dict[str, Listed]:
    """The objects that can be files below a directory."""
    names = store.list()
    for name in [*names]:
        plain = str(PurePosixPath("/", name)) == f"/{name}" and not {"..", "."} & {*name.split("/")}
        if name == LEASE or not plain:
            del names[name]
    return names


def _in_order(folder: Path) -> tuple[list[Path], list[Path]]:
    """Every file below a directory but those that name others, and these."""
    paths = [Path(where, name) for where, _, names in os.walk(folder) for name in names]
    last = [path for path in paths if _LAST.match(path.relative_to(folder).as_posix())]
    return [path for path in paths if path not in set(last)], last


def _on_threads(work: Callable[[Path], object], paths: Iterable[Path]) -> None:
    with ThreadPoolExecutor(_THREADS) as threads:
        try:
            for done in [threads.submit(work, path) for path in paths]:
                done.result()
        except BaseException:
            threads.shutdown(wait=False, cancel_futures=True)
            raise


def _get(store: Store, name: str, path: Path, size: int) -> bool:
    # two threads may want the same file
    temporary = temporary_name(path.with_name(f"{path.name}.{threading.get_ident()}"))
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        if found := store.get(name, temporary, size):
            os.replace(temporary, path)
        return found
    finally:
        temporary.unlink(missing_ok=True)


def _is_same(path: Path, there: Listed | None) -> bool:
    """Whether length, and MD5 if stated, are an object's."""
    if there is None or not path.is_file() or path.stat().st_size != there.size:
        return False
    with open(path, "rb") as file:
        return not there.md5 or hashlib.file_digest(file, "md5").hexdigest() == there.md5


def _state(path: Path) -> tuple[int, int]:
    state = path.stat()
    return state.st_size, state.st_mtime_ns


def with_urls(text: str) -> str:
    """A text with the URLs of places for their directories."""
    folder = re.escape(str(user_cache(FOLDER)))
    pattern = rf"{folder}/(\w+%3A%2F%2F[^\s/~:;,'\"]+)~[\w.-]+\.\d+\.\w+"
    return re.sub(pattern, lambda match: unquote(match[1]), text)
