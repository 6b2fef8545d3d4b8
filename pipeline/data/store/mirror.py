"""Datasets on an object store: the directory of this machine that stands for one while a command
works on it.

    CACHE/mirrors/s3%3A%2F%2Fbucket%2Fset/        what is below s3://bucket/set, file for object
    CACHE/mirrors/s3%3A%2F%2Fbucket%2Fset~1/      the same for a second command at the same time

A mirror says by its name what it mirrors, so that any process on any machine knows it from a path.
Its files are of three kinds:

- written here: last changed when it was written;
- the same as the object: its time of change, before 1999, is made from what the store says of the
  object (`mark`), so that the stamps (stamps.py) of a file are the same on all machines, and change
  when the object does;
- listed only: as the former, with its length, without its bytes and without the permission to read
  it (LISTED). Reading it through data/reading.py fetches it first.

Nothing that is only in a mirror counts: what the store lacks is removed when the next command
pulls.
"""

import os
import re
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from functools import lru_cache
from pathlib import Path, PurePosixPath
from urllib.parse import unquote

from pipeline.data.atomic import remove, temporary_name
from pipeline.data.names import MANIFEST
from pipeline.data.store.files import Store, StoreError
from pipeline.data.store.lease import LEASE, hold_lease
from pipeline.data.store.mirror_files import is_listed, is_new, list_only, mark, state_of
from pipeline.data.store.places import free_place
from pipeline.data.store.urls import FOLDER

_THREADS = 8
STOPPED = 130
"""The exit code of a command that the user stopped."""
_AT_ONCE = re.compile(r"[^/]+|(assets/robots|report/failed)/.*|annotations/[^/]+/stage\.json")
"""What is fetched when a mirror is pulled: what is small, and what libraries read by themselves."""
_LAST = re.compile(r"[^/]+$|report/|exports/[^/]+/export\.json$")
"""What is sent after everything else: what names other files."""


def mirror_of(path: Path) -> "Mirror | None":
    """The mirror that a path is in, None for every other path."""
    parts = Path(path).parts
    for number in range(len(parts) - 1, 0, -1):
        if (
            parts[number - 1] == FOLDER
            and "%3A%2F%2F" in parts[number]
            and not parts[number].startswith(".")
        ):
            return _mirror(Path(*parts[: number + 1]))
    return None


@lru_cache(maxsize=64)
def _mirror(root: Path) -> "Mirror":
    return Mirror(root)


class Mirror:
    """A directory that mirrors a store."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.url = unquote(root.name.partition("~")[0])
        self.store = Store(self.url)
        self.lost = threading.Event()
        """Whether another command has taken over the writing."""

    def name(self, path: Path) -> str:
        """The object that a file of the mirror stands for."""
        return path.relative_to(self.root).as_posix()

    def pull(self) -> None:
        """Make the mirror what the store holds: small files fetched, all others listed only."""
        listed = {
            name: each
            for name, each in self.store.list().items()
            if _plain(name) and not name.startswith(LEASE)
        }
        self.root.mkdir(parents=True, exist_ok=True)
        for path in list(self._files()):
            if self.name(path) not in listed:
                remove(path)
        wanted = []
        for name, each in listed.items():
            path = self.root / name
            if state_of(path) != (each.size, mark(each)):
                list_only(path, each.size, mark(each))
            if _AT_ONCE.fullmatch(name) and is_listed(path):
                wanted.append(path)
        self.fetch(wanted)

    def fetch(self, paths: Iterable[Path]) -> None:
        """Get the bytes of files that are listed only."""
        _on_threads(self._fetch, [path for path in paths if is_listed(path)])

    def fetch_below(self, folder: Path) -> None:
        """As `fetch`, for everything below a directory."""
        self.fetch([path for path in folder.rglob("*") if not path.is_dir()])

    def find(self, path: Path) -> bool:
        """Get a file that is not in the mirror, nor was when it was pulled: another machine wrote
        it. Whether there is one."""
        listed = self.store.stat(self.name(path))
        if listed is None:
            return False
        list_only(path, listed.size, mark(listed))
        self._fetch(path)
        return True

    def push(self, paths: Iterable[Path]) -> None:
        """Write those of some files that were written here to the store, all at once."""
        self._check()
        _on_threads(self._push, [path for path in paths if is_new(path)])

    def push_all(self) -> None:
        """Write to the store what was written here: first what others name, then the index, then
        the rest."""
        files = [
            path
            for path in self._files()
            if is_new(path) and not path.name.endswith((".tmp", ".running", "-journal"))
        ]
        names = {path: self.name(path) for path in files}
        last = [path for path in files if _LAST.match(names[path])]
        self.push(path for path in files if path not in set(last))
        self.push(last)

    def drop(self, path: Path) -> None:
        """Free the space of a file that is the same as its object: it is listed only then."""
        state = path.stat()
        if not is_new(path) and not is_listed(path):
            temporary = temporary_name(path)
            try:
                list_only(temporary, state.st_size, state.st_mtime_ns)
                os.replace(temporary, path)
            finally:
                temporary.unlink(missing_ok=True)

    def delete(self, paths: Iterable[Path]) -> None:
        """Delete the objects of files, which are gone from the mirror."""
        names = [self.name(path) for path in paths]
        if names:
            self._check()
            self.store.delete(names)

    def _check(self) -> None:
        if self.lost.is_set():
            raise StoreError(
                f"{self.url}: another command has begun to write it, since this one did not answer"
                " for minutes"
            )

    def _fetch(self, path: Path) -> None:
        # two threads may want the same file
        state, temporary = (
            path.stat(),
            temporary_name(path.with_name(f"{path.name}.{threading.get_ident()}")),
        )
        try:
            self.store.get(self.name(path), temporary, state.st_size)
            if temporary.stat().st_size != state.st_size:
                raise StoreError(
                    f"{self.url}/{self.name(path)}: was changed while it was read: run the command"
                    " again"
                )
            os.utime(temporary, ns=(state.st_mtime_ns, state.st_mtime_ns))
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)

    def _push(self, path: Path) -> None:
        listed = self.store.put(path, self.name(path))
        if listed.size != path.stat().st_size:
            raise StoreError(
                f"{self.url}/{self.name(path)}: has {listed.size} bytes after it was written: run"
                " the command again"
            )
        os.utime(path, ns=(mark(listed), mark(listed)))

    def _files(self) -> Iterator[Path]:
        for folder, _, names in os.walk(self.root):
            yield from (Path(folder, name) for name in names)


def fetch(path: Path) -> bool:
    """Get the bytes of a file that is listed only, or that another machine wrote; False for one in
    no mirror, or not there."""
    mirror = mirror_of(path)
    if mirror is None:
        return False
    if os.path.lexists(path):
        mirror.fetch([path])
        return True
    return mirror.find(path)


def fetch_below(folder: Path) -> None:
    """As `fetch`, for all files below a directory that are listed only: for libraries that read
    them by themselves."""
    mirror = mirror_of(folder)
    if mirror is not None:
        mirror.fetch_below(folder)


def upload(*paths: Path) -> None:
    """Write files to the store that they belong to, if any, so that they are there when this
    returns. Raises StoreError."""
    mirror = mirror_of(paths[0]) if paths else None
    if mirror is not None:
        mirror.push(paths)


def delete_uploaded(*paths: Path) -> None:
    """Delete files that are gone from the store that they belonged to, if any. Raises
    StoreError."""
    mirror = mirror_of(paths[0]) if paths else None
    if mirror is not None:
        mirror.delete(paths)


def free_space(path: Path) -> None:
    """Free the space of a file that its store has, too; any other file stays."""
    mirror = mirror_of(path)
    if mirror is not None and os.path.lexists(path):
        mirror.drop(path)


@contextmanager
def replace_directory(folder: Path) -> Iterator[None]:
    """Within, a directory is replaced by another. Where it is in a mirror, its objects are replaced
    at the end; nothing happens to them where the block fails. Raises StoreError."""
    mirror = mirror_of(folder)
    before = [path for path in folder.rglob("*") if not path.is_dir()] if mirror else []
    yield
    if mirror is not None:
        mirror.push_all()
        mirror.delete(path for path in before if not os.path.lexists(path))


@contextmanager
def open_url(url: str, writes: bool = True, made: bool = False) -> Iterator[Path]:
    """A directory with what is below a URL, for one command, which may be one of several at the
    same time.

    What `writes` changed in it is written to the store at the end, unless a StoreError ends the
    block: it would come again. A directory in which nothing is then, and one of no dataset where
    the block fails, is removed. Raises StoreError, before anything is fetched, if there is no
    dataset and there must be one that is `made`.
    """
    with free_place(url) as place:
        mirror = _mirror(place)
        if mirror.store.reach(MANIFEST) is None and made:
            raise StoreError(f"{url} is no dataset: it has no {MANIFEST}")
        with hold_lease(mirror.store) if writes else nullcontext(threading.Event()) as mirror.lost:
            try:
                mirror.pull()
            except StoreError:
                mirror.store.hurry()
                raise
            try:
                yield mirror.root
            except BaseException as error:
                if (
                    isinstance(error, StoreError | KeyboardInterrupt)
                    or getattr(error, "exit_code", 0) == STOPPED
                ):
                    mirror.store.hurry()
                if writes and not isinstance(error, StoreError):
                    mirror.push_all()
                if not os.path.lexists(mirror.root / MANIFEST):
                    remove(mirror.root)
                raise
            if writes:
                mirror.push_all()


def _plain(name: str) -> bool:
    """Whether an object's name can be a path below a directory."""
    parts = PurePosixPath(name).parts
    return (
        bool(parts)
        and ".." not in parts
        and not name.startswith("/")
        and "\0" not in name
        and str(PurePosixPath(name)) == name
    )


def _on_threads(work: Callable[[Path], None], paths: list[Path]) -> None:
    if len(paths) < 2:
        for path in paths:
            work(path)
        return
    with ThreadPoolExecutor(min(_THREADS, len(paths))) as threads:
        try:
            for done in [threads.submit(work, path) for path in paths]:
                done.result()
        except BaseException:
            threads.shutdown(wait=False, cancel_futures=True)
            raise
