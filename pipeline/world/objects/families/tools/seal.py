"""A stamp standing on its face: a block with a turned handle."""

from dataclasses import dataclass

import numpy as np

from pipeline.poses import quat_about
from pipeline.world.looks.materials import metal, plastic, print_texture, printed, rubber, wood
from pipeline.world.objects.colliders import box_collider, cylinder_collider, disc
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.geometry import at, band, box, cylinder, decal, revolve
from pipeline.world.objects.grasping import side_pinches
from pipeline.world.objects.kit import COLOURS, mark
from pipeline.world.objects.parameters import LARGE, Parametric, between, one_of, texture
from pipeline.world.objects.surface import join
from pipeline.world.shapes import Shape


@register("seal")
@dataclass(frozen=True)
class Seal(Parametric):
    noun = "stamp"

    material: str = one_of(("wood", "plastic"))
    half: float = between(0.022, 0.03)  # of the block
    block: float = between(0.016, 0.024)  # height of the block
    height: float = between(0.085, 0.11, size=LARGE)
    grip: float = between(0.012, 0.017)  # radius of the handle
    form: str = one_of(("round", "square"))
    colour: str = one_of(
        {"wood": ("oak", "walnut", "beech", "mahogany", "pine"), "plastic": COLOURS}, by="material"
    )
    ink: str = one_of(("red", "blue", "black", "green", "purple"))
    seed: int = texture()

    def shape(self) -> Shape:
        a, b, h, g = self.half, self.block, self.height, self.grip
        skin = wood(self.colour, self.seed) if self.material == "wood" else plastic(self.colour)
        foot = 0.006
        if self.form == "round":
            pad, block = cylinder(a, foot, 24), at(cylinder(a, b - foot, 24, 0.002), (0, 0, foot))
        else:
            pad = at(box(a, a, foot / 2), (0, 0, foot / 2))
            block = at(box(a, a, (b - foot) / 2, 0.002), (0, 0, (b + foot) / 2))
        profile = [
            (0.7 * g, b - 0.001),
            (0.62 * g, b + 0.15 * (h - b)),
            (g, b + 0.42 * (h - b)),
            (g, h - 0.6 * g),
        ]
        handle = revolve([*profile, (0.75 * g, h - 0.18 * g), (0.4 * g, h), (0, h)], 20, 60)
        ring = revolve(
            [(0.80 * g, b), (0.86 * g, b + 0.002), (0.80 * g, b + 0.004), (0.62 * g, b + 0.0045)],
            20,
            60,
        )
        text = printed(print_texture("white", self.ink, "label", "PAID"), 0.6)
        if self.form == "round":
            label = band(a + 0.0003, foot + 0.15 * (b - foot), b - 0.18 * (b - foot), 24, 3)
        else:
            front = decal(
                1.5 * a,
                0.62 * (b - foot),
                (0, -a - 0.0003, (b + foot) / 2),
                quat_about((1, 0, 0), np.pi / 2),
            )
            label = join(
                *(at(front, quaternion=quat_about((0, 0, 1), k * np.pi / 2)) for k in range(4))
            )
        base = disc(a, b) if self.form == "round" else box_collider(a, a, b / 2, (0, 0, b / 2))
        return Shape(
            visual=(
                (pad, rubber(self.ink)),
                (block, skin),
                (handle, skin),
                (ring, metal("gold")),
                (label, text),
            ),
            collision=base
            + cylinder_collider(0.65 * g, b - 0.001, b + 0.3 * (h - b))
            + cylinder_collider(g, b + 0.38 * (h - b), h - 0.3 * g)
            + cylinder_collider(0.5 * g, h - 0.4 * g, h),
            mass=0.12,
            friction=0.6,
        )

    def frames(self) -> NamedFrames:
        a, b, h, g = self.half, self.block, self.height, self.grip
        outline = [
            (a, 0.0),
            (a, b),
            (0.65 * g, b + 0.0005),
            (g, b + 0.4 * (h - b)),
            (g, h - 0.5 * g),
            (0.5 * g, h),
        ]
        return NamedFrames(
            {"base": mark(0, 0, 0), "stamp": mark(0, 0, 0, (0, 0, -1)), "top": mark(0, 0, h)},
            side_pinches(g, (b + 0.55 * (h - b), h - 0.9 * g), outline=outline, kind="handle"),
        )

    def facts(self) -> dict[str, str]:
        return super().facts() | {"face": self.ink}
