"""URLs of object stores, in texts that people write and read."""

import re
from pathlib import Path
from urllib.parse import unquote

from pipeline.data.store.files import StoreError
from pipeline.data.store.place import FOLDER
from pipeline.data.user_cache import user_cache

SCHEMES = ("s3", "s3a", "gs", "gcs", "hf", "az", "abfs", "abfss", "memory")
"""URLs that name a store; file systems of other machines can be mounted."""

_URL = re.compile(rf"({'|'.join(SCHEMES)}):/+(.+)")
_SCHEME = re.compile(r"([A-Za-z][A-Za-z0-9+.-]+):(/.*)?|(s3|gs|hf):.*", re.DOTALL)


def url_of(text: str | Path) -> str | None:
    """The URL of a store that a text is, also one that was taken for a path, None for a path.

    Raises StoreError, with the fix, for what looks like a URL and is none that a store can have.
    """
    match = _URL.fullmatch(str(text).rstrip("/"))
    if match and not set("?#*[]") & {*match[2]} and ".." not in match[2].split("/"):
        return f"{match[1]}://{match[2]}"
    if match or _SCHEME.fullmatch(str(text)):
        known = ", ".join(f"{scheme}://" for scheme in SCHEMES)
        raise StoreError(
            f"{text}: is no URL that can be used: choose {known}, without ? # * [ ] or ..; mount"
            " what is none of these; or begin with / for a directory of that name"
        )
    return None


def with_urls(text: str) -> str:
    """A text in which the directories of places are the URLs that they stand for."""
    folder = re.escape(str(user_cache(FOLDER)))
    pattern = rf"{folder}/(\w+%3A%2F%2F[^\s/~:;,'\"]+)~[\w.-]+\.\d+\.\w+"
    return re.sub(pattern, lambda match: unquote(match[1]), text)
