"""A fan, a microphone, and what lies in a hand: a phone, a remote control, a mouse."""

import numpy as np

from pipeline.poses import quat_about, quat_multiply, quat_rotate
from pipeline.world.looks.materials import (
    metal,
    painted,
    plastic,
    print_texture,
    printed,
    rubber,
    wrapped,
)
from pipeline.world.shapes import Shape, seen_along

from ...colliders import (
    ALONG_X,
    ALONG_Y,
    box_collider,
    convex_collider,
    cylinder_collider,
    disc,
    slab,
    sphere_collider,
)
from ...contract import Grasp, NamedFrames, register
from ...geometry import (
    at,
    box,
    cylinder,
    decal,
    extrude,
    revolve,
    rounded_rectangle,
    stack,
    stacked,
    sweep,
)
from ...grasping import TILTED, bar_pinches, box_pinches
from ...kit import COLOURS, LARGE, LONG, Parametric, between, drawn, mark, one_of, standing, texture
from ...surface import join


@register("fan")
class Fan(Parametric):
    colour: str = one_of(COLOURS)
    height: float = between(0.13, 0.165, size=LARGE)
    radius: float = between(0.042, 0.052)  # of the cage
    half: float = between(0.014, 0.018)  # half thickness of the cage
    foot: float = between(0.04, 0.05)
    blades: int = drawn(lambda rng, so_far: int(rng.integers(3, 6)))
    blade_colour: str = one_of(COLOURS, other_than="colour")

    def shape(self) -> Shape:
        r, w, z = self.radius, self.half, self.height - self.radius
        skin, blade_skin = plastic(self.colour), plastic(self.blade_colour)
        hoop = revolve([(r, -w), (r, w), (r - 0.004, w), (r - 0.004, -w), (r, -w)], 24)
        back = at(cylinder(r - 0.003, 0.002, 20), (0, 0, w - 0.003))
        angle = np.linspace(0, 2 * np.pi, 16, endpoint=False)
        circle = 0.55 * r * np.cos(angle), 0.55 * r * np.sin(angle)
        ring = np.column_stack([*circle, np.full(16, -w + 0.001)])
        spoke = at(box(r - 0.002, 0.0009, 0.0009), (0, 0, -w + 0.001))
        spokes = (spoke.moved(_turn(k * np.pi / 4)) for k in range(4))
        guard = join(*spokes, sweep(ring, 0.0012, 4, closed=True))
        blade = at(box(0.36 * r, 0.2 * r, 0.0012), (0.47 * r, 0, 0), quat_about((1, 0, 0), 0.45))
        turns = (_turn(2 * np.pi * k / self.blades) for k in range(self.blades))
        blades = join(*(blade.moved(turn) for turn in turns))
        hub = at(cylinder(0.18 * r, 1.6 * w, 10, 0.002), (0, 0, -0.9 * w))
        cage = (hoop, skin), (back, plastic("charcoal")), (guard, skin), (blades, blade_skin)
        face, stem = quat_about((1, 0, 0), -np.pi / 2), z - r + 0.004
        return Shape(
            (
                *((at(m, (0, 0, z), face), s) for m, s in (*cage, (hub, blade_skin))),
                (cylinder(self.foot, 0.014, 20, 0.003), skin),
                (at(cylinder(0.009, stem - 0.012, 12), (0, 0, 0.012)), skin),
            ),
            disc(self.foot, 0.014)
            + cylinder_collider(0.009, 0.012, stem)
            + cylinder_collider(r, z - w, z + w, (0, 0), ALONG_Y),
            mass=0.3,
        )

    def frames(self) -> NamedFrames:
        r, z = self.radius, self.height - self.radius
        half, heights = (0.6 * r, self.half, r), (2 * r - 0.02, 2 * r - 0.03)
        grasps = box_pinches(*half, (0, 0, z), heights=heights, pitches=(15, *TILTED), axes="y")
        return standing(self.height, grasps, front=mark(0, -self.half, z, (0, -1, 0), (1, 0, 0)))

    def facts(self) -> dict[str, str]:
        blades = ("three", "four", "five")[self.blades - 3]
        return super().facts() | {"blade": self.blade_colour, "blades": blades}


def _turn(angle: float) -> np.ndarray:
    return np.concatenate([np.zeros(3), quat_about((0, 0, 1), angle)])


@register("microphone")
class Microphone(Parametric):
    tail: float = between(0.0125, 0.0145)  # radius at the tail
    length: float = between(0.18, 0.23, size=LONG)
    # radius below the head
    neck: float = drawn(lambda rng, mic: mic.tail + rng.uniform(0.0015, 0.0035))
    head: float = between(0.0215, 0.026)  # radius of the head
    colour: str = one_of(COLOURS)
    head_colour: str = one_of(("silver", "charcoal", "gold", "gray"), says="head")
    ring: str = one_of(("silver", "red", "blue", "gold", "white"))

    @property
    def rise(self) -> float:
        """Angle (rad) of the axis above the table: it rests on its tail and its head."""
        return float(np.arcsin((self.head - self.tail) / (self.length - self.head)))

    def axis(self, share: float) -> np.ndarray:
        """Point (3,) of the axis, 0 at the tail end and 1 at the middle of the head."""
        a = self.rise
        start = np.array([-(self.length * np.cos(a)) / 2, 0, self.tail * np.cos(a)])
        return start + share * (self.length - self.head) * np.array([np.cos(a), 0, np.sin(a)])

    def shape(self) -> Shape:
        r0, r1, r2, long = self.tail, self.neck, self.head, self.length - self.head
        turn = quat_multiply(quat_about((0, 1, 0), -self.rise), ALONG_X)
        top = long - 0.42 * r2
        tube = [(0, 0), (0.9 * r0, 0), (r0, 0.002), (r1, 0.82 * long), (0.9 * r2, top), (0, top)]
        angle = np.radians(np.linspace(-28, 90, 8))
        arc = zip(r2 * np.cos(angle[:-1]), r2 * np.sin(angle[:-1]), strict=True)
        ball = revolve([(0, -0.47 * r2), *arc, (0, r2)], 20, 60)
        ring = [(0.95 * r2, -0.004), (1.0 * r2, -0.003), (1.0 * r2, 0.003), (0.95 * r2, 0.004)]
        head, trim = self.axis(1.0), plastic(self.ring)
        switch = self.axis(0.68) + quat_rotate(turn, (-1, 0, 0)) * 0.94 * r1
        circle = np.arange(12) * np.pi / 6
        tail, neck, flare = (
            [self.axis(s) + quat_rotate(turn, (r * np.cos(t), r * np.sin(t), 0)) for t in circle]
            for s, r in ((0.0, r0), (0.82, r1), (1 - 0.42 * r2 / long, 0.9 * r2))
        )
        # flats to rest on, so that it does not roll away
        flat, z = (0.004, 0.45 * r0, 0.2 * r0), 0.2 * r0
        return Shape(
            (
                (at(revolve(tube, 20), self.axis(0.0), turn), painted(self.colour)),
                (at(ball, head, turn), metal(self.head_colour)),
                (at(revolve(ring, 20), head, turn), trim),
                (at(box(0.002, 0.004, 0.011, 0.001), switch, turn), trim),
            ),
            convex_collider(tail + neck)
            + convex_collider(neck + flare)
            + sphere_collider(r2, head)
            + box_collider(*flat, (self.axis(0.04)[0], 0, z))
            + box_collider(*flat, (head[0], 0, z)),
            mass=0.25,
            friction=0.7,
        )

    def frames(self) -> NamedFrames:
        def grips(share: float, kind: str, lean: int) -> list[Grasp]:
            """Pinches whose hand leans over the tail (1) or the head (-1): room for two hands."""
            x, _, z = map(float, self.axis(share))
            radius = self.tail + (self.neck - self.tail) * share / 0.82
            pitches, rolls = (15, 30, 45, 60, 75, 90), (-30, -15, 0, 15, 30)
            pinches = bar_pinches([x], radius, z, pitches, kind=kind, rolls=rolls)
            return [g for g in pinches if lean * quat_rotate(g.pose[3:], (1, 0, 0))[0] > -1e-6]

        tail = [g for s in (0.08, 0.16) for g in grips(s, "tail", 1)]
        neck = [g for s in (0.58, 0.70) for g in grips(s, "neck", -1)]
        start, end = self.axis(0.0), self.axis(1.0)
        out = end - start
        tip = end + self.head * out / np.linalg.norm(out)
        return standing(
            0,
            (*tail, *neck),
            top=mark(float(end[0]), 0, float(end[2] + self.head)),
            head=mark(*tip, normal=out, heading=(0, 0, 1)),
            tail=mark(*start, normal=-out, heading=(0, 0, 1)),
            middle=mark(*self.axis(0.45)),
        )


SCREENS = ("navy", "sky blue", "lavender", "coral", "mint", "gold", "pink", "teal", "white")


@register("phone")
class Phone(Parametric):
    """Lies on its back, its top towards +y."""

    hx: float = between(0.03, 0.034)
    height: float = between(0.125, 0.152, size=LARGE)
    thickness: float = between(0.0145, 0.018)
    corner: float = between(0.004, 0.01)
    colour: str = one_of(COLOURS)
    screen: str = one_of(SCREENS)
    style: str = one_of(("dots", "stripes", "diamond", "panel"))
    seed: int = texture()

    def shape(self) -> Shape:
        hx, hy, t = self.hx, self.height / 2, self.thickness
        case = extrude(rounded_rectangle(hx, hy, self.corner, 3), t, bevel=0.002)
        black = decal(1.88 * hx, 1.92 * hy, (0, 0, t + 0.0002))
        glass = decal(1.78 * hx, 1.74 * hy, (0, 0, t + 0.0004))
        accent = "white" if self.screen != "white" else "navy"
        image = printed(print_texture(self.screen, accent, self.style, "12:45", self.seed), 0.2)
        return Shape(
            ((case, plastic(self.colour)), (black, plastic("black")), (glass, image)),
            slab(hx, hy, t),
            mass=0.19,
        )

    def frames(self) -> NamedFrames:
        hy, t = self.height / 2, self.thickness
        grasps = box_pinches(self.hx, hy, t / 2, offsets=(0.0, 0.3, 0.55), axes="x")
        return standing(t, grasps, screen=mark(0, 0, t), foot=mark(0, -hy, 0))


@register("remote")
class RemoteControl(Parametric):
    noun = "remote control"

    hx: float = between(0.019, 0.026)
    colour: str = one_of(COLOURS)
    length: float = between(0.13, 0.185, size=LONG)
    thickness: float = between(0.018, 0.025)
    corner: float = between(0.3, 0.95, of="hx")
    keypad: float = between(0.6, 0.85)  # share of the length covered by keys
    keys: str = one_of(("white", "black", "gray", "cyan", "yellow", "beige"), other_than="colour")
    seed: int = texture()

    def shape(self) -> Shape:
        hx, hy, t = self.hx, self.length / 2, self.thickness
        body = extrude(rounded_rectangle(hx, hy, self.corner, 5), t, bevel=0.004)
        pad = decal(1.5 * hx, 2 * self.keypad * hy, (0, (0.9 - self.keypad) * hy, t + 0.0004))
        keys = printed(print_texture(self.colour, self.keys, "keys", "", self.seed), 0.5)
        visual = (body, plastic(self.colour)), (pad, keys)
        return Shape(visual, slab(hx, hy, t), mass=0.12)

    def frames(self) -> NamedFrames:
        half = self.hx, self.length / 2, self.thickness / 2
        return standing(self.thickness, box_pinches(*half, offsets=(-0.3, 0.0, 0.3), axes="x"))


LEVELS = (
    (0.0, 0.94, 0.95),
    (0.08, 1.0, 1.0),
    (0.5, 0.99, 0.985),
    (0.72, 0.94, 0.92),
    (0.9, 0.78, 0.74),
    (1.0, 0.42, 0.42),
)


@register("mouse")
class Mouse(Parametric):
    """The buttons are towards +y."""

    colour: str = one_of(COLOURS)
    hx: float = between(0.027, 0.032)
    length: float = between(0.092, 0.115, size=LARGE)
    height: float = between(0.034, 0.041)
    pinch: float = between(0.0, 0.06)  # how much narrower the waist is, as a share
    wheel: str = one_of(("black", "gray", "white", "red", "cyan", "lime"), other_than="colour")

    def outline(self) -> np.ndarray:
        """An oval (20,2) with a waist."""
        angle = 2 * np.pi * np.arange(20) / 20
        c, s, pinch = np.cos(angle), np.sin(angle), self.pinch
        x = self.hx * np.sign(c) * np.abs(c) ** 0.62 * (1 - pinch * (1 - s**2))
        y = self.length / 2 * np.sign(s) * np.abs(s) ** 0.85
        return np.column_stack([x / (1 - pinch), y]) * [1 - pinch, 1]

    def shape(self) -> Shape:
        h, hy = self.height, self.length / 2
        levels = [(z * h, x, y) for z, x, y in LEVELS]
        body = stack(self.outline(), levels, 60)
        wheel = at(cylinder(0.009, 0.006, 14), (-0.003, 0.5 * hy, 0.8 * h), ALONG_X)
        body = seen_along(body, np.eye(2, 3), np.ptp(self.outline(), axis=0))
        skin = wrapped("shell", self.colour, int(1e6 * self.length), 0.42)
        return Shape(
            ((body, skin), (wheel, rubber(self.wheel))),
            convex_collider(stacked(self.outline(), levels).reshape(-1, 3)),
            mass=0.1,
        )

    def frames(self) -> NamedFrames:
        half = self.hx * (1 - self.pinch), self.length / 2, self.height / 2
        heights, offsets = (0.014, 0.019), (-0.12, 0.0, 0.12)
        grasps = box_pinches(*half, heights=heights, offsets=offsets, axes="x")
        return standing(self.height, grasps)
