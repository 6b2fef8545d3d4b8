"""A toy car, its nose towards +x, and a wagon; a ball, and one whose stripe shows how it rolls."""

from dataclasses import replace
from itertools import product

import numpy as np

from pipeline.poses import quat_about
from pipeline.world.looks.materials import glaze, made_of, metal, painted, plastic, rubber
from pipeline.world.shapes import Shape

from ...colliders import ALONG_Y, prism_collider, slab, sphere_collider, tray
from ...contract import NamedFrames, register
from ...geometry import at, box, cylinder, revolve, side_prism, sphere
from ...grasping import box_pinches, side_pinches
from ...kit import (
    COLOURS,
    LARGE,
    LONG,
    Parametric,
    between,
    drawn,
    hollow,
    mark,
    one_of,
    other,
    pick,
    standing,
)
from ..containers.bins import open_box


@register("ball")
class Ball(Parametric):
    radius: float = between(0.007, 0.010, size=LARGE)
    density: float = between(900, 1500)
    material: str = one_of(("plastic", "rubber"))
    colour: str = one_of(COLOURS)

    def shape(self) -> Shape:
        r = self.radius
        ball = at(sphere(r, 8, 14), (0, 0, r)), made_of(self.material, self.colour)
        mass = self.density * 4 / 3 * np.pi * r**3
        return Shape((ball,), sphere_collider(r, (0, 0, r)), mass)

    def frames(self) -> NamedFrames:
        return standing(2 * self.radius, middle=mark(0, 0, self.radius))


@register("play_ball")
class PlayBall(Ball):
    noun = "ball"

    radius: float = between(0.022, 0.028, size=LARGE)
    density: float = between(300, 600)

    def shape(self) -> Shape:
        r, plain = self.radius, super().shape()
        turn = np.radians(np.arange(-15, 16, 5))
        arc = np.column_stack([1.004 * r * np.cos(turn), r + 1.004 * r * np.sin(turn)])
        stripe = at(revolve(arc, 24, 60.0), (0, -r, r), ALONG_Y), plastic("white")
        return replace(plain, visual=(*plain.visual, stripe))

    def frames(self) -> NamedFrames:
        r, angle = self.radius, np.radians(np.arange(-80, 81, 20))
        outline = np.column_stack([r * np.cos(angle), r + r * np.sin(angle)])
        return NamedFrames(super().frames().points, side_pinches(r, r, outline=outline))


LYING = quat_about((1, 0, 0), np.pi / 2)  # of what turns about y
FORMS = {  # outline of the cabin as shares of the length (from the rear) and of the cabin's height
    "sedan": [(0.12, 0.0), (0.78, 0.0), (0.62, 1.0), (0.28, 1.0)],
    "van": [(0.02, 0.0), (0.86, 0.0), (0.72, 1.0), (0.03, 1.0)],
    "pickup": [(0.42, 0.0), (0.82, 0.0), (0.7, 1.0), (0.44, 1.0)],
    "sports car": [(0.06, 0.0), (0.72, 0.0), (0.5, 1.0), (0.36, 1.0)],
}


@register("toy_car")
class ToyCar(Parametric):
    colour: str = one_of(COLOURS)
    length: float = between(0.095, 0.125, size=LONG)
    half: float = between(0.023, 0.029)
    height: float = between(0.042, 0.054)
    wheel: float = between(0.0105, 0.013)  # radius
    form: str = one_of(tuple(FORMS))
    roof: str = drawn(
        lambda rng, car: pick(rng, (car.colour, other(rng, COLOURS, car.colour))),
        says="roof",
        also="colour",
    )

    def x(self, share: float) -> float:
        """The x (m) at a share of the length from the rear."""
        return (share - 0.5) * self.length

    def shape(self) -> Shape:
        w, h, r = self.half, self.height, self.wheel
        belt, low, x = 0.58 * h, 0.55 * r, self.x
        sill = [(0.02, low), (0.98, low), (1.0, 0.6 * belt), (0.93, 0.9 * belt), (0.7, belt)]
        lower = np.array([(x(share), z) for share, z in [*sill, (0.0, belt)]])
        cabin = np.array([(x(a), belt + b * (h - belt)) for a, b in FORMS[self.form]])
        glass = cabin.mean(0) + (cabin - cabin.mean(0)) * [0.86, 0.62]
        corners = [(share, side) for share in (0.2, 0.8) for side in (-1, 1)]
        wheel = cylinder(r, 0.009, 14)
        turn = {s: quat_about((1, 0, 0), -s * np.pi / 2) for s in (-1, 1)}
        wheels = [at(wheel, (x(a), s * (w - 0.0085) + 0.0045, r), LYING) for a, s in corners]
        tyre, hub = (revolve([(radius, 0), (0, 0)], 16) for radius in (1.06 * r, 0.55 * r))
        tyres = [at(tyre, (x(a), s * (w - 0.0004), r), turn[s]) for a, s in corners]
        hubs = [at(hub, (x(a), s * (w + 0.0002), r), turn[s]) for a, s in corners]
        bumper = box(0.003, 0.9 * w, 0.08 * h, 0.001)
        bumpers = [at(bumper, (x(share), 0, 0.24 * h)) for share in (0.01, 0.985)]
        lamp, tail = box(0.0012, 0.16 * w, 0.1 * h), box(0.0008, 0.16 * w, 0.07 * h)
        lamps = [at(lamp, (x(0.985), side * 0.62 * w, 0.42 * h)) for side in (-1, 1)]
        tails = [at(tail, (x(0.012), side * 0.7 * w, 0.45 * h)) for side in (-1, 1)]
        (_, foot), (_, top) = (FORMS[self.form][k][::-1] for k in (1, 2))
        low, high = np.array([x(foot), belt]), np.array([x(top), h])
        middle, along = (low + high) / 2, high - low
        tilt = quat_about((0, 1, 0), -float(np.arctan2(along[1], along[0])))
        pane = box(0.4 * float(np.hypot(*along)), 0.7 * w, 0.0008)
        shield = at(pane, (float(middle[0]), 0, float(middle[1])), tilt)
        details = (
            *((tyres, rubber("black")), (bumpers, metal()), (wheels, rubber("black"))),
            *((hubs, metal()), (lamps, plastic("cream")), (tails, plastic("red"))),
        )
        return Shape(
            (
                (side_prism(lower, w - 0.001, 0.003), glaze(self.colour)),
                (side_prism(cabin, 0.86 * w, 0.002), glaze(self.roof)),
                (side_prism(glass, 0.87 * w), glaze("black")),
                (shield, glaze("black")),
                *((mesh, skin) for meshes, skin in details for mesh in meshes),
            ),
            slab(self.length / 2, w - 0.001, belt) + prism_collider(cabin, 0.86 * w),
            mass=0.11,
        )

    def frames(self) -> NamedFrames:
        belt = 0.58 * self.height
        cabin = float(np.mean([self.x(a) for a, _ in FORMS[self.form]]))
        # the palm is kept off the cabin by the box's full height, the pinch is on the lower body
        half, heights = (self.length / 2, self.half - 0.001, self.height / 2), (0.6, 0.85)
        heights = [share * belt for share in heights]
        grasps = box_pinches(*half, heights=heights, offsets=(-0.25, 0.0, 0.25), axes="y")
        nose = mark(self.length / 2, 0, 0.5 * belt, (1, 0, 0), (0, 0, 1))
        return standing(0, grasps, top=mark(cabin, 0, self.height), nose=nose)


WALL, FLOOR, LOW = 0.004, 0.012, 0.006  # m: sides, height of the floor, of the underside


@register("wagon")
class Wagon(Parametric):
    colour: str = one_of(COLOURS)
    hx: float = between(0.048, 0.054, size=LONG)
    hy: float = between(0.040, 0.044)
    height: float = between(0.024, 0.028)

    def shape(self) -> Shape:
        box = at(open_box(self.hx, self.hy, self.height - LOW, FLOOR - LOW, 0.006), (0, 0, LOW))
        places = product((-0.6, 0.6), (-self.hy, self.hy + 0.005))
        wheel = cylinder(0.011, 0.005, 16)
        wheels = [at(wheel, (x * self.hx, y, 0.011), LYING) for x, y in places]
        return Shape(
            ((box, painted(self.colour)), *((wheel, rubber("black")) for wheel in wheels)),
            (*slab(self.hx, self.hy, FLOOR), *tray(self.hx, self.hy, WALL, self.height)[1:]),
            mass=0.2,
            friction=0.7,
        )

    def frames(self) -> NamedFrames:
        return hollow(self.height, FLOOR)
