"""The text of a dataset card, generated from the data: tables, plots, contact sheet, clips, how
made, how to load, limits."""

from .text import describe
