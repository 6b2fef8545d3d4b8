"""Values of a recipe's keys as they are written: how messages show them, and which form they may
have."""

import math
from typing import Any

from pipeline.data.names import is_embodiment, is_name
from pipeline.data.parsing import show_value

MOST_ITEMS = 1000
LONGEST_NAME = 200


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
    for item in items:
        if key == "tasks" and not is_name(item):
            raise ValueError(f"holds {show_value(item)}, which is not a name")
        if key == "embodiments" and not is_embodiment(item):
            raise ValueError(
                f"holds {show_value(item)}, which is neither a name nor a pair of names written"
                " left+right"
            )
        if isinstance(item, str) and len(item) > LONGEST_NAME:
            raise ValueError(
                f"holds a name of {len(item)} characters; at most {LONGEST_NAME} are allowed"
            )
    if len(items) > MOST_ITEMS:
        raise ValueError(f"has {len(items)} values; at most {MOST_ITEMS} are allowed")
    return tuple(dict.fromkeys(items))
