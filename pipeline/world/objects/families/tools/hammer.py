"""A mallet standing on its striking face, its grip level along -x, and a rolling pin along x."""

from dataclasses import replace

import numpy as np

from pipeline.poses import pose
from pipeline.world.looks.materials import WOODS, made_of, metal, painted, plastic, rubber, wood
from pipeline.world.objects.colliders import ALONG_X, box_collider, cylinder_collider
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.geometry import at, cylinder, revolve
from pipeline.world.objects.grasping import bar_pinches
from pipeline.world.objects.kit import (
    COLOURS,
    LONG,
    Parametric,
    between,
    drawn,
    mark,
    one_of,
    standing,
    texture,
)
from pipeline.world.objects.surface import join
from pipeline.world.shapes import Collider, Shape

_STEEL_TO_WOOD = 9.0
_METALS = ("silver", "charcoal", "gray")


@register("hammer")
class Hammer(Parametric):
    grip: str = one_of(("wood", "rubber"))
    length: float = between(0.17, 0.23, size=LONG)  # of the grip, from the head's axis
    half: float = between(0.01, 0.0125)  # half thickness of the grip
    face: float = between(0.021, 0.026)  # radius of the striking face
    reach: float = between(0.066, 0.082)  # height of the head as it stands
    colour: str = one_of(
        {"wood": ("oak", "walnut", "beech", "mahogany"), "rubber": COLOURS}, by="grip"
    )
    head_colour: str = one_of((*_METALS, "red", "blue"))
    seed: int = texture()

    def shape(self) -> Shape:
        h, f, long, z = self.half, self.face, self.length, self.reach / 2
        skin = made_of(self.grip, self.colour, self.seed)
        bare = self.head_colour in _METALS
        steel = metal(self.head_colour) if bare else painted(self.head_colour)
        ribs = []
        if self.grip == "rubber":
            ribs = [(share * h, x) for x in (0.04, 0.05, 0.06) for share in (1.02, 0.88)]
        swell = [(0.86 * h, 0.35 * long), (h, 0.62 * long), (0.6 * h, 0.7 * long)]
        swell += [(0.6 * h, long), (0, long)]
        shaft = revolve([(0.86 * h, 0.018), *ribs, *swell], 12, crease=60)
        butt = [(0, -0.002), (0.6 * h, -0.002), (1.02 * h, 0.004), (1.02 * h, 0.016)]
        r, top = 0.82 * f, self.reach
        face = [(0, 0), (f - 0.003, 0), (f, 0.003), (f, 0.011), (r, 0.016)]
        faces = join(revolve(face, 18), revolve([(x, top - y) for x, y in reversed(face)], 18))
        collar = at(cylinder(1.25 * h, 2 * r + 0.004, 12, 0.002), (-r - 0.002, 0, z), ALONG_X)
        # flat sides, as real grips have: two round pads on a round bar let the head swing
        grip = Collider("box", ((long - f) / 2, h, h), pose((-(long + f) / 2, 0, z)))
        end = revolve([*butt, (0.9 * h, 0.018)], 12)
        head = cylinder_collider(f, 0.0, self.reach)
        return Shape(
            (
                (at(shaft, (-long, 0, z), ALONG_X), skin),
                (at(end, (-long, 0, z), ALONG_X), rubber("black")),
                (revolve([(r, 0.016), (r, top - 0.016)], 18), steel),
                (faces, metal("silver", self.seed)),
                (collar, steel),
            ),
            (*(replace(c, weight=_STEEL_TO_WOOD) for c in head), grip),
            mass=0.17 * (f / 0.0235) ** 2,
            friction=0.7,
        )

    def frames(self) -> NamedFrames:
        h, long, z = self.half, self.length, self.reach / 2
        return standing(
            self.reach,
            bar_pinches([-0.7 * long, -0.6 * long, -0.5 * long], h, z, kind="handle"),
            face=mark(0, 0, 0, (0, 0, -1)),
            grip=mark(-0.6 * long, 0, z),
        )

    def facts(self) -> dict[str, str]:
        return super().facts() | {
            "grip": self.colour if self.grip == "wood" else f"{self.colour} rubber",
            "hafted": "wooden-handled" if self.grip == "wood" else "rubber-handled",
            "head": self.head_colour,
        }


@register("roller")
class Roller(Parametric):
    noun = "rolling pin"

    length: float = between(0.30, 0.38, size=LONG)
    radius: float = between(0.021, 0.029)
    # length of the thick part
    body: float = drawn(lambda rng, pin: pin.length - 2 * rng.uniform(0.062, 0.078))
    handle: float = between(0.48, 0.6, of="radius")  # radius of the handles
    wood: str = one_of(tuple(WOODS))
    handle_colour: str = one_of(("", *COLOURS))  # "" for handles of the same wood
    seed: int = texture()

    def shape(self) -> Shape:
        r, h, half, end = self.radius, self.handle, self.body / 2, self.length / 2
        span, middle = end - half, (end + half) / 2
        side = [(0, -half), (0.9 * r, -half), (r, -half + 0.003)]
        body = revolve([*side, (r, half - 0.003), (0.9 * r, half), (0, half)], 24)
        tip = [(h, 0.6 * span), (0.8 * h, span - 0.006), (0.5 * h, span), (0, span)]
        grip = revolve([(0, 0), (0.75 * h, 0), (h, 0.018), *tip], 16, crease=60)
        plain, seed = not self.handle_colour, self.seed
        other = wood(self.wood, seed + 1) if plain else plastic(self.handle_colour)
        mirrored = np.array([0.7071067811865476, 0, -0.7071067811865476, 0])
        ends = (r - span / 2, r + span / 2)
        return Shape(
            (
                (at(body, (0, 0, r), ALONG_X), wood(self.wood, seed)),
                (at(grip, (half, 0, r), ALONG_X), other),
                (at(grip, (-half, 0, r), mirrored), other),
            ),
            (
                *cylinder_collider(r, r - half, r + half, (0, 0), ALONG_X),
                # a flat to rest on, so that it does not roll away
                *box_collider(half, 0.35 * r, 0.5 * r, (0, 0, 0.5 * r)),
                *cylinder_collider(h, *ends, (middle, 0), ALONG_X),
                *cylinder_collider(h, *ends, (-middle, 0), ALONG_X),
            ),
            mass=650 * np.pi * (r**2 * self.body + h**2 * (self.length - self.body)),
        )

    def frames(self) -> NamedFrames:
        half, end, r = self.body / 2, self.length / 2, self.radius
        places = [half + 0.55 * (end - half), half + 0.7 * (end - half)]
        grips = []
        for kind, sign in (("left_end", -1), ("right_end", 1)):
            xs = [sign * x for x in places]
            grips += bar_pinches(xs, self.handle, r, rolls=(-20, 0, 20), kind=kind)
        return standing(
            2 * r,
            grips,
            left_end=mark(-end, 0, r, (-1, 0, 0), (0, 0, 1)),
            right_end=mark(end, 0, r, (1, 0, 0), (0, 0, 1)),
        )

    def facts(self) -> dict[str, str]:
        return super().facts() | {"colour": self.wood, "handles": self.handle_colour or self.wood}
