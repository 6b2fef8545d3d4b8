"""A phone lying on its back, screen up, its top towards +y."""

from dataclasses import dataclass

from pipeline.world.looks.materials import plastic, print_texture, printed
from pipeline.world.objects.colliders import box_collider
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.geometry import decal, extrude, rounded_rectangle
from pipeline.world.objects.grasping import box_pinches
from pipeline.world.objects.kit import COLOURS, mark, standing
from pipeline.world.objects.parameters import LARGE, Parametric, between, one_of, texture
from pipeline.world.shapes import Shape

SCREENS = ("navy", "sky blue", "lavender", "coral", "mint", "gold", "pink", "teal", "white")


@register("phone")
@dataclass(frozen=True)
class Phone(Parametric):
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
        image = print_texture(self.screen, accent, self.style, "12:45", self.seed)
        return Shape(
            visual=(
                (case, plastic(self.colour)),
                (black, plastic("black")),
                (glass, printed(image, 0.2)),
            ),
            collision=box_collider(hx, hy, t / 2, (0, 0, t / 2)),
            mass=0.19,
            friction=0.6,
        )

    def frames(self) -> NamedFrames:
        hy, t = self.height / 2, self.thickness
        return standing(
            t,
            box_pinches(self.hx, hy, t / 2, offsets=(0.0, 0.3, 0.55), axes="x"),
            screen=mark(0, 0, t),
            foot=mark(0, -hy, 0),
        )
