"""Parameters that are declared with how they are drawn: `Parametric` draws them in their order,
each with those declared before it, and derives the words."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, fields
from types import SimpleNamespace
from typing import Any, ClassVar, Self

import numpy as np

from pipeline.world.objects.contract import FAMILIES, Family, Words
from pipeline.world.objects.kit import other, pick, seed, size_word
from pipeline.world.objects.words import describe

LARGE = ("small", "medium-sized", "large")
TALL = ("short", "medium-sized", "tall")
LONG = ("short", "medium-sized", "long")
WIDE = ("narrow", "medium-sized", "wide")


def drawn(how: Callable[[np.random.Generator, Any], Any], **notes: Any) -> Any:
    """A parameter that `how` draws from a generator and the parameters before it, as attributes;
    `notes` join its metadata."""
    return field(metadata={"draw": how, "also": "", **notes})


def between(low: float, high: float, of: str = "", size: tuple[str, str, str] | None = None) -> Any:
    """A number between two bounds, times the parameter `of`. Its third of the range is the word
    `size` of the object."""
    return drawn(
        lambda rng, so_far: rng.uniform(low, high) * (getattr(so_far, of) if of else 1.0),
        range=(low, high),
        size=size,
    )


def one_of(
    options: Sequence[Any] | Mapping[str, Sequence[Any]],
    other_than: str = "",
    also: str = "",
    by: str = "",
    says: str = "",
) -> Any:
    """One of `options`, all equally likely.

    `other_than` names a parameter whose value is left out, `also` one whose value joins them in
    front; `by` names the one whose value is the key of a mapping of options.
    `says` is the fact that phrases know it by; it is left out where `also` has the same value.
    """

    def how(rng: np.random.Generator, so_far: Any) -> Any:
        choices = options[getattr(so_far, by)] if isinstance(options, Mapping) else options
        if other_than:
            return other(rng, choices, getattr(so_far, other_than))
        return pick(rng, (getattr(so_far, also), *choices) if also else choices)

    return drawn(how, says=says, also=also)


def texture() -> Any:
    """An integer that fixes a texture."""
    return drawn(lambda rng, so_far: seed(rng))


class Parametric(Family):
    """Base of families whose parameters are declared: only `shape` and `frames` are left to write.

    `noun` is the object's plain name, by default that of the family.
    """

    noun: ClassVar[str] = ""

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Self:
        """Sample an instance, its parameters in their order."""
        so_far = SimpleNamespace()
        for parameter in fields(cls):  # pyright: ignore[reportArgumentType]
            setattr(so_far, parameter.name, parameter.metadata["draw"](rng, so_far))
        return cls(**vars(so_far))

    def facts(self) -> dict[str, str]:
        """What phrases may say: the parameters that are text, under their names, and the size.

        Wood is called wooden; any other material is `plain`, too.
        """
        facts = {name: value for name, value in vars(self).items() if isinstance(value, str)}
        if material := facts.get("material"):
            facts |= (
                {"material": "wooden", "plain": ""} if material == "wood" else {"plain": material}
            )
        for parameter in fields(self):  # pyright: ignore[reportArgumentType]
            notes, value = parameter.metadata, getattr(self, parameter.name)
            if words := notes.get("size"):
                facts["size"] = size_word(value, notes["range"], words)
            if name := notes.get("says"):
                same = notes["also"] and value == getattr(self, notes["also"])
                facts[name] = "" if same else value
        return facts

    def words(self) -> Words:
        """Noun and descriptions that are true of this instance."""
        family = next(name for name in FAMILIES if FAMILIES[name] is type(self))
        return describe(family, self.noun or family.replace("_", " "), **self.facts())
