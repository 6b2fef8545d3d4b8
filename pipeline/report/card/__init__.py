"""The text of a dataset card, generated from the data: tables, plots, contact sheet, clips, how
made, how to load, limits."""

from pipeline.report.card.text import describe

__all__ = ["describe"]
