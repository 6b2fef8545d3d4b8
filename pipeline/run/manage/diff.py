"""`domino-data diff A B`: which slots differ, and why."""

from collections import Counter
from dataclasses import asdict, dataclass
from typing import Any

from pipeline.data.dataset import Dataset
from pipeline.data.keys import SlotKeys
from pipeline.data.recipe.growth import differences
from pipeline.data.slots.records import SlotRecord

MISSING, UNWANTED = "is not finished", "not wanted"
GIVEN_UP = "was given up"
BYTES = "other bytes, same keys"  # of another state log, or by a damaged installation


@dataclass(frozen=True)
class Difference:
    """A slot that differs, and the differing parts of its keys."""

    slot: str
    a: str
    b: str
    parts: tuple[str, ...] = ()

    def describe(self) -> str:
        """One line."""
        if self.a == UNWANTED:
            why = f"{UNWANTED} by A, {self.b} in B"
        elif self.b == UNWANTED:
            why = f"{UNWANTED} by B, {self.a} in A"
        elif self.parts:
            why = f"other {', '.join(self.parts)}"
        else:
            why = self.a if self.a == self.b else f"{self.a} in A, {self.b} in B"
        return f"{self.slot}: {why}"


def diff(a: Dataset, b: Dataset) -> dict[str, Any]:
    """{"same": slots, "differ": [Difference], "why": {reason: slots}, "recipes": differing
    keys}. Raises DatasetError.
    """
    recipes = a.recipe(), b.recipe()
    first, second = dict(a.records(recipes[0])), dict(b.records(recipes[1]))
    wanted = [dict.fromkeys(recipe.slots()) for recipe in recipes]
    found, same = list[Difference](), 0
    for slot in wanted[0] | wanted[1]:
        one, other, parts = first.get(slot), second.get(slot), tuple[str, ...]()
        if one is other:  # neither has it
            continue
        if one and other:
            parts = _parts(one.keys, other.keys)
            if (one.accepted, one.sha256, parts) == (other.accepted, other.sha256, ()):
                same += 1
                continue
        in_a = _state(one) if slot in wanted[0] else UNWANTED
        in_b = _state(other) if slot in wanted[1] else UNWANTED
        if in_a == in_b:
            in_a = in_b = "" if parts else BYTES
        found.append(Difference(slot.path, in_a, in_b, parts))
    why = Counter(each.describe().partition(": ")[2] for each in found)
    return {
        "same": same,
        "differ": [asdict(each) for each in found],
        "why": dict(why.most_common()),
        "recipes": differences(*recipes, "{} is {} in A, {} in B"),
    }


def _state(record: SlotRecord | None) -> str:
    if record is None:
        return MISSING
    return "is there" if record.accepted else GIVEN_UP


def _parts(a: SlotKeys, b: SlotKeys) -> tuple[str, ...]:
    names = [
        f"{kind}.{part}"
        for kind in a.to_json()
        for part in getattr(a, kind).changed(getattr(b, kind))
    ]
    return tuple(name for name in names if name not in ("render.physics", "language.physics"))
