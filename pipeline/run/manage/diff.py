"""`domino-data diff A B`: which slots differ, and why."""

from collections import Counter
from dataclasses import asdict, dataclass
from typing import Any

from pipeline.data.dataset import Dataset
from pipeline.data.recipe.growth import differences
from pipeline.data.recipe.model import Recipe, Slot
from pipeline.data.slots.files import Listing
from pipeline.data.slots.records import unpack_keys

MISSING, UNWANTED = "is not finished", "not wanted"
GIVEN_UP, LOST = "was given up", "is finished, and its file is gone"
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


@dataclass(frozen=True)
class _Side:
    """What a dataset has of a slot."""

    accepted: bool
    sha256: str
    keys: str
    there: bool


def diff(a: Dataset, b: Dataset) -> dict[str, Any]:
    """{"same": slots, "differ": [Difference], "why": {reason: slots}, "recipes": differing
    keys}. Raises DatasetError.
    """
    recipes = a.recipe(), b.recipe()
    first, second = _sides(a, recipes[0]), _sides(b, recipes[1])
    wanted = [dict.fromkeys(recipe.slots()) for recipe in recipes]
    found, same = list[Difference](), 0
    for slot in wanted[0] | wanted[1]:
        one, other, parts = first.get(slot), second.get(slot), tuple[str, ...]()
        if one and other:
            if one == other and one.there:
                same += 1
                continue
            parts = _parts(slot, one, other)
        elif one is other:
            continue
        in_a = _state(one) if slot in wanted[0] else UNWANTED
        in_b = _state(other) if slot in wanted[1] else UNWANTED
        if in_a == in_b != LOST:
            in_a = in_b = "" if parts else BYTES
        found.append(Difference(slot.path, in_a, in_b, parts))
    why = Counter(each.describe().partition(": ")[2] for each in found)
    return {
        "same": same,
        "differ": [asdict(each) for each in found],
        "why": dict(why.most_common()),
        "recipes": differences(*recipes, "{} is {} in A, {} in B"),
    }


def _sides(dataset: Dataset, recipe: Recipe) -> dict[Slot, _Side]:
    rows = dataset.rows(recipe, "sha256")
    there = Listing(dataset.episodes, recipe).there(rows).tolist()
    accepted, keys = rows.accepted.tolist(), rows.keys.tolist()
    columns = zip(rows.slots, accepted, rows.more["sha256"], keys, there, strict=True)
    return {
        slot: _Side(accepted, sha.hex(), rows.texts[key], here)
        for slot, accepted, sha, key, here in columns
    }


def _state(side: _Side | None) -> str:
    if side is None:
        return MISSING
    if not side.there:
        return LOST
    return "is there" if side.accepted else GIVEN_UP


def _parts(slot: Slot, a: _Side, b: _Side) -> tuple[str, ...]:
    first, second = unpack_keys(slot, a.keys), unpack_keys(slot, b.keys)
    names = [
        f"{kind}.{part}"
        for kind in vars(first)
        for part in getattr(first, kind).changed(getattr(second, kind))
    ]
    return tuple(name for name in names if name not in ("render.physics", "language.physics"))
