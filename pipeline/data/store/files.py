"""Objects below an fsspec URL. Every request ends."""

import os
import re
import socket
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from functools import cached_property
from pathlib import Path
from typing import Any

from pipeline.data.atomic import Busy
from pipeline.data.errors import DominoError, one_line

CONDITIONAL = ("s3", "s3a", "gs", "gcs", "memory")
"""Stores that can write an object only if it is not there; others are read only."""

LEASE = ".writing"  # the object that tells who writes

ANSWER, SLOWEST = 30.0, 50_000
"""Seconds that a request may take, and bytes a second of one that carries a file."""

FIX = (
    "check the bucket, the credentials, the network and the endpoint (docs/storage.md), then rerun"
    " the same command to resume"
)


class StoreError(DominoError):
    """An object store that fails: one line with the URL and the fix."""


SCHEMES = ("s3", "s3a", "gs", "gcs", "hf", "az", "abfs", "abfss", "memory")

_URL = re.compile(rf"({'|'.join(SCHEMES)}):/+(.+)")
_SCHEME = re.compile(r"([A-Za-z][A-Za-z0-9+.-]+):(/.*)?|(s3|gs|hf):.*", re.DOTALL)


def url_of(text: str | Path) -> str | None:
    """The URL that a text or path is, else None. Raises StoreError for a malformed URL."""
    match = _URL.fullmatch(str(text).rstrip("/"))
    if match and not set("?#*[]") & {*match[2]} and ".." not in match[2].split("/"):
        return f"{match[1]}://{match[2]}"
    if match or _SCHEME.fullmatch(str(text)):
        known = ", ".join(f"{scheme}://" for scheme in SCHEMES)
        fix = "mount what is none of these; or begin with / for a directory of that name"
        raise StoreError(
            f"{text}: is no URL that can be used: choose {known}, without ? # * [ ] or ..; {fix}"
        )
    return None


class Store:
    """The objects below a URL. Every method raises StoreError."""

    def __init__(self, url: str) -> None:
        self.url = url.rstrip("/")

    @cached_property
    def _at(self) -> tuple[Any, str]:
        import fsspec  # half a second, with that of the store's own library

        try:
            fs, path = fsspec.url_to_fs(
                self.url, use_listings_cache=False, skip_instance_cache=True
            )
        except (ImportError, ValueError) as error:
            fix = "install the package (`uv sync --extra s3` or `--extra gcs` for these two)"
            raise StoreError(f"{self.url}: {one_line(error)}: {fix}") from error
        return fs, path.rstrip("/")

    def list(self) -> dict[str, int]:
        """The bytes of all objects that can be files below a directory, by name."""
        found = self._do("list", "", lambda fs, at: fs.find(at, detail=True), 10 * ANSWER)
        root = f"{self._at[1]}/"
        sizes = {at[len(root) :]: info["size"] for at, info in found.items() if at.startswith(root)}
        return {
            name: int(size or 0)
            for name, size in sizes.items()
            if name not in ("", LEASE) and name == os.path.normpath(f"/{name}").lstrip("/")
        }

    def read(self, name: str) -> bytes | None:
        """The bytes of a small object, None if there is none."""
        return self._do("read", name, lambda fs, at: fs.cat_file(at))

    def get(self, name: str, path: Path, size: int) -> bool:
        """Write an object of about `size` bytes to a file; whether there is one."""
        seconds = ANSWER + size / SLOWEST
        self._do("read", name, lambda fs, at: fs.get_file(at, str(path)), seconds)
        return path.exists()

    def put(self, path: Path, name: str) -> None:
        """Write a file as an object, replacing one of that name."""
        seconds = ANSWER + path.stat().st_size / SLOWEST
        self._do("write", name, lambda fs, at: fs.put_file(str(path), at), seconds)

    def write_new(self, name: str, data: bytes) -> bool:
        """Write a small object; whether there was none of that name."""
        try:
            self._do("write", name, lambda fs, at: fs.pipe_file(at, data, mode="create"))
        except StoreError as error:  # not every library has the exception of Python
            if not re.search("FileExists|Precondition|Conflict|412", repr(error.__cause__)):
                raise
            return False
        return True

    def delete(self, names: Iterable[str]) -> None:
        """Delete objects that may be gone."""
        for name in names:
            self._do("delete", name, lambda fs, at: fs.rm_file(at))

    @contextmanager
    def hold(self) -> Iterator[None]:
        """Hold the store's lease; one of a dead local process is taken over. Raises Busy."""
        if self.url.partition(":")[0] not in CONDITIONAL:
            raise StoreError(
                f"{self.url}: can only be read: give a directory, s3:// or gs:// to write;"
                " `domino-data publish` uploads an export to the hub"
            )
        host, process = socket.gethostname(), str(os.getpid())
        # some servers write over an object whatever the condition
        if (held := self.read(LEASE)) is not None:
            holder, _, its = held.decode(errors="replace").rpartition(" ")
            if holder != host or Path("/proc", its).exists():
                raise Busy(
                    f"{self.url}: another command is writing it (process {its} on {holder}): wait"
                    " until that has ended, or stop it; if it was killed, delete"
                    f" {self.url}/{LEASE}"
                )
            self.delete([LEASE])
        if not self.write_new(LEASE, f"{host} {process}".encode()):
            raise Busy(f"{self.url}: another command has just begun to write it")
        try:
            yield
        finally:
            with suppress(StoreError):
                self.delete([LEASE])

    def _do(
        self, what: str, name: str, request: Callable[[Any, str], Any], seconds: float = ANSWER
    ) -> Any:
        """What the store answers, asked in a thread that does not block exit; None for an object to
        read or delete that is not there.
        """
        (fs, root), answer = self._at, Future[Any]()

        def ask() -> None:
            try:
                answer.set_result(request(fs, f"{root}/{name}".rstrip("/")))
            except Exception as error:  # noqa: BLE001 - every library has exceptions of its own
                answer.set_exception(error)

        threading.Thread(target=ask, daemon=True).start()
        try:
            return answer.result(seconds)
        except Exception as error:
            if isinstance(error, FileNotFoundError) and what in ("read", "delete"):
                return None
            why = one_line(error) if answer.done() else f"no answer for {seconds:.0f} s"
            where = f"{self.url}/{name}".rstrip("/")
            raise StoreError(f"cannot {what} {where}: {why}; {FIX}") from error
