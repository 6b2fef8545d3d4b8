"""A remote control lying on its back, its top towards +y."""

from dataclasses import dataclass

from pipeline.world.looks.materials import plastic, print_texture, printed
from pipeline.world.objects.colliders import box_collider
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.geometry import decal, extrude, rounded_rectangle
from pipeline.world.objects.grasping import box_pinches
from pipeline.world.objects.kit import COLOURS, standing
from pipeline.world.objects.parameters import LONG, Parametric, between, one_of, texture
from pipeline.world.shapes import Shape


@register("remote")
@dataclass(frozen=True)
class Remote(Parametric):
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
        return Shape(
            visual=(
                (body, plastic(self.colour)),
                (pad, printed(print_texture(self.colour, self.keys, "keys", "", self.seed), 0.5)),
            ),
            collision=box_collider(hx, hy, t / 2, (0, 0, t / 2)),
            mass=0.12,
            friction=0.6,
        )

    def frames(self) -> NamedFrames:
        return standing(
            self.thickness,
            box_pinches(
                self.hx, self.length / 2, self.thickness / 2, offsets=(-0.3, 0.0, 0.3), axes="x"
            ),
        )
