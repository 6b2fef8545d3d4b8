"""What stands on a shop's counter: a payment sign, scales, a scanner."""

from dataclasses import replace

import numpy as np

from pipeline.poses import quat_about
from pipeline.world.looks.materials import (
    glaze,
    made_of,
    metal,
    plastic,
    print_texture,
    printed,
    rubber,
)
from pipeline.world.shapes import Shape

from ...colliders import Colliders, box_collider, cylinder_collider, disc, slab
from ...contract import NamedFrames, register
from ...geometry import (
    at,
    box,
    cylinder,
    decal,
    extrude,
    revolve,
    rounded_rectangle,
    side_prism,
    upright,
)
from ...grasping import box_pinches, side_pinches
from ...kit import COLOURS, LARGE, TALL, Parametric, between, drawn, mark, one_of, standing, texture


@register("qr_sign")
class QrSign(Parametric):
    """A payment sign facing -y: a foot and an upright board with a printed code."""

    noun = "QR code sign"

    foot_material: str = one_of(("wood", "plastic"))
    colour: str = one_of(COLOURS)
    hx: float = between(0.042, 0.056)
    height: float = between(0.115, 0.155, size=TALL)
    board: float = between(0.004, 0.007)  # half thickness of the board
    foot: float = between(0.026, 0.034)  # half depth of the foot
    foot_height: float = between(0.012, 0.02)
    foot_colour: str = one_of(
        {"wood": ("oak", "walnut", "beech"), "plastic": COLOURS},
        other_than="colour",
        by="foot_material",
    )
    seed: int = texture()

    def shape(self) -> Shape:
        hx, hz, f = self.hx, (self.height - self.foot_height) / 2, self.foot_height
        middle, y, side = f + hz, -self.board - 0.0006, 1.6 * min(hx, hz)
        spare = 2 * hz - side
        code = printed(print_texture("white", "black", "qr", "", self.seed), 0.4)
        title = printed(print_texture(self.colour, "white", "label", "PAY", self.seed), 0.4)
        board = at(box(hx, self.board, hz, 0.001), (0, 0, middle))
        foot = at(box(hx + 0.004, self.foot, f / 2, 0.002), (0, 0, f / 2))
        label = (0, y, 2 * hz + f - 0.32 * spare)
        return Shape(
            (
                (board, plastic(self.colour)),
                (foot, made_of(self.foot_material, self.foot_colour, self.seed)),
                (decal(side, side, (0, y, f + 0.35 * spare + side / 2), upright(0)), code),
                (decal(1.5 * hx, 0.5 * spare, label, upright(0)), title),
            ),
            box_collider(hx, self.board, hz, (0, 0, middle)) + slab(hx + 0.004, self.foot, f),
            mass=0.25,
        )

    def frames(self) -> NamedFrames:
        hz, f = (self.height - self.foot_height) / 2, self.foot_height
        half, heights = (self.hx, self.board, hz), (2 * hz - 0.02, 2 * hz - 0.03)
        offsets = (-0.5, -0.25, 0.0, 0.25, 0.5)
        grasps = box_pinches(*half, (0, 0, f + hz), heights=heights, axes="y", offsets=offsets)
        return standing(self.height, grasps, code=mark(0, -self.board, f + hz, (0, -1, 0)))

    def facts(self) -> dict[str, str]:
        material = "wooden" if self.foot_material == "wood" else "plastic"
        return super().facts() | {"foot": self.foot_colour, "material": material}


@register("scale")
class KitchenScale(Parametric):
    """The display lies towards -y."""

    hx: float = between(0.07, 0.09, size=LARGE)
    hy: float = drawn(lambda rng, scale: scale.hx + rng.uniform(0.012, 0.026))
    body: float = between(0.018, 0.028)  # height of the body
    plate: float = between(0.82, 0.94)  # share of the width that the platter covers
    form: str = one_of(("round", "square"))
    colour: str = one_of(COLOURS)
    platter: str = one_of(("silver", "white", "charcoal", "gold"))
    digits: str = drawn(lambda rng, so_far: f"{int(rng.integers(0, 1000)):03d}g")
    seed: int = texture()

    def shape(self) -> Shape:
        r, y, z, t = self.plate * self.hx, self.hy - self.hx, self.body, 0.006
        case = extrude(rounded_rectangle(self.hx, self.hy, 0.018, 4), z, 0.003)
        platter, top = cylinder(r, t, 32, 0.0015), _shifted(disc(r, t, z), y)
        if self.form == "square":
            platter = extrude(rounded_rectangle(r, r, 0.012, 3), t, 0.0015)
            top = box_collider(r, r, t / 2, (0, y, z + t / 2))
        skin = glaze(self.platter) if self.platter == "white" else metal(self.platter)
        panel = printed(print_texture("charcoal", "lime", "panel", self.digits, self.seed), 0.25)
        display = decal(0.9 * self.hx, 1.5 * y + 0.008, (0, -self.hy + y + 0.004, z + 0.0004))
        visual = (case, plastic(self.colour)), (at(platter, (0, y, z)), skin), (display, panel)
        return Shape(visual, slab(self.hx, self.hy, z) + top, mass=0.5)

    def frames(self) -> NamedFrames:
        z = self.body + 0.006
        return standing(z, centre=mark(0, self.hy - self.hx, z))

    def facts(self) -> dict[str, str]:
        return super().facts() | {"platter": "" if self.platter == self.colour else self.platter}


def _shifted(pieces: Colliders, y: float) -> Colliders:
    return tuple(replace(c, pose=c.pose + np.array([0, y, 0, 0, 0, 0, 0])) for c in pieces)


LABEL = print_texture("white", "charcoal", "product", "SCAN")


@register("scanner")
class Scanner(Parametric):
    """Stands on its foot, its window towards -y."""

    colour: str = one_of(COLOURS)
    height: float = between(0.125, 0.155, size=LARGE)
    grip: float = between(0.014, 0.0175)  # radius of the handle
    foot: float = between(0.036, 0.043)
    head: float = between(0.066, 0.082)  # length of the head
    half: float = between(0.022, 0.028)  # half width of the head
    deep: float = between(0.03, 0.038)  # height of the head
    trim: str = one_of(COLOURS, other_than="colour", says="foot")

    @property
    def window(self) -> tuple[float, float, float]:
        return (0.0, -0.62 * self.head, self.height - self.deep / 2)

    def shape(self) -> Shape:
        g, h, d, half = self.grip, self.height, self.deep, self.half
        front, rear = -0.62 * self.head, 0.38 * self.head
        back = [(rear - 0.006, 0), (rear, 0.3 * d), (rear - 0.012, d)]
        outline = np.array([(front, 0), *back, (front, d), (front - 0.0, 0.8 * d)])
        turn, dark, trim = quat_about((0, 0, 1), np.pi / 2), rubber("charcoal"), plastic(self.trim)
        neck = h - d + 0.004
        body = [(0, 0.008), (g, 0.008), (0.92 * g, 0.5 * neck), (g, neck), (0, neck)]
        ribs = [(0.985 * g + 0.0008 * (k % 2), neck * (0.17 + 0.075 * k)) for k in range(8)]
        side = side_prism(outline * 0.72 + [0.1 * rear, 0.14 * d], half + 0.0006, 0.0005)
        x, y, z = self.window
        bezel = at(box(half + 0.001, 0.005, d / 2 + 0.001, 0.002), (0, front + 0.004, z))
        cone = [(0.93 * self.foot, 0.009), (0.55 * self.foot, 0.012), (g, 0.0165)]
        face = quat_about((1, 0, 0), np.pi / 2)
        label = decal(1.1 * half, 0.36 * self.head, (0, 0.30 * rear, h + 0.0003))
        return Shape(
            (
                (at(side_prism(outline, half, 0.002), (0, 0, h - d), turn), plastic(self.colour)),
                (at(side, (0, 0, h - d), turn), dark),
                (bezel, dark),
                (revolve(body, 12, 60), plastic(self.colour)),
                (revolve(ribs, 12, 30), dark),
                (at(box(0.006, 0.005, 0.011, 0.002), (0, -g, neck - 0.022)), trim),
                (cylinder(self.foot, 0.009, 24), rubber(self.trim)),
                (revolve(cone, 24, 60), trim),
                (decal(1.7 * half, 0.7 * d, (x, y - 0.0014, z), face), glaze("black")),
                (decal(1.2 * half, 0.07 * d, (x, y - 0.0018, z), face), glaze("red")),
                (label, printed(LABEL)),
            ),
            disc(self.foot, 0.012)
            + cylinder_collider(0.98 * g, 0.01, neck)
            + box_collider(half, self.head / 2, d / 2, (0, (front + rear) / 2, h - d / 2)),
            mass=0.22,
            friction=0.7,
        )

    def frames(self) -> NamedFrames:
        neck, foot, g, head = self.height - self.deep, self.foot, self.grip, 0.62 * self.head
        lower = [(foot, 0.0), (foot, 0.012), (g, 0.0125), (g, neck - 0.001)]
        limit, heights = [*lower, (head, neck), (head, self.height)], (0.4 * neck, 0.55 * neck)
        pitches = (-15, 0, 15, 30, 45)
        grasps = side_pinches(0.98 * g, heights, pitches=pitches, outline=limit, kind="handle")
        return standing(self.height, grasps, window=mark(*self.window, normal=(0, -1, 0)))
