"""What is pressed from above: an alarm clock and a service bell."""

import numpy as np

from pipeline.poses import quat_about
from pipeline.world.looks.materials import metal, painted, plastic, print_texture, printed
from pipeline.world.shapes import Material, Mesh, Shape

from ...colliders import (
    ALONG_Y,
    box_collider,
    convex_collider,
    cylinder_collider,
    disc,
    push_button,
    slab,
    twelve_sided,
)
from ...contract import NamedFrames, register
from ...geometry import at, box, cylinder, decal, revolve, sweep, upright
from ...grasping import box_pinches, side_pinches
from ...kit import COLOURS, DARKS, LARGE, Parametric, between, mark, one_of, standing, texture


@register("alarm_clock")
class AlarmClock(Parametric):
    """Faces -y, with a button on top."""

    colour: str = one_of(COLOURS)
    height: float = between(0.085, 0.115, size=LARGE)
    form: str = one_of(("twin-bell", "digital"))
    # of the face; half width of a digital clock is 1.35 of it
    radius: float = between(0.35, 0.4, of="height")
    half: float = between(0.022, 0.03)  # half depth
    hour: float = between(0, 12)
    trim: str = one_of(("silver", "gold", *COLOURS), other_than="colour", says="button")
    seed: int = texture()

    def shape(self) -> Shape:
        return self._twin_bell() if self.form == "twin-bell" else self._digital()

    @property
    def middle(self) -> float:
        return self.radius + 0.008

    def _hands(self) -> list[tuple[Mesh, Material]]:
        y, z, r, black = -self.half - 0.0012, self.middle, self.radius, plastic("black")

        def placed(mesh: Mesh, out: float, t: float) -> tuple[Mesh, Material]:
            where = (out * np.sin(t), y, z + out * np.cos(t))
            return at(mesh, where, quat_about((0, 1, 0), t)), black

        hands = ((self.hour / 12, 0.5 * r, 0.0028), (self.hour % 1, 0.75 * r, 0.002))
        tick = box(0.0012, 0.0003, 0.003)
        return [
            *(
                placed(box(width / 2, 0.0004, size / 2), 0.5 * size, 2 * np.pi * turn)
                for turn, size, width in hands
            ),
            *(placed(tick, 0.82 * r, np.pi * k / 6) for k in range(12)),
        ]

    def _twin_bell(self) -> Shape:
        r, w, z, h = self.radius, self.half, self.middle, self.height
        face, trim = quat_about((1, 0, 0), np.pi / 2), metal(self.trim)
        case = at(cylinder(r, 2 * w, 24, 0.003), (0, w, z), face)
        dial = at(cylinder(0.9 * r, 0.001, 20), (0, -w, z), face)
        rim = 0.42 * r
        cap = revolve([(0, 0), (rim, 0), (0.85 * rim, 0.4 * rim), (0, 0.72 * rim)], 16, 60)
        parts = [(case, painted(self.colour)), (dial, plastic("white")), *self._hands()]
        middle = np.array([0, 0, z])
        for side in (-1, 1):
            t = side * np.radians(32)
            out = np.array([np.sin(t), 0, np.cos(t)])
            parts.append((at(cap, middle + out * (r + 0.002), quat_about((0, 1, 0), t)), trim))
            foot = np.radians(180 - side * 35)
            ray = np.array([np.sin(foot), 0, np.cos(foot)])
            leg = [middle + ray * 0.9 * r, np.array([ray[0] * r * 1.02, 0, 0.0])]
            parts.append((_standing(sweep(leg, 0.004, 8)), trim))
        button = at(cylinder(0.009, h - z - r + 0.004, 14, 0.002), (0, 0, z + r - 0.004))
        parts.append((button, plastic(self.trim)))
        bells, rise = 0.62 * r + 0.18 * r, 0.5 * (h - 0.008 - z)
        return Shape(
            tuple(parts),
            cylinder_collider(r, z - w, z + w, (0, 0), ALONG_Y)
            + box_collider(0.62 * r, w, 0.35 * z, (0, 0, 0.35 * z))
            + box_collider(bells, 0.42 * r, rise, (0, 0, z + rise))
            + push_button(0.009, z, h),
            mass=0.28,
        )

    def _digital(self) -> Shape:
        hx, w, body = 1.35 * self.radius, self.half, self.height - 0.008
        case = at(box(hx, w, body / 2, 0.006), (0, 0, body / 2))
        time = f"{int(self.hour) or 12}:{int(60 * (self.hour % 1)):02d}"
        ink = "red" if self.colour != "red" else "cyan"
        panel = printed(print_texture("charcoal", ink, "panel", time, self.seed), 0.25)
        screen = decal(1.7 * hx, 0.72 * body, (0, -w - 0.0006, body / 2), upright(0))
        button = at(cylinder(0.013, 0.012, 18, 0.002), (0, 0, self.height - 0.012))
        return Shape(
            ((case, plastic(self.colour)), (screen, panel), (button, plastic(self.trim))),
            slab(hx, w, body) + push_button(0.013, body, self.height),
            mass=0.25,
        )

    def frames(self) -> NamedFrames:
        hx = self.radius if self.form == "twin-bell" else 1.35 * self.radius
        z = self.middle if self.form == "twin-bell" else (self.height - 0.008) / 2
        h = self.height
        return standing(
            h,
            box_pinches(hx, self.half, h / 2, heights=(0.7 * h,), offsets=(0.0,), axes="y"),
            button=mark(0, 0, h),
            face=mark(0, -self.half, z, (0, -1, 0)),
        )


def _standing(mesh: Mesh) -> Mesh:
    vertices = mesh.vertices.copy()
    vertices[:, 2] = np.maximum(vertices[:, 2], 0)
    return Mesh(vertices, mesh.triangles, mesh.normals, mesh.uvs)


COLLAR = 0.012  # m of upright wall at the foot of the dome, where it is held


@register("bell")
class Bell(Parametric):
    """A dome on a base, rung by the button on top."""

    radius: float = between(0.028, 0.034, size=LARGE)
    material: str = one_of(("metal", "painted"))
    colour: str = one_of({"metal": ("silver", "gold"), "painted": COLOURS}, by="material")
    dome: float = between(0.78, 0.98, of="radius")  # height of the dome
    foot: float = between(0.01, 0.015)  # height of the base
    knob: float = between(0.006, 0.009)  # radius of the button
    base_colour: str = one_of(DARKS, other_than="colour", says="base")

    @property
    def height(self) -> float:
        return self.foot + self.dome + 0.010

    def outline(self) -> list[tuple[float, float]]:
        """Silhouette of the dome, (radius, z) from the base up."""
        r, d, f, c = self.radius, self.dome, self.foot, COLLAR
        angle = np.radians([0, 20, 40, 60, 78])
        dome = [(float(r * np.cos(a)), float(f + c + (d - c) * np.sin(a))) for a in angle]
        return [(r, f), *dome, (0.0, f + d)]

    def shape(self) -> Shape:
        r, f = self.radius, self.foot
        skin = metal(self.colour) if self.material == "metal" else painted(self.colour)
        foot = cylinder(0.93 * r, f, 24, bevel=0.002)
        dome = revolve([(0, f), (0.98 * r, f), *self.outline()], 24)
        stem = at(cylinder(0.0035, 0.012, 8), (0, 0, f + self.dome - 0.004))
        lip = revolve([(0.98 * r, f + 0.0004), (1.03 * r, f + 0.0016), (0.98 * r, f + 0.0032)], 24)
        knob = at(cylinder(self.knob, 0.005, 16, bevel=0.0015), (0, 0, self.height - 0.005))
        rings = twelve_sided([point for point in self.outline() if point[0] > 0])
        return Shape(
            (
                *((foot, plastic(self.base_colour)), (dome, skin), (lip, skin)),
                *((stem, metal()), (knob, metal())),
            ),
            disc(0.93 * r, f)
            + convex_collider(rings)
            + push_button(self.knob, f + self.dome - 0.003, self.height),
            mass=0.25 * (r / 0.03) ** 2,
            friction=0.5,
        )

    def frames(self) -> NamedFrames:
        f, d, h = self.foot, self.dome, self.height
        outline = [(self.radius, 0.0), *self.outline()[:-1], (self.knob, f + d), (self.knob, h)]
        held = max(0.0215, f + 0.5 * COLLAR)
        grasps = side_pinches(self.radius, held, outline=outline, kind="dome")
        return standing(h, grasps, button=mark(0, 0, h))
