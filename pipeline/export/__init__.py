"""Exporters by the name of their format. Every module below is imported here and registers its own, if any. docs/add_a_format.md
adds one."""

import importlib
import pkgutil

from pipeline.export.exporter import EXPORTERS, Exporter, Job, register
from pipeline.export.options import NoOptions, option, parse_options
from pipeline.export.shared.common import ExportError

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

# last: they import the names above
for _floor in ("formats", "formats.lerobot", "bridges"):
    for _module in pkgutil.iter_modules(importlib.import_module(f"{__name__}.{_floor}").__path__):
        importlib.import_module(f"{__name__}.{_floor}.{_module.name}")
