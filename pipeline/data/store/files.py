"""Objects below an fsspec URL. Every request ends."""

import json
import os
import re
import socket
import threading
from base64 import b64decode
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from concurrent.futures import wait as wait_for
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from pipeline.data.atomic import Busy
from pipeline.data.errors import DominoError

CONDITIONAL = ("s3", "s3a", "gs", "gcs", "memory")
"""Stores that can write an object only if it is not there; others are read only."""

LEASE = ".writing.json"  # the object that tells who writes

ANSWER, SLOWEST = 30.0, 50_000
"""Seconds that a request may take, and bytes a second of one that carries a file."""

FIX = (
    "check the bucket, the credentials, the network and the endpoint (docs/storage.md), then rerun"
    " the same command to resume"
)


class StoreError(DominoError):
    """An object store that fails: one line with the URL and the fix."""


SCHEMES = ("s3", "s3a", "gs", "gcs", "hf", "az", "abfs", "abfss", "memory")  # of stores

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


@dataclass(frozen=True)
class Listed:
    """Length (bytes) of an object, and its MD5 (hex) if stated."""

    size: int
    md5: str


class Store:
    """The objects below a URL. Every method raises StoreError."""

    def __init__(self, url: str) -> None:
        self.url = url.rstrip("/")

    @cached_property
    def _at(self) -> tuple[Any, str]:
        import fsspec  # half a second, with that of the store's own library

        options = {"use_listings_cache": False, "skip_instance_cache": True}
        try:
            fs, path = fsspec.url_to_fs(self.url, **options)
        except (ImportError, ValueError) as error:
            fix = "install the package (`uv sync --extra s3` or `--extra gcs` for these two)"
            raise StoreError(f"{self.url}: {_line(error)}: {fix}") from error
        return fs, path.rstrip("/")

    def list(self) -> dict[str, Listed]:
        """All objects by name."""

        def find(fs: Any, root: str) -> dict[str, Listed]:
            return {
                path.removeprefix(f"{root}/"): Listed(int(info["size"] or 0), _md5(info))
                for path, info in fs.find(root, detail=True).items()
                if path.startswith(f"{root}/") and not path.endswith("/")
            }

        return self._do("list", "", find, 10 * ANSWER)

    def read(self, name: str) -> bytes | None:
        """The bytes of a small object, None if there is none."""

        def cat(fs: Any, root: str) -> bytes | None:
            with suppress(FileNotFoundError):
                return fs.cat_file(f"{root}/{name}")

        return self._do("read", name, cat)

    def get(self, name: str, path: Path, size: int = 10**7) -> bool:
        """Write an object of about `size` bytes to a file; whether there is one."""

        def fetch(fs: Any, root: str) -> bool:
            with suppress(FileNotFoundError):
                fs.get_file(f"{root}/{name}", str(path))
            return path.exists()

        return self._do("read", name, fetch, ANSWER + size / SLOWEST)

    def put(self, path: Path, name: str) -> None:
        """Write a file as an object, replacing one of that name."""
        seconds = ANSWER + path.stat().st_size / SLOWEST
        self._do("write", name, lambda fs, root: fs.put_file(str(path), f"{root}/{name}"), seconds)

    def write_new(self, name: str, data: bytes) -> bool:
        """Write a small object; whether there was none of that name."""

        def send(fs: Any, root: str) -> bool:
            try:
                fs.pipe_file(f"{root}/{name}", data, mode="create")
            except Exception as error:  # not every library has the exception of Python
                if re.search("FileExists|Precondition|Conflict|412", repr(error)):
                    return False
                raise
            return True

        return self._do("write", name, send)

    def delete(self, names: Sequence[str]) -> None:
        """Delete objects that may be gone."""

        def remove(fs: Any, root: str) -> None:
            for name in names:
                with suppress(FileNotFoundError):
                    fs.rm_file(f"{root}/{name}")

        if names:
            self._do("delete", names[0], remove, ANSWER + len(names))

    @contextmanager
    def hold(self) -> Iterator[None]:
        """Hold the store's lease; one of a dead local process is taken over. Raises Busy,
        StoreError.
        """
        if self.url.partition(":")[0] not in CONDITIONAL:
            raise StoreError(
                f"{self.url}: can only be read: give a directory, s3:// or gs:// to write;"
                " `domino-data publish` uploads an export to the hub"
            )
        host = socket.gethostname()
        # some servers write over an object whatever the condition
        if held := self.read(LEASE):
            try:
                holder = json.loads(held)
                alive = holder["host"] != host or Path(f"/proc/{holder['process']}").exists()
            except (ValueError, TypeError, KeyError):
                holder, alive = {}, False
            if alive:
                raise Busy(
                    f"{self.url}: another command is writing it (process {holder['process']} on"
                    f" {holder['host']}): wait until that has ended, or stop it; if it was killed,"
                    f" delete {self.url}/{LEASE}"
                )
            self.delete([LEASE])
        if not self.write_new(LEASE, json.dumps({"host": host, "process": os.getpid()}).encode()):
            raise Busy(f"{self.url}: another command has just begun to write it: stop one of them")
        try:
            yield
        finally:
            with suppress(StoreError):
                self.delete([LEASE])

    def _do[T](
        self, what: str, name: str, request: Callable[[Any, str], T], seconds: float = ANSWER
    ) -> T:
        """A request's result, in a thread that does not block exit."""
        fs, root = self._at
        where, answer = f"cannot {what} {f'{self.url}/{name}'.rstrip('/')}", Future[T]()

        def ask() -> None:
            try:
                answer.set_result(request(fs, root))
            except Exception as error:  # noqa: BLE001 - every library has exceptions of its own
                answer.set_exception(error)

        threading.Thread(target=ask, daemon=True).start()
        if not wait_for([answer], seconds).done:
            raise StoreError(f"{where}: no answer for {seconds:.0f} s; {FIX}")
        if error := answer.exception():
            raise StoreError(f"{where}: {_line(error)}; {FIX}") from error
        return answer.result()


def _line(error: BaseException) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__


def _md5(info: dict[str, Any]) -> str:
    """S3's ETag or Google's md5Hash, if an MD5."""
    text = str(info.get("ETag") or "").strip('"')
    if hashed := info.get("md5Hash"):
        text = b64decode(hashed).hex()
    return text if len(text) == 32 else ""  # of parts, S3 has another ETag
