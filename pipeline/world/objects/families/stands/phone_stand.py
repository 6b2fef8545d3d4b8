"""A phone stand facing -y: a foot plate, a back rest that leans away, a level ledge and a lip at
its end.

A phone that comes straight down is between lip and back rest only at the very end: a stand that
moves does not meet it before.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.poses import quat_about
from pipeline.world.looks.materials import metal, plastic, wood
from pipeline.world.objects.colliders import box_collider
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.geometry import at, box
from pipeline.world.objects.kit import COLOURS, mark
from pipeline.world.objects.parameters import WIDE, Parametric, between, one_of, texture
from pipeline.world.shapes import Shape

TONES = {
    "plastic": COLOURS,
    "metal": ("silver", "charcoal", "gold"),
    "wood": ("oak", "walnut", "beech", "pine"),
}


@register("phone_stand")
@dataclass(frozen=True)
class PhoneStand(Parametric):
    material: str = one_of(tuple(TONES))
    hx: float = between(0.034, 0.045, size=WIDE)  # half extent
    depth: float = between(0.045, 0.055)  # half extent of the foot along y
    back: float = between(0.075, 0.1)  # length of the back rest
    lean: float = between(np.radians(58), np.radians(68))  # rad of the back rest above horizontal
    # depth of the level ledge in front of the back rest, up to the lip
    ledge: float = between(0.022, 0.026)
    colour: str = one_of(TONES, by="material")
    seed: int = texture()

    def boxes(self) -> list[tuple[tuple[float, float, float], np.ndarray, np.ndarray]]:
        """Half extents, centre and quaternion of foot, back rest, ledge and lip."""
        up, out = self.directions()
        turn = quat_about((1, 0, 0), self.lean)
        seat = self.seat_at()
        t = 0.0028
        flat = quat_about((0, 0, 1), 0.0)
        return [
            ((self.hx, self.depth, 0.004), np.array([0, 0, 0.004]), flat),
            (
                (self.hx, self.back / 2 + 0.008, t),
                seat + up * (self.back / 2 - 0.008) - out * t,
                turn,
            ),
            ((self.hx, self.ledge / 2 + t, t), seat - np.array([0, self.ledge / 2 - t, t]), flat),
            ((self.hx, t, 0.005), seat - np.array([0, self.ledge + t, -0.002]), flat),
        ]

    def directions(self) -> tuple[np.ndarray, np.ndarray]:
        """Unit vectors up the back rest and out of it."""
        return np.array([0, np.cos(self.lean), np.sin(self.lean)]), np.array(
            [0, -np.sin(self.lean), np.cos(self.lean)]
        )

    def seat_at(self) -> np.ndarray:
        """Where the lower edge of a phone's back rests (3,)."""
        return np.array([0, -0.3 * self.depth, 0.024])

    def shape(self) -> Shape:
        skin = {
            "plastic": plastic(self.colour),
            "metal": metal(self.colour),
            "wood": wood(self.colour, self.seed),
        }[self.material]
        return Shape(
            visual=tuple(
                (at(box(*half, 0.0012), centre, turn), skin) for half, centre, turn in self.boxes()
            ),
            collision=tuple(
                c for half, centre, turn in self.boxes() for c in box_collider(*half, centre, turn)
            ),
            mass=0.3,
            friction=0.6,
        )

    def frames(self) -> NamedFrames:
        up, out = self.directions()
        top = self.seat_at() + up * self.back
        return NamedFrames(
            {
                "base": mark(0, 0, 0),
                "top": mark(0, float(top[1]), float(top[2])),
                "seat": mark(*self.seat_at(), normal=out),
                "centre": mark(*(self.seat_at() + up * self.back / 2), normal=out),
            }
        )
