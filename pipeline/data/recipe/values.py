"""The form that the lists of a recipe may have."""

import math
from typing import Any

from pipeline.data.names import is_embodiment, is_name
from pipeline.data.parsing import show_value


def listed(value: Any, key: str) -> tuple[str | int | float, ...]:
    """The values of a key as a tuple, in order and without repeats; a single value counts as a list
    of one.

    Only `tasks` (empty: all of them) and `paired` (empty: none) may be empty. Raises ValueError."""
    items = value if isinstance(value, list | tuple) else [value]
    if not all(isinstance(item, str | int | float) for item in items):
        raise ValueError("is not a list of names or numbers")
    if not items and key not in ("tasks", "paired"):
        raise ValueError("is empty")
    if any(isinstance(item, float) and math.isnan(item) for item in items):
        raise ValueError("is not a number")
    checks = {"tasks": (is_name, "a name"), "embodiments": (is_embodiment, "NAME or LEFT+RIGHT")}
    if key in checks:
        holds, form = checks[key]
        if wrong := [item for item in items if not holds(item)]:
            raise ValueError(f"holds {show_value(wrong[0])}, which is not {form}")
    return tuple(dict.fromkeys(items))
