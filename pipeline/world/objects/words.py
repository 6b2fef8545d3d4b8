"""Descriptions: phrases/<family>.txt beside the module, filled with facts."""

import re
import sys
from functools import cache
from pathlib import Path
from string import Formatter

from pipeline.data.errors import DominoError
from pipeline.registry import UnknownName

from .contract import FAMILIES, Words

SEEN, UNSEEN = 12, 3
"""Descriptions of every object for the two splits, as many as the original has."""


class LanguageError(DominoError, ValueError):
    """Phrases or templates that make no sentence."""


def describe(family: str, noun: str, **facts: str) -> Words:
    """The first `SEEN` and `UNSEEN` distinct phrases whose slots, such as {colour}, `facts` fill.
    Raises LanguageError for too few."""
    known = {name: fact for name, fact in facts.items() if fact}
    splits = list[tuple[str, ...]]()
    for phrases, count in zip(read_phrases(family), (SEEN, UNSEEN), strict=True):
        named = ([name for _, name, _, _ in Formatter().parse(p) if name] for p in phrases)
        fits = [p for p, names in zip(phrases, named, strict=True) if {*names} <= known.keys()]
        # single spaces, and "an" before a vowel
        plain = (" ".join(p.format(**known).split()) for p in fits)
        true = [re.sub(r"\ba (?=[aeiou])", "an ", text) for text in plain]
        splits.append(tuple(p for p in dict.fromkeys(true) if p not in sum(splits, ()))[:count])
        if len(splits[-1]) < count:
            given = f"gives {len(splits[-1])} phrases for {known}: write at least {count}"
            raise LanguageError(f"phrases/{family}.txt {given}")
    return Words(noun, *splits)


@cache
def read_phrases(family: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Seen and unseen phrases. Raises LanguageError."""
    where = f"phrases/{family}.txt"
    try:
        module = Path(str(sys.modules[FAMILIES[family].__module__].__file__))
        return two_lists((module.parent / where).read_text("utf-8"), where)
    except (FileNotFoundError, UnknownName) as missing:
        wrong = f"object family {family!r} has no descriptions: write {where}"
        raise LanguageError(wrong) from missing


def two_lists(text: str, where: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The lines after "seen" and after "unseen". Raises LanguageError."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    if lines[:1] != ["seen"] or lines.count("seen") != 1 or lines.count("unseen") != 1:
        raise LanguageError(f"{where}: needs a line 'seen', entries, a line 'unseen', entries")
    middle = lines.index("unseen")
    return tuple(lines[1:middle]), tuple(lines[middle + 1 :])
