"""Files of a dataset on an object store or any other file system that fsspec knows: listed, read, written and deleted by name.

An object appears whole when it is written, or not at all, as a file that is renamed into its place. A request that fails because
the connection does is repeated a few times, with growing pauses. What cannot be helped that way is a StoreError: one line.
"""

import errno
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import Any

from pipeline.data.errors import DominoError

EXTRAS = {"s3": "s3", "s3a": "s3", "gs": "gcs", "gcs": "gcs"}
"""The extra of this package that a kind of URL needs."""

PAUSES = (1.0, 2.0, 4.0, 8.0)
"""Seconds between the tries of a request; each of them repeats what its library repeats by itself."""

ANSWER = 8.0
"""Seconds that a command waits for the first answer of a store."""

_IDENTITIES = ("ETag", "etag", "md5Hash", "blob_id", "LastModified", "last_modified", "updated", "mtime", "created")
"""What file systems call that which changes when a file does, the best first."""

_BATCH = 1000
_AGAIN = "check the network and the endpoint, and the same command goes on"
_LOCAL = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.ENOTCONN, errno.ESTALE, errno.EIO)
_PASSING = (errno.EBUSY, getattr(errno, "EREMOTEIO", errno.EIO))
_LOST = {"ConnectionError", "TimeoutError", "HTTPClientError", "ClientConnectionError", "ClientPayloadError", "TransportError"}
_ANONYMOUS = {"NoCredentialsError", "PartialCredentialsError", "CredentialRetrievalError", "DefaultCredentialsError"}
_EXPIRED = {"ExpiredToken", "ExpiredTokenException", "RequestExpired", "TokenRefreshRequired", "UnauthorizedSSOTokenError"} | {
    *("TokenRetrievalError", "SSOTokenLoadError", "RefreshError", "InvalidToken")
}
_WRONG = {"InvalidAccessKeyId", "SignatureDoesNotMatch", "401", "LocalTokenNotFoundError"}
_ABSENT = {"NoSuchBucket", "RepositoryNotFoundError", "RevisionNotFoundError"}


class StoreError(DominoError):
    """An object store that does not do what is asked: one line with the URL and the fix."""


@dataclass(frozen=True)
class Listed:
    """What a listing says of an object: its length in bytes, and a text that changes when its bytes do."""

    size: int
    identity: str


class Store:
    """The objects below a URL, by names relative to it with slashes. Every method raises StoreError, and OSError for a fault of
    this machine's own disk."""

    def __init__(self, url: str, pauses: Sequence[float] = PAUSES) -> None:
        self.url, self._pauses = url.rstrip("/"), pauses
        self._failed: Exception | None = None

    @cached_property
    def _at(self) -> tuple[Any, str]:
        """The file system and the path of the URL in it."""
        import fsspec  # half a second, with that of the store's own library

        try:
            fs, path = fsspec.url_to_fs(self.url, use_listings_cache=False, skip_instance_cache=True)
        except (ImportError, ValueError) as error:
            extra = EXTRAS.get(self.url.partition(":")[0])
            fix = f"pip install 'domino-data[{extra}]'" if extra else "install the package that fsspec names"
            raise StoreError(f"{self.url}: {_line(error)}: {fix}") from error
        return fs, path.rstrip("/")

    def reach(self, name: str, seconds: float = ANSWER) -> bytes | None:
        """As `read`, for a command's first request: raises StoreError, which names the server, where it does not answer in time,
        however long the library of the store would go on to try."""
        answer = Future[bytes | None]()

        def ask() -> None:
            try:
                answer.set_result(self._do("open", "", lambda fs, root: _cat(fs, f"{root}/{name}")))
            except (StoreError, OSError) as error:
                answer.set_exception(error)

        # none of a pool, which would be waited for when the process ends
        threading.Thread(target=ask, daemon=True).start()
        try:
            return answer.result(seconds)
        except TimeoutError as error:
            server = _server(self.__dict__.get("_at", (None,))[0])
            last = f" ({_line(self._failed)})" if self._failed else ""
            said = f"{server} has not answered for {seconds:.0f} s: {_AGAIN}{last}"
            raise StoreError(f"cannot open {self.url}: {said}") from error

    def list(self) -> dict[str, Listed]:
        """Every object, by name; none where there is nothing yet."""

        def find(fs: Any, root: str) -> dict[str, Listed]:
            found = fs.find(root, detail=True)
            names = {path: path.removeprefix(root).lstrip("/") for path in found if path.startswith(f"{root}/")}
            return {name: _listed(found[path]) for path, name in names.items() if name and not name.endswith("/")}

        return self._do("list", "", find)

    def stat(self, name: str) -> Listed | None:
        """What is known of an object, None where there is none."""

        def info(fs: Any, root: str) -> Listed | None:
            try:
                found = fs.info(f"{root}/{name}")
            except FileNotFoundError:
                return None
            return _listed(found) if found["type"] == "file" else None

        return self._do("look for", name, info)

    def get(self, name: str, path: Path) -> None:
        """Write the bytes of an object to a file on this machine."""
        self._do("read", name, lambda fs, root: fs.get_file(f"{root}/{name}", str(path)))

    def read(self, name: str) -> bytes | None:
        """The bytes of a small object, None where there is none."""
        return self._do("read", name, lambda fs, root: _cat(fs, f"{root}/{name}"))

    def put(self, path: Path, name: str) -> Listed:
        """Write a file of this machine as an object, replacing one of that name; what is known of it then."""

        def send(fs: Any, root: str) -> Listed:
            fs.put_file(str(path), f"{root}/{name}")
            return _listed(fs.info(f"{root}/{name}"))

        return self._do("write", name, send)

    def write(self, name: str, data: bytes) -> None:
        """Write a small object, replacing one of that name."""
        self._do("write", name, lambda fs, root: fs.pipe_file(f"{root}/{name}", data))

    def create(self, name: str, data: bytes) -> bool:
        """Write a small object unless there is one of that name; whether it was written. Some stores cannot do both at once:
        two that ask in the same moment are both told yes."""

        def send(fs: Any, root: str) -> bool:
            path = f"{root}/{name}"
            try:
                fs.pipe_file(path, data, mode="create")
            except (NotImplementedError, TypeError, ValueError):
                if fs.exists(path):
                    return False
                fs.pipe_file(path, data)
            except FileExistsError:
                return False
            except OSError as error:
                if "PreconditionFailed" in _names(error):
                    return False
                raise
            return True

        return self._do("write", name, send)

    def delete(self, names: Sequence[str]) -> None:
        """Delete objects, as far as they are there."""
        for start in range(0, len(names), _BATCH):
            part = names[start : start + _BATCH]
            self._do("delete", part[0], lambda fs, root, part=part: _delete(fs, [f"{root}/{name}" for name in part]))

    def _do[T](self, what: str, name: str, request: Callable[[Any, str], T]) -> T:
        """The result of a request, which is repeated while the connection fails."""
        url = f"{self.url}/{name}" if name else self.url
        for pause in (*self._pauses, None):
            try:
                return request(*self._at)
            except StoreError:
                raise
            except Exception as error:  # every library of a store has exceptions of its own
                if isinstance(error, OSError) and error.errno in _LOCAL:
                    raise
                if pause is None or not _passes(error):
                    raise StoreError(f"cannot {what} {url}: {_why(error)}") from error
                self._failed = error
            time.sleep(pause)
        raise AssertionError("the last try returns or raises")


def _cat(fs: Any, path: str) -> bytes | None:
    """The bytes of an object, None where there is none in a bucket that is there."""
    try:
        return fs.cat_file(path)
    except FileNotFoundError as error:
        if _names(error) & _ABSENT:
            raise
        return None


def _server(fs: Any) -> str:
    """The address of a store's server, as far as its library says it."""
    client = getattr(getattr(fs, "_s3", None), "meta", None)
    found = (getattr(client, "endpoint_url", None), *(getattr(fs, name, None) for name in ("endpoint_url", "endpoint", "host")))
    return next((each for each in found if isinstance(each, str) and each), "the server")


def _delete(fs: Any, paths: list[str]) -> None:
    try:
        fs.rm(paths)
    except FileNotFoundError:  # some were gone; not every store says which
        for path in paths:
            if fs.exists(path):
                fs.rm_file(path)


def _listed(info: Mapping[str, Any]) -> Listed:
    """What a listing says, from what fsspec says of an object."""
    said = next((info[key] for key in _IDENTITIES if info.get(key) is not None), "")
    # one file system says the same time once as a number and once as a date
    text = str(said.timestamp() if isinstance(said, datetime) else said)
    return Listed(int(info["size"] or 0), text.strip('"'))


def _chain(error: BaseException | None) -> Iterator[BaseException]:
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__


def _names(error: BaseException) -> set[str]:
    """Names of the classes of an error and of what caused it, and codes that servers gave it."""
    found = set[str]()
    for each in _chain(error):
        found |= {kind.__name__ for kind in type(each).__mro__}
        response = getattr(each, "response", None)
        if isinstance(response, Mapping):
            found.add(str(response.get("Error", {}).get("Code")))
        status = getattr(response, "status_code", getattr(each, "code", None))
        found |= {str(status)} - {"None"}
    return found


def _passes(error: BaseException) -> bool:
    """Whether the same request may succeed a moment later."""
    busy = isinstance(error, OSError) and error.errno in _PASSING
    return busy or bool(_names(error) & _LOST)


def _why(error: BaseException) -> str:
    """One line on an error that is none of this machine's disk, with the fix."""
    names = _names(error)
    for known, said in (
        (_EXPIRED, "the credential has expired: renew it, and the same command goes on"),
        (_ANONYMOUS, "there are no credentials for it: set them as its library wants them (docs/storage.md)"),
        (_WRONG, "the credential is not accepted: check it, and the same command goes on"),
        (_ABSENT, "there is no such bucket or repository: make it first, or name another"),
        (_LOST, f"the connection is lost or refused: {_AGAIN}"),
        ({"PermissionError", "403"}, "the credential lacks the permission: grant it, and the same command goes on"),
    ):
        if names & known:
            return f"{said} ({_line(error)})"
    return _line(error)


def _line(error: BaseException) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__
