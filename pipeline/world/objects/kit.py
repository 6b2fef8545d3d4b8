"""Declared, drawable parameters of families, and helpers."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, fields
from types import SimpleNamespace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike

from pipeline.poses import Pose, frame

from .contract import FAMILIES, Family, Grasp, NamedFrames, Words
from .words import describe


def listed(text: str) -> tuple[str, ...]:
    return tuple(text.split(", "))


COLOURS = listed(
    "red, green, blue, yellow, orange, purple, pink, teal, cyan, magenta, lime, navy, maroon,"
    " coral, turquoise, indigo, white, black, gray, brown, beige, mint, lavender, sky blue,"
    " dark green, rust"
)
PASTELS = listed("white, cream, beige, mint, lavender, sky blue, pink, coral, turquoise, yellow")
DARKS = listed("black, charcoal, navy, maroon, dark green, indigo, brown, gray")
BRANDS = listed(
    "NOVA, LUMA, KIRO, BERG, SOLA, TIVO, MIRA, ORBIT, PEAK, ZEST, FLUX, ALTO, DELI, RIVA"
)

Range = tuple[float, float]


def pick[T](rng: Generator, options: Sequence[T]) -> T:
    return options[int(rng.integers(len(options)))]


def other[T](rng: Generator, options: Sequence[T], than: T) -> T:
    return pick(rng, [o for o in options if o != than])


def seed(rng: Generator) -> int:
    return int(rng.integers(1 << 30))


def mark(
    x: float, y: float, z: float, normal: ArrayLike = (0, 0, 1), heading: ArrayLike = (1, 0, 0)
) -> Pose:
    """A frame at (x, y, z) m: z axis `normal`, x axis as near `heading` as possible."""
    n = np.asarray(normal, float)
    n = n / np.linalg.norm(n)
    h = np.asarray(heading, float)
    h = h - n * (h @ n)
    return frame((x, y, z), h, np.cross(n, h))


def standing(height: float, grasps: Sequence[Grasp] = (), **points: Pose) -> NamedFrames:
    """Frames "base", "top" at `height` (m), and `points`, which may replace both."""
    return NamedFrames({"base": mark(0, 0, 0), "top": mark(0, 0, height), **points}, tuple(grasps))


def hollow(height: float, wall: float, grasps: Sequence[Grasp] = (), **points: Pose) -> NamedFrames:
    """Frames of `standing`, with "inside" and "centre" on a floor `wall` (m) thick."""
    floor = mark(0, 0, wall)
    return standing(height, grasps, inside=floor, centre=floor, **points)


def lean(out: float, up: float) -> float:
    """Degrees from vertical of a wall going `out` over `up`."""
    return float(np.degrees(np.arctan2(out, up)))


LARGE = ("small", "medium-sized", "large")
TALL = ("short", "medium-sized", "tall")
LONG = ("short", "medium-sized", "long")
WIDE = ("narrow", "medium-sized", "wide")


def size_word(value: float, bounds: Range, words: tuple[str, str, str] = LARGE) -> str:
    """The third of a range, as a word."""
    share = (value - bounds[0]) / (bounds[1] - bounds[0])
    return words[min(2, max(0, int(3 * share)))]


def drawn(how: Callable[[Generator, Any], Any], **notes: Any) -> Any:
    """A parameter that `how` draws, given those before it."""
    return field(metadata={"draw": how, "also": "", **notes})


def between(low: float, high: float, of: str = "", size: tuple[str, str, str] | None = None) -> Any:
    """A number between bounds, times the parameter `of`; `size` names its thirds."""

    def how(rng: Generator, so_far: Any) -> float:
        return rng.uniform(low, high) * (getattr(so_far, of) if of else 1.0)

    return drawn(how, range=(low, high), size=size)


def one_of(
    options: Sequence[Any] | Mapping[str, Sequence[Any]],
    other_than: str = "",
    also: str = "",
    by: str = "",
    says: str = "",
) -> Any:
    """One of `options`. `other_than` names a parameter whose value is left out, `also` one whose
    value joins, `by` the key of a mapping. `says` is the fact for phrases, left out if equal to
    `also`."""

    def how(rng: Generator, so_far: Any) -> Any:
        choices = options[getattr(so_far, by)] if isinstance(options, Mapping) else options
        if other_than:
            return other(rng, choices, getattr(so_far, other_than))
        return pick(rng, (getattr(so_far, also), *choices) if also else choices)

    return drawn(how, says=says, also=also)


def texture() -> Any:
    return drawn(lambda rng, so_far: seed(rng))


class Parametric(Family):
    """Base of families with declared parameters. `noun` defaults to the family's name."""

    noun: ClassVar[str] = ""

    @classmethod
    def draw(cls, rng: Generator, **given: Any) -> Self:
        """Draw the parameters in order, except the `given` ones."""
        so_far = SimpleNamespace()
        for parameter in fields(cls):  # pyright: ignore[reportArgumentType]
            name = parameter.name
            value = given[name] if name in given else parameter.metadata["draw"](rng, so_far)
            setattr(so_far, name, value)
        return cls(**vars(so_far))

    def facts(self) -> dict[str, str]:
        """What phrases may state: the parameters that are text, and the size."""
        facts = {name: value for name, value in vars(self).items() if isinstance(value, str)}
        if material := facts.get("material"):
            wooden = material == "wood"
            facts |= {"material": "wooden", "plain": ""} if wooden else {"plain": material}
        for parameter in fields(self):  # pyright: ignore[reportArgumentType]
            notes, value = parameter.metadata, getattr(self, parameter.name)
            if words := notes.get("size"):
                facts["size"] = size_word(value, notes["range"], words)
            if name := notes.get("says"):
                same = notes["also"] and value == getattr(self, notes["also"])
                facts[name] = "" if same else value
        return facts

    def words(self) -> Words:
        family = next(name for name in FAMILIES if FAMILIES[name] is type(self))
        return describe(family, self.noun or family.replace("_", " "), **self.facts())
