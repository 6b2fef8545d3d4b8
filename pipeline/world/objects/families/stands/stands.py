"""What others stand, lean or hang on."""

import numpy as np

from pipeline.poses import quat_about
from pipeline.world.looks.materials import WOODS, made_of, shaded
from pipeline.world.shapes import Material, Shape

from ...colliders import arc_of_capsules, box_collider, cylinder_collider, disc
from ...contract import NamedFrames, register
from ...geometry import at, box, cylinder, extrude, revolve, rounded_rectangle, sphere, stack, sweep
from ...kit import COLOURS, LARGE, TALL, WIDE, Parametric, between, mark, one_of, standing, texture

TONES = {
    "wood": ("oak", "walnut", "pine", "birch"),
    "metal": ("silver", "gold", "charcoal"),
    "painted": COLOURS,
    "ceramic": COLOURS,
}


@register("display_stand")
class DisplayStand(Parametric):
    radius: float = between(0.055, 0.075, size=LARGE)  # of the plate; half extent of a square one
    material: str = one_of(tuple(TONES))
    height: float = between(0.045, 0.085)
    foot: float = between(0.75, 0.95, of="radius")
    column: float = between(0.2, 0.45, of="radius")
    plate: float = between(0.007, 0.012)  # thickness
    form: str = one_of(("round", "square"))
    colour: str = one_of(TONES, by="material")
    seed: int = texture()

    def shape(self) -> Shape:
        r, h, f, c, t = self.radius, self.height, self.foot, self.column, self.plate
        skin, is_round = made_of(self.material, self.colour, self.seed), self.form == "round"
        foot = [(f - 0.001, 0.0), (f, 0.002), (f - 0.002, 0.007), (1.15 * c, 0.016)]
        bead = [(c + 0.003, 0.020), (c + 0.003, 0.023), (0.96 * c, 0.0245)]
        neck = [(0.8 * c, 0.5 * h), (0.9 * c, h - t - 0.006), (1.2 * c, h - t)]
        edge = [(r - 0.003, 0), *_edge(r, t)]
        if is_round:
            plate = revolve([(0, 0), *edge, (0, t)], 28, 35)
            felt = revolve([(0.88 * r, 0.0006), (0, 0.0006)], 28)
            top = disc(r, t, h - t)
        else:
            square = rounded_rectangle(r, r, 0.1 * r, 3)
            plate = stack(square, [(z, x / r, x / r) for x, z in edge], 35)
            felt = extrude(square * 0.88, 0.0006)
            top = box_collider(r, r, t / 2, (0, 0, h - t / 2))
        return Shape(
            (
                (revolve([(0, 0), (f, 0)], 20), skin),
                (revolve([*foot, *bead, *neck], 20, 35), skin),
                (at(plate, (0, 0, h - t)), skin),
                (at(felt, (0, 0, h)), Material(shaded(self.colour, 0.80), 0.95)),
            ),
            disc(f, 0.012) + cylinder_collider(c, 0.01, h - t) + top,
            mass=0.5,
            friction=0.7,
        )

    def frames(self) -> NamedFrames:
        return standing(self.height, centre=mark(0, 0, self.height))


def _edge(r: float, t: float) -> list[tuple[float, float]]:
    return [(r, 0.25 * t), (r - 0.0006, 0.58 * t), (r - 0.0025, 0.64 * t), (r - 0.003, t)]


PHONE_STAND_TONES = {
    "plastic": COLOURS,
    "metal": ("silver", "charcoal", "gold"),
    "wood": ("oak", "walnut", "beech", "pine"),
}


@register("phone_stand")
class PhoneStand(Parametric):
    """Faces -y: a foot plate, a back rest that leans away, a level ledge and a lip. A phone that
    comes straight down is between lip and back rest only at the very end: a stand that moves does
    not meet it before."""

    material: str = one_of(tuple(PHONE_STAND_TONES))
    hx: float = between(0.034, 0.045, size=WIDE)  # half extent
    depth: float = between(0.045, 0.055)  # half extent of the foot along y
    back: float = between(0.075, 0.1)  # length of the back rest
    lean: float = between(np.radians(58), np.radians(68))  # rad of the back rest above horizontal
    # depth of the level ledge in front of the back rest, up to the lip
    ledge: float = between(0.022, 0.026)
    colour: str = one_of(PHONE_STAND_TONES, by="material")
    seed: int = texture()

    def boxes(self) -> list[tuple[tuple[float, float, float], np.ndarray, np.ndarray]]:
        """Half extents, centre and quaternion of each part."""
        up, out = self.directions()
        turn, flat = quat_about((1, 0, 0), self.lean), quat_about((0, 0, 1), 0.0)
        seat, hx, t, ledge = self.seat_at(), self.hx, 0.0028, self.ledge
        rest = seat + up * (self.back / 2 - 0.008) - out * t
        return [
            ((hx, self.depth, 0.004), np.array([0, 0, 0.004]), flat),
            ((hx, self.back / 2 + 0.008, t), rest, turn),
            ((hx, ledge / 2 + t, t), seat - np.array([0, ledge / 2 - t, t]), flat),
            ((hx, t, 0.005), seat - np.array([0, ledge + t, -0.002]), flat),
        ]

    def directions(self) -> tuple[np.ndarray, np.ndarray]:
        """Unit vectors up the back rest and out of it."""
        c, s = np.cos(self.lean), np.sin(self.lean)
        return np.array([0, c, s]), np.array([0, -s, c])

    def seat_at(self) -> np.ndarray:
        """Where the lower edge of a phone's back rests (3,)."""
        return np.array([0, -0.3 * self.depth, 0.024])

    def shape(self) -> Shape:
        skin, boxes = made_of(self.material, self.colour, self.seed), self.boxes()
        return Shape(
            tuple((at(box(*half, 0.0012), place, turn), skin) for half, place, turn in boxes),
            tuple(c for half, place, turn in boxes for c in box_collider(*half, place, turn)),
            mass=0.3,
        )

    def frames(self) -> NamedFrames:
        (up, out), seat = self.directions(), self.seat_at()
        centre = mark(*(seat + up * self.back / 2), normal=out)
        top = mark(*(seat + up * self.back))
        return standing(0, top=top, seat=mark(*seat, normal=out), centre=centre)


RACK_TONES = {"wood": tuple(WOODS), "metal": ("silver", "charcoal", "gold"), "painted": COLOURS}


@register("rack")
class Rack(Parametric):
    """A post on a foot with a peg that rises towards -y, the robot."""

    noun = "mug rack"

    material: str = one_of(tuple(RACK_TONES))
    height: float = between(0.22, 0.28, size=TALL)
    foot: float = between(0.065, 0.085)  # radius of the foot
    post: float = between(0.009, 0.013)  # radius of the post
    peg: float = between(0.075, 0.095)  # length of the peg
    peg_radius: float = between(0.0045, 0.006)
    rise: float = between(18, 32)  # degrees of the peg above horizontal
    colour: str = one_of(RACK_TONES, by="material")
    seed: int = texture()

    def peg_path(self) -> np.ndarray:
        """Root and tip (2,3) of the peg's axis."""
        t = np.radians(self.rise)
        root = np.array([0, -0.5 * self.post, 0.74 * self.height])
        return np.stack([root, root + self.peg * np.array([0, -np.cos(t), np.sin(t)])])

    def shape(self) -> Shape:
        skin, h, post = made_of(self.material, self.colour, self.seed), self.height, self.post
        r, (root, tip) = self.peg_radius, self.peg_path()
        pegs = [np.array([root, root + (tip - root) * [1, side, 1]]) for side in (1, -1)]
        parts = (
            cylinder(self.foot, 0.014, 32, 0.003),
            at(cylinder(post, h - post - 0.014, 14), (0, 0, 0.014)),
            at(sphere(1.25 * post, 6, 14), (0, 0, h - 1.25 * post)),
            *(sweep(peg, r, 10) for peg in pegs),
            *(at(sphere(1.35 * r, 5, 10), peg[1]) for peg in pegs),
        )
        pieces = disc(self.foot, 0.014) + cylinder_collider(post, 0.01, h)
        capsules = (c for peg in pegs for c in arc_of_capsules(peg, r))
        return Shape(tuple((part, skin) for part in parts), (*pieces, *capsules), mass=0.9)

    def frames(self) -> NamedFrames:
        root, tip = self.peg_path()
        out = tip - root
        middle = mark(*((root + tip) / 2), normal=out)
        return standing(self.height, peg=mark(*tip, normal=out), peg_middle=middle)
