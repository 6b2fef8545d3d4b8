"""Parametric objects: `FAMILIES` by name; `FAMILIES["mug"].draw(rng)` is a mug."""

from . import families
from .contract import FAMILIES, Family, Grasp, NamedFrames, Words

__all__ = ["FAMILIES", "Family", "Grasp", "NamedFrames", "Words", "families"]
