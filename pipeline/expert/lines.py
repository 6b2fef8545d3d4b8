"""Straight joint lines into contact: where they touch first, and where they should end."""

import numpy as np

from pipeline.expert.budgets import PRESS
from pipeline.planning.path import IsFree
from pipeline.poses import Floats


def first_touch(apart: IsFree, line: Floats) -> float:
    """Share of joint rows (K,n), evenly spread over a way into contact, at which `apart` ceases to
    hold; 1 where it never does."""
    if apart(line[-1]):
        return 1.0
    before, behind = 0.0, 1.0
    for _ in range(PRESS.bisections):
        middle = 0.5 * (before + behind)
        before, behind = (middle, behind) if apart(_at(line, middle)) else (before, middle)
    return before


def between(line: Floats, first: float, last: float) -> Floats:
    """The part of joint rows (K,n), evenly spread, between two shares of the way."""
    inner = np.arange(len(line)) / (len(line) - 1)
    return np.vstack([_at(line, first), line[(inner > first) & (inner < last)], _at(line, last)])


def ending_clear(line: Floats, clear: IsFree, least: float) -> Floats | None:
    """The line (K,n) up to where `clear` ceases to hold; None if that is before the share `least`
    of it."""
    if clear(line):
        return line
    end = first_touch(clear, line)
    cut = between(line, 0.0, end)
    return cut if end >= least and clear(cut) else None


def _at(line: Floats, share: float) -> Floats:
    place = share * (len(line) - 1)
    k = min(int(place), len(line) - 2)
    return line[k] + (place - k) * (line[k + 1] - line[k])
