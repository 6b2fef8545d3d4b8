"""A pot with two handles and a frying pan."""

from dataclasses import replace
from itertools import product

import numpy as np

from pipeline.poses import quat_about
from pipeline.world.looks.materials import made_of, metal, painted, plastic, wrapped
from pipeline.world.shapes import Shape

from ...colliders import arc_of_capsules, box_collider, vessel
from ...contract import NamedFrames, register
from ...geometry import at, box, revolve, sweep, tapered
from ...grasping import handle_pinches, rim_pinches
from ...kit import COLOURS, LARGE, Parametric, between, hollow, listed, mark, one_of

WALL = 0.004


@register("pot")
class Pot(Parametric):
    radius: float = between(0.075, 0.10, size=LARGE)
    material: str = one_of(("steel", "enamel"))
    height: float = between(0.85, 1.25, of="radius")
    loop: float = between(0.028, 0.036)  # how far the handles stand out
    colour: str = one_of({"steel": ("silver", "charcoal"), "enamel": COLOURS}, by="material")
    handle_colour: str = one_of(("black", "silver", "brown", "red"), says="handles")

    def loop_path(self, side: int) -> np.ndarray:
        """Axis (N,3) of the handle at +x (`side` 1) or -x (-1)."""
        angle = np.radians(np.linspace(-90, 90, 7))
        r = 0.97 * self.radius
        x = r + (self.loop - 0.005) * np.cos(angle) ** 0.6
        return np.column_stack([side * x, 0.036 * np.sin(angle), np.full(7, 0.8 * self.height)])

    def shape(self) -> Shape:
        r, h = self.radius, self.height
        skin = metal(self.colour) if self.material == "steel" else painted(self.colour)
        bolt = plastic(self.handle_colour) if self.handle_colour != "silver" else metal()
        rim = [(r, h - 0.003), (r + 0.0025, h - 0.002), (r + 0.0025, h), (r - WALL, h)]
        outside = revolve([(0, 0), (r - 0.006, 0), (r, 0.006), *rim], 28)
        inside = revolve([(r - WALL, h), (r - WALL, WALL), (0, WALL)], 28)
        ring = [(r + 0.0008, 0.0065), (r + 0.0008, 0.014)]
        base = revolve([(r - 0.004, 0.004), *ring, (r - 0.004, 0.0165)], 28)
        paths = [self.loop_path(side) for side in (1, -1)]
        capsules = [c for path in paths for c in arc_of_capsules(path[::2], 0.005)]
        return Shape(
            (
                (outside, skin),
                (inside, metal("silver", seed=7)),
                (base, metal("silver")),
                *((sweep(path, 0.005, 8), bolt) for path in paths),
            ),
            (*vessel(r, WALL, h, 18), *capsules),
            mass=3500 * 0.003 * np.pi * (r * r + 2 * r * h),
            friction=0.5,
        )

    def frames(self) -> NamedFrames:
        rim = rim_pinches(self.radius, WALL, self.height)
        return hollow(self.height, WALL, [g for g in rim if abs(g.pose[1]) > 0.6 * self.radius])


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
class Skillet(Parametric):
    """The handle points towards -y, the robot."""

    handle_material: str = one_of(("wood", "plastic"))
    radius: float = between(0.07, 0.09, size=LARGE)
    height: float = between(0.026, 0.036)
    handle: float = between(0.12, 0.15)  # length
    grip: float = between(0.009, 0.013)  # half width of the handle
    colour: str = one_of(
        listed("black, charcoal, gray, silver, red, blue, dark green, teal, orange, maroon")
    )
    handle_colour: str = one_of(
        {"wood": ("oak", "walnut", "beech"), "plastic": COLOURS},
        by="handle_material",
        says="handle",
    )

    def along(self, share: float) -> np.ndarray:
        """A point (3,) of the handle's axis, 0 at the pan and 1 at its end."""
        way = share * self.handle * np.array([0, -np.cos(LEAN), np.sin(LEAN)])
        return np.array([0, -self.radius + 0.004, 0.8 * self.height]) + way

    def shape(self) -> Shape:
        r, h, foot = self.radius, self.height, 0.82 * self.radius
        is_bare = self.colour in ("silver", "gray", "charcoal")
        outside, inside = tapered(foot, r, h, WALL, 32)
        turn = quat_about((1, 0, 0), -LEAN)
        grip = at(box(self.grip, 0.36 * self.handle, HALF_DEEP, 0.004), self.along(0.64), turn)
        neck = at(box(0.55 * self.grip, 0.2 * self.handle, 0.004), self.along(0.18), turn)
        bar = box_collider(self.grip, 0.5 * self.handle, HALF_DEEP, self.along(0.5), turn)
        return Shape(
            (
                (outside, metal(self.colour) if is_bare else painted(self.colour)),
                (inside, wrapped("turned", "charcoal", int(1e6 * r), 0.38, metallic=0.7)),
                (grip, made_of(self.handle_material, self.handle_colour)),
                (neck, metal()),
            ),
            (*vessel(foot, WALL, h, 16, r), *(replace(c, weight=0.6) for c in bar)),
            # a toy's weight: a real pan turns about the jaws' axis in a pinch of its handle
            mass=0.06 * (r / 0.08) ** 2,
            friction=0.9,
        )

    def frames(self) -> NamedFrames:
        axis, grips = self.along(1) - self.along(0), []
        for (kind, roll, leans), share in product(GRIPS, (0.4, 0.5, 0.62)):
            out, width = (np.sin(roll), 0, np.cos(roll)), 2 * self.grip / np.cos(roll)
            grips += handle_pinches(self.along(share), axis, out, width, leans, kind)
        top = mark(*np.add(self.along(1), (0, 0, HALF_DEEP)))
        handle = mark(*self.along(0.68), heading=-axis)
        return hollow(self.height, WALL, grips, top=top, handle=handle)
