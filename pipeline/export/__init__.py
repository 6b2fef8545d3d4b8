"""Exporters by format: docs/add_a_format.md."""

from .exporter import EXPORTERS, Exporter, Job, register
from .options import NoOptions, option, parse_options
from .shared.episodes import ExportError
