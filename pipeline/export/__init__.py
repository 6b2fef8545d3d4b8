"""Exporters by the name of their format. docs/add_a_format.md adds one."""

from pipeline.export.exporter import EXPORTERS, Exporter, Job, register
from pipeline.export.options import NoOptions, option, parse_options
from pipeline.export.shared.episodes import ExportError

__all__ = [
    "EXPORTERS",
    "ExportError",
    "Exporter",
    "Job",
    "NoOptions",
    "option",
    "parse_options",
    "register",
]
