"""A handheld bar code scanner standing on its foot, its window towards -y."""

from dataclasses import dataclass

import numpy as np

from pipeline.poses import quat_about
from pipeline.world.looks.materials import glaze, plastic, print_texture, printed, rubber
from pipeline.world.objects.colliders import box_collider, cylinder_collider, disc
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.geometry import at, box, cylinder, decal, revolve, side_prism
from pipeline.world.objects.grasping import side_pinches
from pipeline.world.objects.kit import COLOURS, mark, standing
from pipeline.world.objects.parameters import LARGE, Parametric, between, one_of
from pipeline.world.shapes import Shape

LABEL = print_texture("white", "charcoal", "product", "SCAN")


@register("scanner")
@dataclass(frozen=True)
class Scanner(Parametric):
    colour: str = one_of(COLOURS)
    height: float = between(0.125, 0.155, size=LARGE)
    grip: float = between(0.014, 0.0175)  # radius of the handle
    foot: float = between(0.036, 0.043)
    head: float = between(0.066, 0.082)  # length of the head
    half: float = between(0.022, 0.028)  # half width of the head
    deep: float = between(0.03, 0.038)  # height of the head
    trim: str = one_of(COLOURS, other_than="colour")

    @property
    def window(self) -> tuple[float, float, float]:
        """Middle of the window."""
        return (0.0, -0.62 * self.head, self.height - self.deep / 2)

    def shape(self) -> Shape:
        g, h, d = self.grip, self.height, self.deep
        front, rear = -0.62 * self.head, 0.38 * self.head
        outline = np.array(
            [
                (front, 0),
                (rear - 0.006, 0),
                (rear, 0.3 * d),
                (rear - 0.012, d),
                (front, d),
                (front - 0.0, 0.8 * d),
            ]
        )
        head = at(
            side_prism(outline, self.half, 0.002), (0, 0, h - d), quat_about((0, 0, 1), np.pi / 2)
        )
        neck = h - d + 0.004
        handle = revolve(
            [(0, 0.008), (g, 0.008), (0.92 * g, 0.5 * neck), (g, neck), (0, neck)], 12, 60
        )
        ribs = [(0.985 * g + 0.0008 * (k % 2), neck * (0.17 + 0.075 * k)) for k in range(8)]
        side = side_prism(outline * 0.72 + [0.1 * rear, 0.14 * d], self.half + 0.0006, 0.0005)
        trigger = at(box(0.006, 0.005, 0.011, 0.002), (0, -g, neck - 0.022))
        x, y, z = self.window
        face = quat_about((1, 0, 0), np.pi / 2)
        return Shape(
            visual=(
                (head, plastic(self.colour)),
                (at(side, (0, 0, h - d), quat_about((0, 0, 1), np.pi / 2)), rubber("charcoal")),
                (
                    at(box(self.half + 0.001, 0.005, d / 2 + 0.001, 0.002), (0, front + 0.004, z)),
                    rubber("charcoal"),
                ),
                (handle, plastic(self.colour)),
                (revolve(ribs, 12, 30), rubber("charcoal")),
                (trigger, plastic(self.trim)),
                (cylinder(self.foot, 0.009, 24), rubber(self.trim)),
                (
                    revolve(
                        [(0.93 * self.foot, 0.009), (0.55 * self.foot, 0.012), (g, 0.0165)], 24, 60
                    ),
                    plastic(self.trim),
                ),
                (decal(1.7 * self.half, 0.7 * d, (x, y - 0.0014, z), face), glaze("black")),
                (decal(1.2 * self.half, 0.07 * d, (x, y - 0.0018, z), face), glaze("red")),
                (
                    decal(1.1 * self.half, 0.36 * self.head, (0, 0.30 * rear, h + 0.0003)),
                    printed(LABEL),
                ),
            ),
            collision=disc(self.foot, 0.012)
            + cylinder_collider(0.98 * g, 0.01, neck)
            + box_collider(self.half, self.head / 2, d / 2, (0, (front + rear) / 2, h - d / 2)),
            mass=0.22,
            friction=0.7,
        )

    def frames(self) -> NamedFrames:
        neck = self.height - self.deep
        foot, grip, head = self.foot, self.grip, 0.62 * self.head
        limit = [
            (foot, 0.0),
            (foot, 0.012),
            (grip, 0.0125),
            (grip, neck - 0.001),
            (head, neck),
            (head, self.height),
        ]
        grasps = side_pinches(
            0.98 * self.grip,
            (0.4 * neck, 0.55 * neck),
            pitches=(-15, 0, 15, 30, 45),
            outline=limit,
            kind="handle",
        )
        return standing(self.height, grasps, window=mark(*self.window, normal=(0, -1, 0)))

    def facts(self) -> dict[str, str]:
        return super().facts() | {"foot": self.trim}
