"""What lies in a hand: a phone, a remote control, a computer mouse."""

import numpy as np

from pipeline.world.looks.materials import plastic, print_texture, printed, rubber, wrapped
from pipeline.world.objects.colliders import ALONG_X, convex_collider, slab
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.geometry import (
    at,
    cylinder,
    decal,
    extrude,
    rounded_rectangle,
    stack,
    stacked,
)
from pipeline.world.objects.grasping import box_pinches
from pipeline.world.objects.kit import (
    COLOURS,
    LARGE,
    LONG,
    Parametric,
    between,
    mark,
    one_of,
    standing,
    texture,
)
from pipeline.world.shapes import Shape, seen_along

SCREENS = ("navy", "sky blue", "lavender", "coral", "mint", "gold", "pink", "teal", "white")


@register("phone")
class Phone(Parametric):
    """Lies on its back, its top towards +y."""

    hx: float = between(0.03, 0.034)
    height: float = between(0.125, 0.152, size=LARGE)
    thickness: float = between(0.0145, 0.018)
    corner: float = between(0.004, 0.01)
    colour: str = one_of(COLOURS)
    screen: str = one_of(SCREENS)
    style: str = one_of(("dots", "stripes", "diamond", "panel"))
    seed: int = texture()

    def shape(self) -> Shape:
        hx, hy, t = self.hx, self.height / 2, self.thickness
        case = extrude(rounded_rectangle(hx, hy, self.corner, 3), t, bevel=0.002)
        black = decal(1.88 * hx, 1.92 * hy, (0, 0, t + 0.0002))
        glass = decal(1.78 * hx, 1.74 * hy, (0, 0, t + 0.0004))
        accent = "white" if self.screen != "white" else "navy"
        image = printed(print_texture(self.screen, accent, self.style, "12:45", self.seed), 0.2)
        return Shape(
            ((case, plastic(self.colour)), (black, plastic("black")), (glass, image)),
            slab(hx, hy, t),
            mass=0.19,
        )

    def frames(self) -> NamedFrames:
        hy, t = self.height / 2, self.thickness
        grasps = box_pinches(self.hx, hy, t / 2, offsets=(0.0, 0.3, 0.55), axes="x")
        return standing(t, grasps, screen=mark(0, 0, t), foot=mark(0, -hy, 0))


@register("remote")
class RemoteControl(Parametric):
    """Lies on its back, its top towards +y."""

    noun = "remote control"

    hx: float = between(0.019, 0.026)
    colour: str = one_of(COLOURS)
    length: float = between(0.13, 0.185, size=LONG)
    thickness: float = between(0.018, 0.025)
    corner: float = between(0.3, 0.95, of="hx")
    keypad: float = between(0.6, 0.85)  # share of the length covered by keys
    keys: str = one_of(("white", "black", "gray", "cyan", "yellow", "beige"), other_than="colour")
    seed: int = texture()

    def shape(self) -> Shape:
        hx, hy, t = self.hx, self.length / 2, self.thickness
        body = extrude(rounded_rectangle(hx, hy, self.corner, 5), t, bevel=0.004)
        pad = decal(1.5 * hx, 2 * self.keypad * hy, (0, (0.9 - self.keypad) * hy, t + 0.0004))
        keys = printed(print_texture(self.colour, self.keys, "keys", "", self.seed), 0.5)
        visual = (body, plastic(self.colour)), (pad, keys)
        return Shape(visual, slab(hx, hy, t), mass=0.12)

    def frames(self) -> NamedFrames:
        half = self.hx, self.length / 2, self.thickness / 2
        return standing(self.thickness, box_pinches(*half, offsets=(-0.3, 0.0, 0.3), axes="x"))


LEVELS = (
    (0.0, 0.94, 0.95),
    (0.08, 1.0, 1.0),
    (0.5, 0.99, 0.985),
    (0.72, 0.94, 0.92),
    (0.9, 0.78, 0.74),
    (1.0, 0.42, 0.42),
)


@register("mouse")
class Mouse(Parametric):
    """The buttons are towards +y."""

    colour: str = one_of(COLOURS)
    hx: float = between(0.027, 0.032)
    length: float = between(0.092, 0.115, size=LARGE)
    height: float = between(0.034, 0.041)
    pinch: float = between(0.0, 0.06)  # how much narrower the waist is, as a share
    wheel: str = one_of(("black", "gray", "white", "red", "cyan", "lime"), other_than="colour")

    def outline(self) -> np.ndarray:
        """An oval (20,2) with a waist."""
        angle = 2 * np.pi * np.arange(20) / 20
        c, s, pinch = np.cos(angle), np.sin(angle), self.pinch
        x = self.hx * np.sign(c) * np.abs(c) ** 0.62 * (1 - pinch * (1 - s**2))
        y = self.length / 2 * np.sign(s) * np.abs(s) ** 0.85
        return np.column_stack([x / (1 - pinch), y]) * [1 - pinch, 1]

    def shape(self) -> Shape:
        h, hy = self.height, self.length / 2
        levels = [(z * h, x, y) for z, x, y in LEVELS]
        body = stack(self.outline(), levels, 60)
        wheel = at(cylinder(0.009, 0.006, 14), (-0.003, 0.5 * hy, 0.8 * h), ALONG_X)
        body = seen_along(body, np.eye(2, 3), np.ptp(self.outline(), axis=0))
        skin = wrapped("shell", self.colour, int(1e6 * self.length), 0.42)
        return Shape(
            ((body, skin), (wheel, rubber(self.wheel))),
            convex_collider(stacked(self.outline(), levels).reshape(-1, 3)),
            mass=0.1,
        )

    def frames(self) -> NamedFrames:
        half = self.hx * (1 - self.pinch), self.length / 2, self.height / 2
        heights, offsets = (0.014, 0.019), (-0.12, 0.0, 0.12)
        grasps = box_pinches(*half, heights=heights, offsets=offsets, axes="x")
        return standing(self.height, grasps)
