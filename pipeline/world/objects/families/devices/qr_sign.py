"""A payment sign facing -y: a foot and an upright board with a printed code."""

from dataclasses import dataclass

from pipeline.world.looks.materials import plastic, print_texture, printed, wood
from pipeline.world.objects.colliders import box_collider
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.families.goods.boxes import upright
from pipeline.world.objects.geometry import at, box, decal
from pipeline.world.objects.grasping import box_pinches
from pipeline.world.objects.kit import COLOURS, mark, standing
from pipeline.world.objects.parameters import TALL, Parametric, between, one_of, texture
from pipeline.world.shapes import Shape


@register("qr_sign")
@dataclass(frozen=True)
class QrSign(Parametric):
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
        middle = f + hz
        skin = (
            wood(self.foot_colour, self.seed)
            if self.foot_material == "wood"
            else plastic(self.foot_colour)
        )
        side = 1.6 * min(hx, hz)
        code = printed(print_texture("white", "black", "qr", "", self.seed), 0.4)
        title = printed(print_texture(self.colour, "white", "label", "PAY", self.seed), 0.4)
        y = -self.board - 0.0006
        spare = 2 * hz - side
        return Shape(
            visual=(
                (at(box(hx, self.board, hz, 0.001), (0, 0, middle)), plastic(self.colour)),
                (at(box(hx + 0.004, self.foot, f / 2, 0.002), (0, 0, f / 2)), skin),
                (decal(side, side, (0, y, f + 0.35 * spare + side / 2), upright(0)), code),
                (
                    decal(1.5 * hx, 0.5 * spare, (0, y, 2 * hz + f - 0.32 * spare), upright(0)),
                    title,
                ),
            ),
            collision=box_collider(hx, self.board, hz, (0, 0, middle))
            + box_collider(hx + 0.004, self.foot, f / 2, (0, 0, f / 2)),
            mass=0.25,
            friction=0.6,
        )

    def frames(self) -> NamedFrames:
        hz, f = (self.height - self.foot_height) / 2, self.foot_height
        grasps = box_pinches(
            self.hx,
            self.board,
            hz,
            (0, 0, f + hz),
            heights=(2 * hz - 0.02, 2 * hz - 0.03),
            axes="y",
            offsets=(-0.5, -0.25, 0.0, 0.25, 0.5),
        )
        return standing(self.height, grasps, code=mark(0, -self.board, f + hz, (0, -1, 0)))

    def facts(self) -> dict[str, str]:
        return super().facts() | {
            "foot": self.foot_colour,
            "material": "wooden" if self.foot_material == "wood" else "plastic",
        }
