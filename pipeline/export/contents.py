"""Which files are part of an export, so that one that somebody put beside them is neither taken for a part nor deleted."""

import re
from collections.abc import Collection
from pathlib import Path

_NUMBER = re.compile(r"\d+")


def contents_of(folder: Path) -> list[str]:
    """Names of all files below a directory, relative and sorted; numbers are written as #, so that many episodes are one name."""
    return sorted({_pattern(folder, path) for path in folder.rglob("*") if not path.is_dir()})


def strangers(folder: Path, contents: Collection[str]) -> list[Path]:
    """Files below a directory that are none of its `contents`, sorted."""
    return sorted(path for path in folder.rglob("*") if not path.is_dir() and _pattern(folder, path) not in contents)


def _pattern(folder: Path, path: Path) -> str:
    return _NUMBER.sub("#", path.relative_to(folder).as_posix())
