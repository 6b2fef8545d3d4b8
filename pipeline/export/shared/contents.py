"""Which files are part of an export, so that one that somebody put beside them is neither taken for a part nor deleted.

Training code writes caches into the dataset it reads (StarVLA `meta/stats_gr00t.json` and `meta/steps_*.pkl`, the hub's client
`.cache/`). They are made of the export and out of date when it changes: nothing keeps, checks or publishes them.
"""

import re
from collections.abc import Collection
from pathlib import Path

_NUMBER = re.compile(r"\d+")
CACHE_FOLDERS = {".cache", "__pycache__", ".ipynb_checkpoints"}
CACHE_SUFFIXES = {".pkl", ".pyc", ".lock"}
CACHE_NAMES = re.compile(r"(.*/)?meta/[^/]*stats[^/]*\.json|(.*/)?(\.DS_Store|Thumbs\.db)")


def contents_of(folder: Path) -> list[str]:
    """Names of all files below a directory, relative and sorted; numbers are written as #, so that many episodes are one name."""
    return sorted({_pattern(folder, path) for path in folder.rglob("*") if not path.is_dir()})


def strangers(folder: Path, contents: Collection[str]) -> list[Path]:
    """Files below a directory that are none of its `contents`, caches among them, sorted."""
    return sorted(path for path in folder.rglob("*") if not path.is_dir() and _pattern(folder, path) not in contents)


def is_cache(folder: Path, path: Path) -> bool:
    """Whether a file below a directory, which is none of its contents, is a cache of a consumer."""
    name = path.relative_to(folder)
    return bool(CACHE_FOLDERS & {*name.parts} or path.suffix in CACHE_SUFFIXES or CACHE_NAMES.fullmatch(name.as_posix()))


def _pattern(folder: Path, path: Path) -> str:
    return _NUMBER.sub("#", path.relative_to(folder).as_posix())
