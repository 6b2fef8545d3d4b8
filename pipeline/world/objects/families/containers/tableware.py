"""Hollow round things of a table: bowl, plate, cup, mug; a cup upside down, and a lid."""

from itertools import chain, pairwise

import numpy as np

from pipeline.poses import quat_rotate
from pipeline.world.looks.materials import glaze, made_of, metal, plastic
from pipeline.world.shapes import Shape

from ...colliders import arc_of_capsules, cylinder_collider, disc, ring_of_boxes, vessel
from ...contract import NamedFrames, register
from ...geometry import at, cylinder, revolve, sweep
from ...grasping import handle_pinches, rim_pinches, side_pinches
from ...kit import (
    COLOURS,
    LARGE,
    PASTELS,
    Parametric,
    between,
    hollow,
    lean,
    mark,
    one_of,
    standing,
)
from ...surface import join

WALL = 0.004


@register("bowl")
class Bowl(Parametric):
    radius: float = between(0.052, 0.072, size=LARGE)
    colour: str = one_of(COLOURS)
    height: float = between(0.68, 0.88, of="radius")
    foot: float = between(0.48, 0.6, of="radius")  # radius of the standing ring
    # how far the wall bulges beyond a straight cone, as a share of the radius
    belly: float = between(0.08, 0.17)
    inside: str = one_of(PASTELS, also="colour", says="inside")

    def outer(self) -> list[tuple[float, float]]:
        """Silhouette of the wall, (radius, z) upwards."""
        share = np.array([0, 0.3, 0.65, 1.0])
        bulge = self.belly * self.radius * np.sin(np.pi * share)
        r = self.foot + (self.radius - self.foot) * share + bulge
        z = 0.005 + (self.height - 0.005) * share
        return list(zip(r.tolist(), z.tolist(), strict=True))

    def shape(self) -> Shape:
        outer = self.outer()
        inner = [(r - WALL, z + 0.4 * WALL) for r, z in outer[-2:0:-1]]
        lip = [(self.radius - WALL, self.height)]
        floor = (outer[0][0] * 0.85, 0.005 + WALL)
        outside = revolve([(0, 0), (self.foot, 0), *outer, *lip], 32, crease=50)
        inside = revolve([*lip, *inner, floor, (0, 0.005 + WALL)], 32, crease=50)
        tiers = [disc(self.foot, 0.005 + WALL)]
        for (r0, z0), (r1, z1) in pairwise(outer):
            tiers.append(ring_of_boxes(r0, WALL, z1 - z0, 14, z=z0, top=r1))
        return Shape(
            ((outside, glaze(self.colour)), (inside, glaze(self.inside))),
            tuple(chain(*tiers)),
            mass=2300 * WALL * np.pi * (self.foot**2 + (self.foot + self.radius) * self.height),
            friction=0.5,
        )

    def frames(self) -> NamedFrames:
        (r0, z0), (r1, z1) = self.outer()[-2:]
        rim = rim_pinches(self.radius, WALL, self.height, flare=lean(r1 - r0, z1 - z0))
        return hollow(self.height, 0.005 + WALL, rim)


PLATE_WALL = 0.005


@register("plate")
class Plate(Parametric):
    radius: float = between(0.085, 0.12, size=LARGE)
    colour: str = one_of(PASTELS + COLOURS)
    height: float = between(0.016, 0.024)
    well: float = between(0.58, 0.72, of="radius")  # radius of the flat floor
    rim_colour: str = one_of(COLOURS, also="colour", says="rim")

    def shape(self) -> Shape:
        r, h, w = self.radius, self.height, self.well
        lower, middle, inner = h - PLATE_WALL, 0.6 * w + 0.4 * r, 0.985 * r
        knee = PLATE_WALL + 0.3 * (h - PLATE_WALL)
        under = [(0, 0), (w, 0), (middle, 0.35 * (h - PLATE_WALL)), (r, lower), (r, h), (inner, h)]
        floor = [(middle, knee + 0.12 * h), (w, PLATE_WALL), (0, PLATE_WALL)]
        body = revolve([*under, *floor], 36, crease=50)
        fall = (inner - 0.92 * r) / (inner - middle) * (h - knee - 0.12 * h)
        outer, edge = r + 0.0008, h + 0.0008
        ring = [(outer, lower), (outer, edge), (inner, edge), (0.92 * r, h - fall + 0.0008)]
        line = [(s * w, PLATE_WALL + d * h + 0.0012) for s, d in ((1.06, 0.04), (1.02, 0.01))]
        rim = glaze(self.rim_colour)
        return Shape(
            ((body, glaze(self.colour)), (revolve(ring, 36), rim), (revolve(line, 36), rim)),
            vessel(w, PLATE_WALL, h, 16, r),
            mass=2300 * np.pi * r**2 * PLATE_WALL * 1.05,
            friction=0.5,
        )

    def frames(self) -> NamedFrames:
        flare = min(lean(self.radius - self.well, self.height), 60.0)
        r, h = self.radius, self.height
        grasps = rim_pinches(r, PLATE_WALL, h, 0.010, pitches=(60, 75, 90), flare=flare)
        return standing(h, grasps, centre=mark(0, 0, PLATE_WALL))


CUP_WALL = 0.003
BANDS = (0.56, 0.575), (0.62, 0.76), (0.805, 0.82)  # shares of the height
CUP_SKINS = {"plastic": (plastic, 1000.0), "ceramic": (glaze, 2300.0), "metal": (metal, 4000.0)}


@register("cup")
class Cup(Parametric):
    radius: float = between(0.028, 0.034, size=LARGE)  # at the rim
    material: str = one_of(tuple(CUP_SKINS))
    colour: str = one_of(COLOURS)
    foot: float = between(0.74, 0.98, of="radius")  # at the base
    height: float = between(2.4, 3.2, of="radius")
    stripe: str = one_of(COLOURS, other_than="colour")  # colour of the band round it

    def shape(self) -> Shape:
        r, f, h, wall = self.radius, self.foot, self.height, CUP_WALL
        skin, density = CUP_SKINS[self.material]
        foot = [(0, 0.002), (f - 0.006, 0.002), (f - 0.004, 0), (f - 0.0015, 0), (f, 0.002)]
        lip = [(r - 0.0002, h - 0.004), (r + 0.0006, h - 0.003), (r + 0.0007, h - 0.0012)]
        rim = [(r - 0.0005, h), (r - 0.0022, h - 0.0003), (r - wall, h - 0.002)]
        inside = [(f - wall, wall + 0.005), (f - wall - 0.005, wall), (0, wall)]
        body = revolve([*foot, *lip, *rim, *inside], 26)
        bands = [revolve([(f + (r - f) * s + 0.0004, h * s) for s in band], 26) for band in BANDS]
        return Shape(
            ((body, skin(self.colour)), (join(*bands), plastic(self.stripe))),
            vessel(f, wall, h, 16, r),
            mass=density * CUP_WALL * np.pi * (f**2 + (f + r) * h),
            friction=0.5,
        )

    def frames(self) -> NamedFrames:
        r, f, h = self.radius, self.foot, self.height
        low, high = (
            side_pinches(f + (r - f) * s, s * h, outline=[(f, 0.0), (r, h)]) for s in (0.5, 0.72)
        )
        return hollow(h, CUP_WALL, low + high + rim_pinches(r, CUP_WALL, h, flare=lean(r - f, h)))


MUG_WALL = 0.004


@register("mug")
class Mug(Parametric):
    radius: float = between(0.029, 0.034, size=LARGE)
    colour: str = one_of(COLOURS)
    height: float = between(2.3, 2.9, of="radius")
    ear: float = between(0.03, 0.038)  # how far the handle stands out
    ear_radius: float = between(0.0042, 0.0056)  # half thickness of the handle
    inside: str = one_of(PASTELS, also="colour", says="inside")

    def ear_path(self) -> np.ndarray:
        """Axis of the handle (N,3), from its upper to its lower root."""
        angle, h = np.radians(np.linspace(78, -78, 9)), self.height
        x = self.radius - 0.012 + (self.ear + 0.012 - self.ear_radius) * np.cos(angle) ** 0.7
        return np.column_stack([x, np.zeros(9), 0.52 * h + 0.34 * h * np.sin(angle)])

    def shape(self) -> Shape:
        r, h, wall = self.radius, self.height, MUG_WALL
        inner = r - wall
        outside = revolve([(0, 0), (r - 0.003, 0), (r, 0.004), (r, h), (inner, h)], 28)
        floor = [(inner, wall + 0.003), (inner - 0.003, wall), (0, wall)]
        inside = revolve([(inner, h), *floor], 28)
        path, skin = self.ear_path(), glaze(self.colour)
        handle = sweep(path, self.ear_radius, 8)
        ear = arc_of_capsules(path[::2], self.ear_radius)
        return Shape(
            ((outside, skin), (inside, glaze(self.inside)), (handle, skin)),
            disc(r, wall) + ring_of_boxes(r, wall, h, 16) + ear,
            mass=2300 * MUG_WALL * np.pi * (r * r + 2 * r * h) * 0.9,
            friction=0.5,
        )

    def frames(self) -> NamedFrames:
        r, h = self.radius, self.height
        ear = (r + self.ear - self.ear_radius, 0, 0.52 * h)
        clear = [
            g
            for g in side_pinches(r, (0.5 * h, 0.72 * h), outline=[(r, 0.0), (r, h)])
            if abs(quat_rotate(g.pose[3:], (0, 1, 0))[0]) < 0.85 and g.pose[0] < 0.005
        ]
        free = [g for g in rim_pinches(r, MUG_WALL, h) if g.pose[0] < 0.8 * r]
        handle = handle_pinches(ear, (0, 0, 1), (1, 0, 0), 2 * self.ear_radius)
        hole = mark(r + 0.45 * (self.ear - 2 * self.ear_radius), 0, 0.52 * h, (0, 1, 0))
        return hollow(h, MUG_WALL, (*clear, *free, *handle), handle_hole=hole)


SHELL_WALL = 0.003


@register("shell_cup")
class ShellCup(Parametric):
    """An opaque cup upside down: it stands on its rim and hides what is under it."""

    noun = "cup"

    radius: float = between(0.029, 0.034, size=LARGE)  # of the rim, on the table
    material: str = one_of(("plastic", "ceramic"))
    colour: str = one_of(COLOURS)
    foot: float = between(0.74, 0.9, of="radius")  # at the top
    height: float = between(2.2, 2.8, of="radius")
    stripe: str = one_of(COLOURS, other_than="colour")

    def shape(self) -> Shape:
        r, f, h, wall = self.radius, self.foot, self.height, SHELL_WALL
        outside = [(r, 0), (f, h - 0.003), (f - 0.003, h), (0, h)]
        inside = [(0, h - wall), (f - wall, h - wall), (r - wall, 0), (r, 0)]
        skin = made_of(self.material, self.colour)
        band = [(r + (f - r) * s + 0.0004, h * s) for s in (0.2, 0.34)]
        return Shape(
            (
                (revolve([*inside, *outside[1:]], 28, crease=50), skin),
                (revolve(band, 28), plastic(self.stripe)),
            ),
            disc(f, wall, h - wall) + ring_of_boxes(r, wall, h - wall, 16, top=f),
            mass=1200 * wall * np.pi * (f**2 + (f + r) * h),
            friction=0.5,
        )

    def frames(self) -> NamedFrames:
        r, f, h = self.radius, self.foot, self.height
        outline = [(r, 0.0), (f, h)]
        low, high = (side_pinches(r + (f - r) * s, s * h, outline=outline) for s in (0.45, 0.7))
        return standing(h, low + high)


@register("lid")
class Lid(Parametric):
    radius: float = between(0.038, 0.044, size=LARGE)
    material: str = one_of(("plastic", "ceramic"))
    colour: str = one_of(COLOURS)
    thickness: float = between(0.004, 0.006)
    knob: float = between(0.009, 0.012)  # radius of the knob
    tall: float = between(0.032, 0.038)  # height of the knob
    knob_colour: str = one_of(COLOURS, other_than="colour", says="knob")

    def shape(self) -> Shape:
        r, t, k = self.radius, self.thickness, self.knob
        stem = at(cylinder(k, self.tall, 20, 0.002), (0, 0, t))
        skin = made_of(self.material, self.colour)
        return Shape(
            ((cylinder(r, t, 32, 0.001), skin), (stem, plastic(self.knob_colour))),
            disc(r, t) + cylinder_collider(k, t, t + self.tall),
            mass=900 * np.pi * (r * r * t + k * k * self.tall),
            friction=0.7,
        )

    def frames(self) -> NamedFrames:
        r, t, k = self.radius, self.thickness, self.knob
        outline = [(r, 0.0), (r, t), (k, t + 0.001), (k, t + self.tall)]
        heights = (t + self.tall - 0.012, t + self.tall - 0.008)
        grasps = side_pinches(k, heights, pitches=(30, 45, 60, 75, 90), outline=outline)
        return standing(t + self.tall, grasps)
