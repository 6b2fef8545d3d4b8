"""Files of a dataset on an object store or any other file system that fsspec knows: listed, read,
written and deleted by name.

An object appears whole when it is written, or not at all, as a file that is renamed into its place.
A request that fails because the connection does is repeated a few times, with growing pauses. What
cannot be helped that way is a StoreError: one line.
"""

import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, wait
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import Any

from pipeline.data.errors import DominoError
from pipeline.data.store.errors import (
    ABSENT,
    AGAIN,
    GONE,
    LOCAL,
    THERE,
    chain,
    line_of,
    names_of,
    passes,
    why,
)

EXTRAS = {"s3": "s3", "s3a": "s3", "gs": "gcs", "gcs": "gcs"}
"""The extra of this package that a kind of URL needs."""

PAUSES = (1.0, 2.0, 4.0, 8.0)
"""Seconds between the tries of a request; each of them repeats what its library repeats by
itself."""

CONDITIONAL = ("s3", "s3a", "gs", "gcs", "memory")
"""Stores that can write an object only if it is not there, as one request, and with which that was
tried."""

ANSWER = 15.0
"""Seconds that a command waits for the first answer of a store."""

SILENCE, LISTING = 30.0, 300.0
"""Seconds that a request may take without an answer, of a small object and of a list of all, before
it is sent once more."""

SLOWEST = 50_000
"""Bytes a second by which a request that carries a file may take longer."""

WORD, HURRY = 15.0, 10.0
"""Seconds after which a command says what it waits for, and that it waits at most when it is about
to end."""

_POLL = 0.5

_HUB = "hf"
"""Its library keeps listings whatever it is told, and says which bytes one object has only when
asked."""

_IDENTITIES = (
    "ETag",
    "etag",
    "md5Hash",
    "blob_id",
    "LastModified",
    "last_modified",
    "updated",
    "mtime",
    "created",
)
"""What file systems call that which changes when a file does, the best first."""

_BATCH = 1000


class StoreError(DominoError):
    """An object store that does not do what is asked: one line with the URL and the fix."""


@dataclass(frozen=True)
class Listed:
    """An object in a listing: its length in bytes, and a text that changes when its bytes do."""

    size: int
    identity: str


class Store:
    """The objects below a URL, by names relative to it with slashes. Every method raises
    StoreError, and OSError for a fault of this machine's own disk."""

    def __init__(self, url: str, pauses: Sequence[float] = PAUSES) -> None:
        self.url, self._pauses = url.rstrip("/"), pauses
        self._hurried = self._silent = False

    @property
    def conditional(self) -> bool:
        """Whether the store can keep two commands apart that write: only such a one is written
        to."""
        return self._scheme in CONDITIONAL

    @property
    def _scheme(self) -> str:
        return self.url.partition(":")[0]

    @property
    def _fresh(self) -> dict[str, bool]:
        return {"refresh": True} if self._scheme == _HUB else {}

    @cached_property
    def _at(self) -> tuple[Any, str]:
        """The file system and the path of the URL in it."""
        import fsspec  # half a second, with that of the store's own library

        try:
            fs, path = fsspec.url_to_fs(
                self.url, use_listings_cache=False, skip_instance_cache=True
            )
        except (ImportError, ValueError) as error:
            extra = EXTRAS.get(self._scheme)
            fix = (
                f"pip install 'domino-data[{extra}]'"
                if extra
                else "install the package that fsspec names"
            )
            raise StoreError(f"{self.url}: {line_of(error)}: {fix}") from error
        return fs, path.rstrip("/")

    def hurry(self) -> None:
        """From now on, the command is about to end: no request is repeated, and after one without
        an answer none is sent."""
        self._hurried = True

    def reach(self, name: str, seconds: float = ANSWER) -> bytes | None:
        """As `read`, for a command's first request: raises StoreError, which names the server,
        where it does not answer in time."""
        # what is wrong with the session is wrong with the request, too, which says so
        with suppress(Exception):
            # loading what the client needs can take longer than the answer
            self._at[0].connect()
        return self._do("open", "", lambda fs, root: _cat(fs, f"{root}/{name}"), seconds, tries=1)

    def list(self) -> dict[str, Listed]:
        """Every object, by name; none where there is nothing yet."""

        def find(fs: Any, root: str) -> dict[str, Listed]:
            try:
                found = fs.find(root, detail=True, **self._fresh)
            # gcsfs; of a place in a bucket that is there nothing is found
            except FileNotFoundError as error:
                raise StoreError(f"cannot list {self.url}: {GONE} ({line_of(error)})") from error
            names = {
                path: path.removeprefix(root).lstrip("/")
                for path in found
                if path.startswith(f"{root}/")
            }
            return {
                name: _parse_info(found[path])
                for path, name in names.items()
                if name and not name.endswith("/")
            }

        return self._do("list", "", find, LISTING)

    def stat(self, name: str) -> Listed | None:
        """What is known of an object, None if there is none."""

        def info(fs: Any, root: str) -> Listed | None:
            try:
                found = self._info(fs, f"{root}/{name}")
            except FileNotFoundError:
                return None
            return _parse_info(found) if found["type"] == "file" else None

        return self._do("look for", name, info)

    def top(self) -> Sequence[str]:
        """Names without a slash of objects."""

        def ls(fs: Any, root: str) -> Sequence[str]:
            try:
                found = fs.ls(root, detail=True, **self._fresh)
            except FileNotFoundError:
                return []
            return [each["name"].rpartition("/")[2] for each in found if each["type"] == "file"]

        return self._do("list", "", ls)

    def get(self, name: str, path: Path, size: int = 0) -> None:
        """Write the bytes of an object, about `size`, to a file on this machine."""
        self._do(
            "read",
            name,
            lambda fs, root: fs.get_file(f"{root}/{name}", str(path)),
            SILENCE + size / SLOWEST,
        )

    def read(self, name: str) -> bytes | None:
        """The bytes of a small object, None if there is none."""
        return self._do("read", name, lambda fs, root: _cat(fs, f"{root}/{name}"))

    def put(self, path: Path, name: str) -> Listed:
        """Write a file of this machine as an object, replacing one of that name; what is known of
        it then."""

        def send(fs: Any, root: str) -> Listed:
            fs.put_file(str(path), f"{root}/{name}")
            return _parse_info(self._info(fs, f"{root}/{name}"))

        return self._do("write", name, send, SILENCE + path.stat().st_size / SLOWEST)

    def write(self, name: str, data: bytes) -> None:
        """Write a small object, replacing one of that name."""
        self._do("write", name, lambda fs, root: fs.pipe_file(f"{root}/{name}", data))

    def create(self, name: str, data: bytes) -> bool:
        """Write a small object of a `conditional` store unless there is one of that name; whether
        it was written."""

        def send(fs: Any, root: str) -> bool:
            try:
                fs.pipe_file(f"{root}/{name}", data, mode="create")
            except FileExistsError:
                return False
            except Exception as error:  # not every library has the exception of Python
                if names_of(error) & THERE:
                    return False
                raise
            return True

        return self._do("write", name, send)

    def delete(self, names: Sequence[str]) -> None:
        """Delete objects, as far as they are there."""
        for start in range(0, len(names), _BATCH):
            part = names[start : start + _BATCH]
            self._do(
                "delete",
                part[0],
                lambda fs, root, part=part: _delete(fs, [f"{root}/{name}" for name in part]),
            )

    def _info(self, fs: Any, path: str) -> Mapping[str, Any]:
        """The fsspec info dictionary of an object. Raises FileNotFoundError."""
        return fs.info(
            path, **self._fresh, **({"expand_info": True} if self._scheme == _HUB else {})
        )

    def _do[T](
        self,
        what: str,
        name: str,
        request: Callable[[Any, str], T],
        seconds: float = SILENCE,
        tries: int = 2,
    ) -> T:
        """The result of a request, which is repeated while the connection fails.

        It is given up after `tries` times `seconds` without an answer, even if the library of the
        store would try for longer."""
        said = f"cannot {what} {f'{self.url}/{name}' if name else self.url}"
        # what is being cleaned up was stopped, by the user or by the store
        if any(
            isinstance(error, KeyboardInterrupt | StoreError) for error in chain(sys.exception())
        ):
            self.hurry()
        (fs, root), began = self._at, time.monotonic()
        failed: Exception | None = None
        for pause in (*self._pauses, None):
            answer = _ask(lambda: request(fs, root))
            left = began + tries * seconds - time.monotonic()
            if not self._await(answer, said, min(seconds, left)):
                passed = time.monotonic() - began
                if pause is None or self._hurried or passed >= 0.99 * tries * seconds:
                    self._silent = self._hurried
                    last = f" ({line_of(failed)})" if failed else ""
                    raise StoreError(
                        f"{said}: {_server(fs)} has not answered for {passed:.0f} s: {AGAIN}{last}"
                    )
                continue
            try:
                return answer.result()
            except StoreError:
                raise
            except Exception as error:  # every library of a store has exceptions of its own
                if isinstance(error, OSError) and error.errno in LOCAL:
                    raise
                if pause is None or self._hurried or not passes(error):
                    raise StoreError(f"{said}: {why(error)}") from error
                failed = error
            time.sleep(pause)
        raise AssertionError("the last try returns or raises")

    def _await(self, answer: Future[Any], said: str, seconds: float) -> bool:
        """Whether an answer comes in time. A word on standard error says for what a command
        waits."""
        began, word = time.monotonic(), WORD
        while not self._silent and (passed := time.monotonic() - began) < seconds:
            if self._hurried and passed > max(HURRY, seconds - SILENCE):
                break
            if wait([answer], min(_POLL, seconds - passed)).done:
                return True
            if passed > word:
                word *= 2
                print(
                    f"domino-data: warning: {said}: no answer for {passed:.0f} s, still waiting",
                    file=sys.stderr,
                    flush=True,
                )
        return False


def _ask[T](request: Callable[[], T]) -> Future[T]:
    """The answer to a request, which is made in a thread: one of no pool, which would be waited for
    when the process ends."""
    answer = Future[T]()

    def ask() -> None:
        try:
            answer.set_result(request())
        except Exception as error:  # noqa: BLE001 - raised where the answer is wanted
            answer.set_exception(error)

    threading.Thread(target=ask, daemon=True).start()
    return answer


def _delete(fs: Any, paths: Sequence[str]) -> None:
    try:
        fs.rm(paths)
    except FileNotFoundError:  # some were gone; not every store says which
        for path in paths:
            with suppress(FileNotFoundError):
                fs.rm_file(path)


def _cat(fs: Any, path: str) -> bytes | None:
    """The bytes of an object, None if there is none in a bucket that is there."""
    try:
        return fs.cat_file(path)
    except FileNotFoundError as error:
        if names_of(error) & ABSENT:
            raise
        return None


def _server(fs: Any) -> str:
    """The address of a store's server, as far as its library reports it."""
    client = getattr(getattr(fs, "_s3", None), "meta", None)
    found = (
        getattr(client, "endpoint_url", None),
        *(getattr(fs, name, None) for name in ("endpoint_url", "endpoint", "host")),
    )
    return next((each for each in found if isinstance(each, str) and each), "the server")


def _parse_info(info: Mapping[str, Any]) -> Listed:
    """The listed object that an fsspec info dictionary describes."""
    said = next((info[key] for key in _IDENTITIES if info.get(key) is not None), None)
    if said is None:
        raise StoreError(
            f"{info['name']}: this store does not say which bytes an object has or when it changed:"
            " use another one"
        )
    # one file system says the same time once as a number and once as a date
    text = str(said.timestamp() if isinstance(said, datetime) else said)
    return Listed(int(info["size"] or 0), text.strip('"'))
