"""`domino-data diff A B`: which slots of two datasets differ, and why, by both indices."""

from collections import Counter
from dataclasses import asdict, dataclass, replace
from typing import Any

from pipeline.data.dataset import Dataset
from pipeline.data.recipe.growth import differences
from pipeline.data.recipe.model import Recipe, Slot
from pipeline.data.slots.files import Listing
from pipeline.data.slots.records import unpack_keys

MISSING, GIVEN_UP, LOST, BYTES = (
    "is not finished",
    "was given up",
    "is finished, and its file is gone",
    "other bytes, same keys",
)
UNWANTED = "not wanted"  # what a slot is to a dataset whose recipe has no such slot


@dataclass(frozen=True)
class Difference:
    """A slot that differs: what it is in each dataset, and the parts of its keys that differ."""

    slot: str
    a: str
    b: str
    parts: tuple[str, ...] = ()

    def describe(self) -> str:
        """One line."""
        if UNWANTED in (self.a, self.b):
            first, second = (
                (("A", self.a), ("B", self.b))
                if self.a == UNWANTED
                else (("B", self.b), ("A", self.a))
            )
            return f"{self.slot}: {UNWANTED} by {first[0]}, {second[1]} in {second[0]}"
        why = f"other {', '.join(self.parts)}" if self.parts else ""
        return (
            f"{self.slot}:"
            f" {why or (self.a if self.a == self.b else f'{self.a} in A, {self.b} in B')}"
        )


@dataclass(frozen=True)
class _Side:
    """What a dataset has of a slot."""

    accepted: bool
    sha256: str
    keys: str
    there: bool


def diff(a: Dataset, b: Dataset) -> dict[str, Any]:
    """{"same": slots alike in both, "differ": [Difference], "why": {reason: slots}, "recipes": keys
    of the recipes that differ}. Raises DatasetError."""
    recipes = a.recipe(), b.recipe()
    sides = [_sides(dataset, recipe) for dataset, recipe in zip((a, b), recipes, strict=True)]
    wanted = [dict.fromkeys(recipe.slots()) for recipe in recipes]
    slots = wanted[0] | wanted[1]
    found = dict[Slot, Difference]()
    for slot in slots:
        if d := _difference(slot, sides[0].get(slot), sides[1].get(slot)):
            said = [
                state if slot in mine else UNWANTED
                for state, mine in zip((d.a, d.b), wanted, strict=True)
            ]
            found[slot] = replace(d, a=said[0], b=said[1])
    why = Counter(d.describe().partition(": ")[2] for d in found.values())
    return {
        "same": sum(slot in sides[0] and slot in sides[1] and slot not in found for slot in slots),
        "differ": [asdict(d) for d in found.values()],
        "why": dict(why.most_common()),
        "recipes": differences(*recipes),
    }


def _sides(dataset: Dataset, recipe: Recipe) -> dict[Slot, _Side]:
    rows = dataset.rows(recipe, "sha256")
    there = Listing(dataset.episodes, recipe).there(rows).tolist()
    columns = zip(
        rows.slots,
        rows.accepted.tolist(),
        rows.more["sha256"],
        rows.keys.tolist(),
        there,
        strict=True,
    )
    return {
        slot: _Side(accepted, sha.hex(), rows.texts[key], here)
        for slot, accepted, sha, key, here in columns
    }


def _difference(slot: Slot, a: _Side | None, b: _Side | None) -> Difference | None:
    """The difference of a slot; None if there is none, or if neither dataset has the slot."""
    if a is None or b is None:
        return None if a is b else Difference(slot.path, _state(a), _state(b))
    lost = not (a.there and b.there)
    if a.accepted != b.accepted or lost:
        return Difference(slot.path, _state(a), _state(b), _parts(slot, a, b))
    if a.keys != b.keys or a.sha256 != b.sha256:
        parts = _parts(slot, a, b)
        # an episode that was made from another state log, or by a damaged installation, has other
        # bytes with the same keys
        return Difference(slot.path, "" if parts else BYTES, "" if parts else BYTES, parts)
    return None


def _state(side: _Side | None) -> str:
    if side is None:
        return MISSING
    if not side.there:
        return LOST
    return "is there" if side.accepted else GIVEN_UP


def _parts(slot: Slot, a: _Side, b: _Side) -> tuple[str, ...]:
    """Parts of the keys that differ; not those that only follow from other parts."""
    first, second = unpack_keys(slot, a.keys), unpack_keys(slot, b.keys)
    names = [
        f"{kind}.{part}"
        for kind in vars(first)
        for part in getattr(first, kind).changed(getattr(second, kind))
    ]
    return tuple(name for name in names if name not in ("render.physics", "language.physics"))
