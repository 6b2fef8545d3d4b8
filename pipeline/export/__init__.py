"""Exports: format name -> function. Each is `export(dataset, out, episodes, *, progress=None) -> summary` and raises ExportError.

`out` appears by rename when everything is written; an older export is replaced only then. Episodes are ordered by path.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from pipeline.export.aloha import check_aloha, export_aloha
from pipeline.export.common import ExportError
from pipeline.export.lerobot import export_lerobot
from pipeline.export.lerobot_check import check_lerobot
from pipeline.export.parquet import check_parquet, export_parquet

EXPORTERS: dict[str, Callable[..., dict[str, Any]]] = {
    "lerobot": export_lerobot,
    "aloha": export_aloha,
    "parquet": export_parquet,
}

CHECKS: dict[str, Callable[[Path, Path, Sequence[Path]], list[str]]] = {
    "lerobot": check_lerobot,
    "aloha": check_aloha,
    "parquet": check_parquet,
}


def check_exports(dataset: Path, out: Path, format: str, episodes: Sequence[Path]) -> list[str]:
    """Compare the export of a format at `out` with the episodes it was made from; returns the problems found, [] when all is well.

    Counts, values, times and pictures of every frame are compared. Raises ExportError for an unknown format and for episode files
    that cannot be read.
    """
    if format not in CHECKS:
        raise ExportError(f"format {format!r} is unknown: formats are {', '.join(EXPORTERS)}")
    return CHECKS[format](dataset, out, episodes)


__all__ = ["CHECKS", "EXPORTERS", "ExportError", "check_exports"]
