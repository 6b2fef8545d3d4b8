"""URLs of object stores, and where on this machine what they hold is mirrored."""

import re
from pathlib import Path
from urllib.parse import unquote

from pipeline.data.store.files import StoreError
from pipeline.data.store.user_cache import CACHE, user_cache

FOLDER = "mirrors"

SCHEMES = ("s3", "s3a", "gs", "gcs", "hf", "az", "abfs", "abfss", "memory")
"""URLs that name a store, some of which can be read only (files.CONDITIONAL): what has objects,
which are whole or not there. File systems of other machines can be mounted."""

_URL = re.compile(rf"({'|'.join(SCHEMES)}):/+(.+)")
_SCHEME = re.compile(r"([A-Za-z][A-Za-z0-9+.-]+):/.*|(s3|gs|hf):.*", re.DOTALL)


def url_of(text: str | Path) -> str | None:
    """The URL of a store that a text is, also one that was taken for a path, None for a path.

    Raises StoreError, with the fix, for what looks like a URL and is none that a store can have.
    """
    match = _URL.fullmatch(str(text).rstrip("/"))
    if match is None:
        if _SCHEME.fullmatch(f"{text}/" if str(text).endswith(":") else str(text)):
            known = ", ".join(f"{scheme}://" for scheme in SCHEMES)
            fix = (
                f"choose {known}; mount what is none of these; or begin with / for a directory of"
                " that name"
            )
            raise StoreError(f"{text}: is no URL that can be written to: {fix}")
        return None
    name = match[2]
    if odd := next((sign for sign in "?#*[]" if sign in name), None) or (
        ".." if ".." in name.split("/") else None
    ):
        raise StoreError(
            f"{match[1]}://{name}: has {odd!r} in it, which stores take for something else: name"
            " another place"
        )
    return f"{match[1]}://{name}"


def mirrors() -> Path:
    """Where mirrors are kept. Raises StoreError for a user without a home."""
    folder = user_cache(FOLDER)
    if folder is None:
        raise StoreError(
            f"there is no directory to keep what an object store holds in: set {CACHE} to one"
        )
    return folder


def with_urls(text: str) -> str:
    """A text in which the paths of mirrors are the URLs that they stand for."""
    folder = user_cache(FOLDER)
    if folder is None:
        return text
    return re.sub(
        rf"{re.escape(str(folder))}/(\w+%3A%2F%2F[^\s/~:;,'\"]+)(?:~\d+)?",
        lambda m: unquote(m[1]),
        text,
    )
