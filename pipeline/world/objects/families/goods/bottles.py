"""Bottles, a drink can and a food can."""

from dataclasses import replace

import numpy as np

from pipeline.poses import Pose, compose, pose, quat_about
from pipeline.world.looks.materials import glaze, metal, plastic, print_texture, printed, wrapped
from pipeline.world.shapes import Shape

from ...colliders import convex_collider, cylinder_collider, disc, twelve_sided
from ...contract import NamedFrames, register
from ...geometry import at, band, box, cylinder, revolve
from ...grasping import bar_pinches, side_pinches
from ...kit import BRANDS, COLOURS, LONG, TALL, Parametric, between, mark, one_of, standing, texture

HEIGHT = (0.15, 0.215)
BODY = ("low", "side", "high")
"""Kinds of grasps around the body, firmer than one around the neck."""

NECK_PITCHES = (0, 15, 30)
# height of the shoulder in body radii
FORMS = {"round-shouldered": 0.55, "sloping": 1.7, "square-shouldered": 0.22}


@register("bottle")
class Bottle(Parametric):
    radius: float = between(0.026, 0.032)
    colour: str = one_of(COLOURS)
    height: float = between(*HEIGHT, size=TALL)
    form: str = one_of(tuple(FORMS))
    neck: float = between(0.42, 0.56, of="radius")  # radius of the cap
    cap: float = between(0.014, 0.024)  # height of the cap
    cap_colour: str = one_of(COLOURS, other_than="colour", says="cap")
    label_colour: str = one_of(COLOURS, other_than="colour", says="label")
    brand: str = one_of(BRANDS)
    seed: int = texture()

    @property
    def body(self) -> float:
        return self.height - self.cap - 0.006 - FORMS[self.form] * self.radius

    def outline(self) -> list[tuple[float, float]]:
        """Silhouette (radius, z) from the base to the top of the neck."""
        r, b, n, top = self.radius, self.body, self.neck * 0.85, self.height - self.cap
        share = np.linspace(0, 1, 6)[1:]
        rise = (top - 0.006 - b) * share
        fall = 1 - share**1.4 if self.form == "sloping" else np.sqrt(np.maximum(0, 1 - share**2))
        shoulder = n + (r - n) * fall
        curve = zip(shoulder.tolist(), (b + rise).tolist(), strict=True)
        return [(0.9 * r, 0.0), (r, 0.004), (r, b), *curve, (n, top)]

    def shape(self) -> Shape:
        r, top = self.radius, self.height - self.cap
        outline = self.outline()
        skin = revolve([(0, 0), *outline, (0, top)], 24)
        cap = at(cylinder(self.neck, self.cap, 18, bevel=0.0015), (0, 0, top))
        label = band(r + 0.0004, 0.22 * self.body, 0.8 * self.body)
        image = print_texture(self.label_colour, self.colour, "product", self.brand, self.seed)
        shoulder = [p for p in outline if p[1] >= self.body]
        return Shape(
            ((skin, glaze(self.colour)), (cap, plastic(self.cap_colour)), (label, printed(image))),
            cylinder_collider(r, 0, self.body)
            + convex_collider(twelve_sided(shoulder[:-1]))
            + cylinder_collider(self.neck, top - 0.006, self.height),
            mass=0.75 * 1000 * np.pi * r**2 * self.body,
        )

    def frames(self) -> NamedFrames:
        r, b, top, end = self.radius, self.body, self.height - self.cap, self.height
        outline = [*self.outline()[:-1], (self.neck, top), (self.neck, end)]
        low = side_pinches(r, 0.4 * b, outline=outline, kind="low")
        side = side_pinches(r, 0.65 * b, outline=outline)
        high = side_pinches(r, b - 0.014, outline=outline, kind="high")
        grip, kind = end - 0.35 * self.cap, "neck"
        neck = side_pinches(self.neck, grip, pitches=NECK_PITCHES, outline=outline, kind=kind)
        marks = {"cap": mark(0, 0, end), "middle": mark(0, 0, b / 2)}
        return standing(end, (*low, *side, *high, *neck), **marks)


@register("lying_bottle")
class LyingBottle(Bottle):
    """The origin is under the middle of its length; frame "cap" looks out of the bottle."""

    noun = "bottle"

    height: float = between(*HEIGHT, size=LONG)

    @property
    def _laid(self) -> Pose:
        """Pose of the standing bottle in this frame."""
        return pose((-self.height / 2, 0, self.radius), quat_about((0, 1, 0), np.pi / 2))

    def shape(self) -> Shape:
        upright = super().shape()
        visual = tuple((mesh.moved(self._laid), skin) for mesh, skin in upright.visual)
        pieces = (replace(c, pose=compose(self._laid, c.pose)) for c in upright.collision)
        return replace(upright, visual=visual, collision=tuple(pieces))

    def frames(self) -> NamedFrames:
        r, end = self.radius, self.height / 2
        along = [share * self.body - end for share in (0.3, 0.45, 0.6, 0.75)]
        cap = mark(end, 0, r, (1, 0, 0), (0, 0, -1))
        return standing(2 * r, bar_pinches(along, r, r, kind="body"), cap=cap)


@register("pill_bottle")
class PillBottle(Parametric):
    radius: float = between(0.02, 0.027)
    colour: str = one_of(("orange", "white", *COLOURS))
    height: float = between(0.07, 0.1, size=TALL)
    cap: float = between(0.014, 0.02)  # height of the cap
    cap_radius: float = between(0.82, 1.0, of="radius")
    cap_colour: str = one_of(("white", *COLOURS), other_than="colour", says="cap")
    ink: str = one_of(("red", "blue", "green", "purple", "black", "teal"))
    brand: str = one_of(BRANDS)
    seed: int = texture()

    def shape(self) -> Shape:
        r, top = self.radius, self.height - self.cap
        side = [(0, 0), (0.93 * r, 0), (r, 0.002), (r, top - 0.008), (0.78 * r, top), (0, top)]
        body = revolve(side, 24)
        cap = at(cylinder(self.cap_radius, self.cap, 20, 0.0015), (0, 0, top))
        label = band(r + 0.0004, 0.14 * top, 0.74 * top)
        image = print_texture("white", self.ink, "product", self.brand, self.seed)
        return Shape(
            (
                (body, plastic(self.colour)),
                (cap, plastic(self.cap_colour)),
                (label, printed(image)),
            ),
            cylinder_collider(r, 0, top - 0.004)
            + cylinder_collider(0.78 * r, 0, top)
            + cylinder_collider(self.cap_radius, top, self.height),
            mass=600 * np.pi * r * r * self.height,
            friction=0.5,
        )

    def frames(self) -> NamedFrames:
        r, top, cap = self.radius, self.height - self.cap, self.cap_radius
        outline = [(r, 0.0), (r, top - 0.006), (cap, top), (cap, self.height)]
        grasps = side_pinches(r, (0.5 * top, top - 0.014), outline=outline)
        return standing(self.height, grasps, middle=mark(0, 0, top / 2))


@register("can")
class Can(Parametric):
    colour: str = one_of(COLOURS)
    radius: float = between(0.026, 0.033)
    height: float = between(0.085, 0.125, size=TALL)
    ink: str = one_of(COLOURS, other_than="colour")
    style: str = one_of(("product", "stripes", "diamond", "dots"))  # print
    brand: str = one_of(BRANDS)
    seed: int = texture()

    def shape(self) -> Shape:
        r, h = self.radius, self.height
        bottom = [(0, 0.002), (0.72 * r, 0.002), (0.78 * r, 0), (r, 0.008)]
        lid = [(r, h - 0.010), (0.84 * r, h), (0.8 * r, h - 0.003), (0, h - 0.003)]
        tab = at(box(0.009, 0.005, 0.0006), (0.3 * r, 0, h - 0.0020))
        image = print_texture(self.colour, self.ink, self.style, self.brand, self.seed)
        tin = wrapped("turned", "silver", self.seed, 0.4, metallic=0.8)
        return Shape(
            (
                (revolve([*bottom, *lid], 24), tin),
                (band(r + 0.0003, 0.008, h - 0.010), printed(image, roughness=0.3)),
                (tab, metal()),
            ),
            disc(0.8 * r, 0.008)
            + cylinder_collider(r, 0.006, h - 0.008)
            + disc(0.84 * r, 0.01, h - 0.01),
            mass=0.75 * 1000 * np.pi * r * r * h,
            friction=0.5,
        )

    def frames(self) -> NamedFrames:
        r, h = self.radius, self.height
        outline = [(0.8 * r, 0.0), (r, 0.008), (r, h - 0.01), (0.84 * r, h)]
        grasps = side_pinches(r, (0.5 * h, h - 0.026), outline=outline)
        return standing(h, grasps, middle=mark(0, 0, h / 2))


CONTENTS = ("TOMATO", "BEANS", "SOUP", "CORN", "PEAS", "CURRY", "PESTO", "CHILI")


@register("sauce_can")
class SauceCan(Parametric):
    colour: str = one_of(COLOURS)
    radius: float = between(0.027, 0.033)
    height: float = between(0.07, 0.10, size=TALL)
    label: float = between(0.72, 0.9)  # share of the height that the label covers
    ink: str = one_of(COLOURS, other_than="colour")
    content: str = one_of(CONTENTS)
    seed: int = texture()

    def shape(self) -> Shape:
        r, h, edge = self.radius, self.height, 0.5 * (1 - self.label) * self.height
        top, rib = h - 0.003, h - 0.0018
        body = revolve([(0, 0), (r, 0), (r, h), (0.93 * r, h), (0.9 * r, top), (0, top)], 24)
        ribs = revolve([(0.45 * r, top), (0.45 * r, rib), (0.4 * r, rib), (0.4 * r, top)], 20)
        label = band(r + 0.0004, edge, h - edge)
        image = print_texture(self.colour, self.ink, "product", self.content, self.seed)
        return Shape(
            ((body, metal()), (ribs, metal()), (label, printed(image, 0.6))),
            disc(r, h),
            mass=0.8 * 1050 * np.pi * r * r * h,
            friction=0.5,
        )

    def frames(self) -> NamedFrames:
        r, h = self.radius, self.height
        grasps = side_pinches(r, (0.5 * h, h - 0.022), outline=[(r, 0.0), (r, h)])
        return standing(h, grasps, middle=mark(0, 0, h / 2))

    def facts(self) -> dict[str, str]:
        content = "tomatoes" if self.content == "TOMATO" else self.content.lower()
        return super().facts() | {"content": content}
