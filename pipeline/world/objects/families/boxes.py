"""Printed boxes: playing cards, tea, coffee."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from pipeline.poses import quat_about, quat_multiply
from pipeline.world.materials import print_texture, printed
from pipeline.world.objects.colliders import box_collider
from pipeline.world.objects.contract import Family, NamedFrames, Words, register
from pipeline.world.objects.geometry import at, box, decal
from pipeline.world.objects.grasping import box_pinches
from pipeline.world.objects.kit import BRANDS, COLOURS, mark, other, pick, seed, size_word
from pipeline.world.objects.words import describe
from pipeline.world.shapes import Shape

STYLES = ("label", "stripes", "dots", "diamond")
TEA = (0.08, 0.11)
COFFEE = (0.105, 0.145)
CARDS = (0.080, 0.092)


def carton(
    hx: float, hy: float, hz: float, colour: str, ink: str, style: str, text: str, texture: int, bevel: float = 0.0008
) -> tuple:
    """Visual part of a printed box standing on the table."""
    return at(box(hx, hy, hz, bevel), (0, 0, hz)), printed(print_texture(colour, ink, style, text, texture), 0.55)


def upright(turns: float) -> np.ndarray:
    """Quaternion that stands a decal upright facing -y, turned on by `turns` quarters about z."""
    return quat_multiply(quat_about((0, 0, 1), turns * np.pi / 2), quat_about((1, 0, 0), np.pi / 2))


@register("playing_cards")
@dataclass(frozen=True)
class PlayingCards(Family):
    """A boxed deck lying flat, its long side along y."""

    hx: float
    length: float
    height: float
    colour: str
    ink: str
    style: str
    brand: str
    seed: int

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Self:
        colour = pick(rng, COLOURS)
        return cls(
            rng.uniform(0.028, 0.033),
            rng.uniform(*CARDS),
            rng.uniform(0.019, 0.027),
            colour,
            other(rng, COLOURS, colour),
            pick(rng, STYLES),
            pick(rng, BRANDS),
            seed(rng),
        )

    def shape(self) -> Shape:
        hx, hy, hz = self.hx, self.length / 2, self.height / 2
        return Shape(
            visual=(carton(hx, hy, hz, self.colour, self.ink, self.style, self.brand, self.seed),),
            collision=box_collider(hx, hy, hz, (0, 0, hz)),
            mass=0.1,
            friction=0.5,
        )

    def frames(self) -> NamedFrames:
        return NamedFrames(
            {"base": mark(0, 0, 0), "top": mark(0, 0, self.height)},
            box_pinches(self.hx, self.length / 2, self.height / 2, axes="x"),
        )

    def words(self) -> Words:
        return describe(
            "playing_cards",
            "card deck",
            colour=self.colour,
            size=size_word(self.height, (0.019, 0.027), ("thin", "medium-sized", "thick")),
            ink=self.ink,
        )


@register("tea_box")
@dataclass(frozen=True)
class TeaBox(Family):
    """A standing tea box with a bar code block on each of its four sides."""

    hx: float
    hy: float
    height: float
    colour: str
    ink: str
    style: str
    seed: int

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Self:
        colour = pick(rng, COLOURS)
        return cls(
            rng.uniform(0.026, 0.033),
            rng.uniform(0.026, 0.034),
            rng.uniform(*TEA),
            colour,
            other(rng, COLOURS, colour),
            pick(rng, STYLES),
            seed(rng),
        )

    def shape(self) -> Shape:
        hx, hy, hz = self.hx, self.hy, self.height / 2
        code = printed(print_texture("white", "black", "qr", "", self.seed), 0.6)
        size = 0.8 * min(hx, hy)
        codes = [
            (decal(size, size, (x, y, self.code_height), upright(k)), code)
            for k, (x, y) in enumerate(((0, -hy - 0.0004), (hx + 0.0004, 0), (0, hy + 0.0004), (-hx - 0.0004, 0)))
        ]
        return Shape(
            visual=(carton(hx, hy, hz, self.colour, self.ink, self.style, "TEA", self.seed), *codes),
            collision=box_collider(hx, hy, hz, (0, 0, hz)),
            mass=0.12,
            friction=0.5,
        )

    @property
    def code_height(self) -> float:
        """Height of the middle of the codes (m)."""
        return 0.25 * self.height

    def frames(self) -> NamedFrames:
        z, hx, hy = self.code_height, self.hx, self.hy
        return NamedFrames(
            {
                "base": mark(0, 0, 0),
                "top": mark(0, 0, self.height),
                "front": mark(0, -hy, z, (0, -1, 0)),
                "back": mark(0, hy, z, (0, 1, 0)),
                "right": mark(hx, 0, z, (1, 0, 0), (0, 1, 0)),
                "left": mark(-hx, 0, z, (-1, 0, 0), (0, 1, 0)),
            },
            box_pinches(hx, hy, self.height / 2),
        )

    def words(self) -> Words:
        return describe(
            "tea_box",
            "tea box",
            colour=self.colour,
            size=size_word(self.height, TEA, ("short", "medium-sized", "tall")),
            ink=self.ink,
        )


@register("coffee_box")
@dataclass(frozen=True)
class CoffeeBox(Family):
    """A standing coffee box, wider than deep."""

    hx: float
    hy: float
    height: float
    colour: str
    ink: str
    style: str
    brand: str
    seed: int

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Self:
        colour = pick(rng, COLOURS)
        return cls(
            rng.uniform(0.038, 0.050),
            rng.uniform(0.026, 0.033),
            rng.uniform(*COFFEE),
            colour,
            other(rng, COLOURS, colour),
            pick(rng, STYLES),
            pick(rng, ("COFFEE", "MOCHA", "ROAST", "BEANS", "LATTE")),
            seed(rng),
        )

    def shape(self) -> Shape:
        hx, hy, hz = self.hx, self.hy, self.height / 2
        fold = at(box(0.98 * hx, 0.004, 0.0035), (0, 0, 2 * hz - 0.0035))
        body = carton(hx, hy, hz - 0.0025, self.colour, self.ink, self.style, self.brand, self.seed, 0.002)
        return Shape(
            visual=(body, (fold, printed(print_texture(self.ink, self.colour, "stripes", "", self.seed)))),
            collision=box_collider(hx, hy, hz, (0, 0, hz)),
            mass=0.28,
            friction=0.5,
        )

    def frames(self) -> NamedFrames:
        return NamedFrames(
            {"base": mark(0, 0, 0), "top": mark(0, 0, self.height)}, box_pinches(self.hx, self.hy, self.height / 2, axes="y")
        )

    def words(self) -> Words:
        return describe(
            "coffee_box",
            "coffee box",
            colour=self.colour,
            size=size_word(self.height, COFFEE, ("short", "medium-sized", "tall")),
            ink=self.ink,
        )
