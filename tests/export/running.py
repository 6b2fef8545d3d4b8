"""Runs an export in a test: options of the format by keyword, those that must be given filled
in."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from pipeline.export import EXPORTERS, ExportError, Job
from pipeline.export.shared.record import read_record

REQUIRED: dict[str, dict[str, Any]] = {"robotwin": {"jpeg_order": "rgb"}}


def run(
    format: str,
    dataset: Path,
    out: Path,
    episodes: Sequence[Path],
    *,
    progress: Callable[[int], object] | None = None,
    workers: int = 1,
    **options: Any,
) -> dict[str, Any]:
    """Export and return the summary."""
    exporter = EXPORTERS[format]
    given = exporter.options(**(REQUIRED.get(format, {}) | options))
    return exporter.export(Job(dataset, out, episodes, given, progress, workers))


def check_export(dataset: Path, out: Path, episodes: Sequence[Path]) -> list[str]:
    """The problems of an export, or of its record."""
    try:
        return read_record(out).check(dataset, episodes)
    except ExportError as error:
        return [str(error)]
