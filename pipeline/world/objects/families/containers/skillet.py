"""A frying pan; its handle points towards -y, the robot."""

from dataclasses import dataclass, replace

import numpy as np

from pipeline.poses import quat_about
from pipeline.world.looks.materials import metal, painted, plastic, wood, wrapped
from pipeline.world.objects.colliders import box_collider, disc, ring_of_boxes
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.geometry import at, box, revolve
from pipeline.world.objects.grasping import handle_pinches
from pipeline.world.objects.kit import COLOURS, mark
from pipeline.world.objects.parameters import LARGE, Parametric, between, one_of
from pipeline.world.shapes import Shape

WALL = 0.004
LEAN = 0.2  # rad the handle rises
HALF_DEEP = 0.013  # m, half the height of the handle: fingers hold a deep one level

GRIPS = (
    ("handle", 0.0, (-60, -45, -30, -15)),
    ("handle_aside", 0.0, (0, 15, 30)),
    ("handle_aside", 0.5, (-45, -30, -15, 0, 15)),
    ("handle_aside", -0.5, (-45, -30, -15, 0, 15)),
)
"""Kind of grasp, roll (rad) about the handle and leans (degrees) along it. Those aside fit where
the pan is near the robot."""


@register("skillet")
@dataclass(frozen=True)
class Skillet(Parametric):
    handle_material: str = one_of(("wood", "plastic"))
    radius: float = between(0.07, 0.09, size=LARGE)
    height: float = between(0.026, 0.036)
    handle: float = between(0.12, 0.15)  # length
    grip: float = between(0.009, 0.013)  # half width of the handle
    colour: str = one_of(
        (
            "black",
            "charcoal",
            "gray",
            "silver",
            "red",
            "blue",
            "dark green",
            "teal",
            "orange",
            "maroon",
        )
    )
    handle_colour: str = one_of(
        {"wood": ("oak", "walnut", "beech"), "plastic": COLOURS}, by="handle_material"
    )

    def along(self, share: float) -> np.ndarray:
        """A point (3,) of the handle's axis, 0 at the pan and 1 at its end."""
        return np.array(
            [0, -self.radius + 0.004, 0.8 * self.height]
        ) + share * self.handle * np.array([0, -np.cos(LEAN), np.sin(LEAN)])

    def shape(self) -> Shape:
        r, h = self.radius, self.height
        foot = 0.82 * r
        skin = (
            metal(self.colour)
            if self.colour in ("silver", "gray", "charcoal")
            else painted(self.colour)
        )
        outside = revolve([(0, 0), (foot, 0), (r, h), (r - WALL, h)], 32)
        inside = revolve([(r - WALL, h), (foot - WALL, WALL), (0, WALL)], 32)
        middle, turn = self.along(0.5), quat_about((1, 0, 0), -LEAN)
        grip = at(box(self.grip, 0.36 * self.handle, HALF_DEEP, 0.004), self.along(0.64), turn)
        neck = at(box(0.55 * self.grip, 0.2 * self.handle, 0.004), self.along(0.18), turn)
        cover = (
            wood(self.handle_colour)
            if self.handle_material == "wood"
            else plastic(self.handle_colour)
        )
        return Shape(
            visual=(
                (outside, skin),
                (inside, wrapped("turned", "charcoal", int(1e6 * r), 0.38, metallic=0.7)),
                (grip, cover),
                (neck, metal()),
            ),
            collision=(
                *disc(foot, WALL),
                *ring_of_boxes(foot, WALL, h, 16, top=r),
                *(
                    replace(c, weight=0.6)
                    for c in box_collider(self.grip, 0.5 * self.handle, HALF_DEEP, middle, turn)
                ),
            ),
            # a toy's weight: a real pan turns about the jaws' axis in a pinch of its handle
            mass=0.06 * (r / 0.08) ** 2,
            friction=0.9,
        )

    def frames(self) -> NamedFrames:
        floor, axis = mark(0, 0, WALL), self.along(1) - self.along(0)
        grips = [
            g
            for kind, roll, leans in GRIPS
            for share in (0.4, 0.5, 0.62)
            for g in handle_pinches(
                self.along(share),
                axis,
                (np.sin(roll), 0, np.cos(roll)),
                2 * self.grip / np.cos(roll),
                leans,
                kind,
            )
        ]
        return NamedFrames(
            {
                "base": mark(0, 0, 0),
                "top": mark(*np.add(self.along(1), (0, 0, HALF_DEEP))),
                "inside": floor,
                "centre": floor,
                "handle": mark(*self.along(0.68), heading=-axis),
            },
            tuple(grips),
        )

    def facts(self) -> dict[str, str]:
        return super().facts() | {"handle": self.handle_colour}
