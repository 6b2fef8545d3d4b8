"""A mallet, its grip along -x, a rolling pin along x, a stamp, a stapler."""

from dataclasses import replace

import numpy as np

from pipeline.poses import pose, quat_about, quat_from_rpy
from pipeline.world.looks.materials import (
    WOODS,
    made_of,
    metal,
    painted,
    plastic,
    print_texture,
    printed,
    rubber,
    wood,
)
from pipeline.world.shapes import Collider, Shape

from ...colliders import ALONG_X, box_collider, cylinder_collider, disc, prism_collider, slab
from ...contract import NamedFrames, register
from ...geometry import at, band, box, cylinder, decal, revolve, side_prism
from ...grasping import bar_pinches, box_pinches, side_pinches
from ...kit import (
    BRANDS,
    COLOURS,
    LARGE,
    LONG,
    Parametric,
    between,
    drawn,
    mark,
    one_of,
    standing,
    texture,
)
from ...surface import join

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
        long, z = self.length, self.reach / 2
        places = [-0.7 * long, -0.6 * long, -0.5 * long]
        grasps = bar_pinches(places, self.half, z, kind="handle")
        face, grip = mark(0, 0, 0, (0, 0, -1)), mark(-0.6 * long, 0, z)
        return standing(self.reach, grasps, face=face, grip=grip)

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
        grips, ends = [], {}
        for kind, s in (("left_end", -1), ("right_end", 1)):
            places = [s * (half + share * (end - half)) for share in (0.55, 0.7)]
            grips += bar_pinches(places, self.handle, r, rolls=(-20, 0, 20), kind=kind)
            ends[kind] = mark(s * end, 0, r, (s, 0, 0), (0, 0, 1))
        return standing(2 * r, grips, **ends)

    def facts(self) -> dict[str, str]:
        return super().facts() | {"colour": self.wood, "handles": self.handle_colour or self.wood}


@register("seal")
class Seal(Parametric):
    noun = "stamp"

    material: str = one_of(("wood", "plastic"))
    half: float = between(0.022, 0.03)  # of the block
    block: float = between(0.016, 0.024)  # height of the block
    height: float = between(0.085, 0.11, size=LARGE)
    grip: float = between(0.012, 0.017)  # radius of the handle
    form: str = one_of(("round", "square"))
    colour: str = one_of(
        {"wood": ("oak", "walnut", "beech", "mahogany", "pine"), "plastic": COLOURS}, by="material"
    )
    ink: str = one_of(("red", "blue", "black", "green", "purple"), says="face")
    seed: int = texture()

    def shape(self) -> Shape:
        a, b, h, g = self.half, self.block, self.height, self.grip
        skin, foot, rise = made_of(self.material, self.colour, self.seed), 0.006, h - b
        is_round = self.form == "round"
        if is_round:
            pad, block = cylinder(a, foot, 24), at(cylinder(a, b - foot, 24, 0.002), (0, 0, foot))
            label = band(a + 0.0003, foot + 0.15 * (b - foot), b - 0.18 * (b - foot))
        else:
            pad = at(box(a, a, foot / 2), (0, 0, foot / 2))
            block = at(box(a, a, (b - foot) / 2, 0.002), (0, 0, (b + foot) / 2))
            face, turn = (0, -a - 0.0003, (b + foot) / 2), quat_about((1, 0, 0), np.pi / 2)
            front = decal(1.5 * a, 0.62 * (b - foot), face, turn)
            turns = (quat_about((0, 0, 1), k * np.pi / 2) for k in range(4))
            label = join(*(at(front, quaternion=turn) for turn in turns))
        neck = [(0.7 * g, b - 0.001), (0.62 * g, b + 0.15 * rise), (g, b + 0.42 * rise)]
        knob = [(g, h - 0.6 * g), (0.75 * g, h - 0.18 * g), (0.4 * g, h), (0, h)]
        bead = [(0.86 * g, b + 0.002), (0.80 * g, b + 0.004), (0.62 * g, b + 0.0045)]
        return Shape(
            (
                (pad, rubber(self.ink)),
                (block, skin),
                (revolve([*neck, *knob], 20, 60), skin),
                (revolve([(0.80 * g, b), *bead], 20, 60), metal("gold")),
                (label, printed(print_texture("white", self.ink, "label", "PAID"), 0.6)),
            ),
            (disc(a, b) if is_round else slab(a, a, b))
            + cylinder_collider(0.65 * g, b - 0.001, b + 0.3 * rise)
            + cylinder_collider(g, b + 0.38 * rise, h - 0.3 * g)
            + cylinder_collider(0.5 * g, h - 0.4 * g, h),
            mass=0.12,
        )

    def frames(self) -> NamedFrames:
        a, b, h, g = self.half, self.block, self.height, self.grip
        neck = [(0.65 * g, b + 0.0005), (g, b + 0.4 * (h - b)), (g, h - 0.5 * g), (0.5 * g, h)]
        outline, heights = [(a, 0.0), (a, b), *neck], (b + 0.55 * (h - b), h - 0.9 * g)
        grasps = side_pinches(g, heights, outline=outline, kind="handle")
        return standing(h, grasps, stamp=mark(0, 0, 0, (0, 0, -1)))


@register("stapler")
class Stapler(Parametric):
    """The mouth is towards +x."""

    colour: str = one_of(COLOURS)
    length: float = between(0.12, 0.155, size=LONG)
    half: float = between(0.016, 0.021)
    height: float = between(0.05, 0.062)
    gape: float = between(0.009, 0.015)  # height of the mouth
    nose: float = between(0.6, 0.85)  # height of the upper arm at the mouth, as a share
    trim: str = one_of(
        ("black", "silver", "gray", "white", "red", "navy"), other_than="colour", says="base"
    )

    def arm(self) -> np.ndarray:
        """Outline (K,2) of the upper arm in x and z, counter-clockwise seen from -y."""
        a, h = self.length / 2, self.height
        jaw = 0.012 + self.gape
        nose = jaw + self.nose * (h - jaw)
        under = [(-a, 0.012), (-0.7 * a, 0.014), (0.96 * a, jaw), (a, jaw + 0.004)]
        roof = [(0.97 * a, nose), (0.55 * a, h - 0.002), (-0.45 * a, h)]
        return np.array([*under, *roof, (-0.85 * a, 0.82 * h), (-a, 0.55 * h)])

    def shape(self) -> Shape:
        a, w, roof = self.length / 2, self.half, self._roof(0)
        top = self.gape + 0.014
        end = 0.93 * a
        rail = [(-0.6 * a, 0.015), (end, 0.009 + self.gape), (end, top), (-0.6 * a, 0.022)]
        grip = (0.45 * a, 0, self._roof(0.45 * a) - 0.0008)
        brand = print_texture(self.colour, self.trim, "label", BRANDS[round(a * 1e5) % len(BRANDS)])
        size, out = (0.5 * a, 0.35 * roof), 0.92 * w + 0.0004
        turns = ((s, quat_from_rpy(np.pi / 2, 0, yaw)) for s, yaw in ((-1, 0.0), (1, np.pi)))
        names = [decal(*size, (0, s * out, 0.62 * roof), turn) for s, turn in turns]
        return Shape(
            (
                *((name, printed(brand)) for name in names),
                (at(box(a, w, 0.006, 0.0025), (0, 0, 0.006)), plastic(self.trim)),
                (side_prism(self.arm(), 0.92 * w, 0.004, crease=55), plastic(self.colour)),
                (side_prism(np.array(rail), 0.8 * w), metal()),
                (at(box(0.008, 0.5 * w, 0.0008), (0.86 * a, 0, 0.0126)), metal()),
                (at(box(0.28 * a, 0.5 * w, 0.002, 0.001), grip), rubber(self.trim)),
                (at(box(0.006, 1.0 * w, 0.008), (-0.86 * a, 0, 0.022)), metal()),
            ),
            box_collider(a, w, 0.006, (0, 0, 0.006)) + prism_collider(self.arm(), 0.92 * w),
            mass=0.22,
        )

    def _roof(self, x: float) -> float:
        top = self.arm()[3:8][::-1]
        return float(np.interp(x, top[:, 0], top[:, 1]))

    def frames(self) -> NamedFrames:
        a, h, x = self.length / 2, self.height, 0.55 * self.length / 2
        half, offsets = (a, 0.92 * self.half, h / 2), (-0.35, -0.1, 0.15)
        grasps = box_pinches(*half, heights=(0.55 * h,), offsets=offsets, axes="y")
        return standing(h, grasps, top=mark(-0.45 * a, 0, h), press=mark(x, 0, self._roof(x)))
