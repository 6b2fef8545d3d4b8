"""URLs of object stores, and where on this machine what they hold is mirrored."""

import re
from pathlib import Path
from urllib.parse import unquote

from pipeline.data.store import StoreError
from pipeline.data.user_cache import CACHE, user_cache

FOLDER = "mirrors"

SCHEMES = ("s3", "s3a", "gs", "gcs", "hf", "az", "abfs", "abfss", "oci", "oss", "memory", "sftp", "ssh", "smb", "hdfs")
"""URLs that name a store."""

_URL = re.compile(rf"({'|'.join(SCHEMES)}):/+(.+)")


def url_of(text: str | Path) -> str | None:
    """The URL of a store that a text is, also one that was taken for a path, None for a path."""
    match = _URL.fullmatch(str(text))
    return f"{match[1]}://{match[2].rstrip('/')}" if match else None


def mirrors() -> Path:
    """Where mirrors are kept. Raises StoreError for a user without a home."""
    folder = user_cache(FOLDER)
    if folder is None:
        raise StoreError(f"there is no directory to keep what an object store holds in: set {CACHE} to one")
    return folder


def with_urls(text: str) -> str:
    """A text in which the paths of mirrors are the URLs that they stand for."""
    folder = user_cache(FOLDER)
    if folder is None:
        return text
    return re.sub(rf"{re.escape(str(folder))}/(\w+%3A%2F%2F[^\s/~:;,'\"]+)(?:~\d+)?", lambda m: unquote(m[1]), text)
