"""A display stand: a plate on a column on a foot."""

from dataclasses import dataclass

from pipeline.world.looks.materials import glaze, metal, painted, srgb, wood
from pipeline.world.objects.colliders import box_collider, cylinder_collider, disc
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.geometry import at, extrude, revolve, rounded_rectangle, stack
from pipeline.world.objects.kit import COLOURS, mark, standing
from pipeline.world.objects.parameters import LARGE, Parametric, between, one_of, texture
from pipeline.world.shapes import Material, Shape

TONES = {
    "wood": ("oak", "walnut", "pine", "birch"),
    "metal": ("silver", "gold", "charcoal"),
    "painted": COLOURS,
    "ceramic": COLOURS,
}


@register("display_stand")
@dataclass(frozen=True)
class DisplayStand(Parametric):
    radius: float = between(0.055, 0.075, size=LARGE)  # of the plate; half extent of a square one
    material: str = one_of(tuple(TONES))
    height: float = between(0.045, 0.085)
    foot: float = between(0.75, 0.95, of="radius")
    column: float = between(0.2, 0.45, of="radius")
    plate: float = between(0.007, 0.012)  # thickness
    form: str = one_of(("round", "square"))
    colour: str = one_of(TONES, by="material")
    seed: int = texture()

    def shape(self) -> Shape:
        r, h, f, c, t = self.radius, self.height, self.foot, self.column, self.plate
        skin = {
            "wood": wood(self.colour, self.seed),
            "metal": metal(self.colour),
            "ceramic": glaze(self.colour),
        }.get(self.material)
        skin = painted(self.colour) if skin is None else skin
        foot = [(f - 0.001, 0.0), (f, 0.002), (f - 0.002, 0.007)]
        bead = [(c + 0.003, 0.020), (c + 0.003, 0.023), (0.96 * c, 0.0245)]
        column = revolve(
            [
                *foot,
                (1.15 * c, 0.016),
                *bead,
                (0.8 * c, 0.5 * h),
                (0.9 * c, h - t - 0.006),
                (1.2 * c, h - t),
            ],
            20,
            35,
        )
        under = revolve([(0, 0), (f, 0)], 20)
        if self.form == "round":
            plate, top_felt = (
                revolve([(0, 0), (r - 0.003, 0), *_edge(r, t), (0, t)], 28, 35),
                revolve([(0.88 * r, 0.0006), (0, 0.0006)], 28),
            )
        else:
            square = rounded_rectangle(r, r, 0.1 * r, 3)
            plate = stack(
                square, [(z, x / r, x / r) for x, z in [(r - 0.003, 0), *_edge(r, t)]], 35
            )
            top_felt = extrude(square * 0.88, 0.0006)
        red, green, blue = srgb(self.colour)
        felt = Material((0.80 * red, 0.80 * green, 0.80 * blue), 0.95)
        top = (
            disc(r, t, h - t)
            if self.form == "round"
            else box_collider(r, r, t / 2, (0, 0, h - t / 2))
        )
        return Shape(
            visual=(
                (under, skin),
                (column, skin),
                (at(plate, (0, 0, h - t)), skin),
                (at(top_felt, (0, 0, h)), felt),
            ),
            collision=disc(f, 0.012) + cylinder_collider(c, 0.01, h - t) + top,
            mass=0.5,
            friction=0.7,
        )

    def frames(self) -> NamedFrames:
        return standing(self.height, centre=mark(0, 0, self.height))


def _edge(r: float, t: float) -> list[tuple[float, float]]:
    """Radius and height (m) along the edge of a plate of radius `r` and thickness `t`: a round nose
    below a step."""
    return [(r, 0.25 * t), (r - 0.0006, 0.58 * t), (r - 0.0025, 0.64 * t), (r - 0.003, t)]
