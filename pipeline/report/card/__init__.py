"""The text of a dataset card, generated from the data."""

from .text import describe
