"""A rolling pin lying along x: a thick body and a thinner handle at each end."""

from dataclasses import dataclass

import numpy as np

from pipeline.world.looks.materials import WOODS, plastic, wood
from pipeline.world.objects.colliders import ALONG_X, box_collider, cylinder_collider
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.geometry import at, revolve
from pipeline.world.objects.grasping import bar_pinches
from pipeline.world.objects.kit import COLOURS, mark, standing
from pipeline.world.objects.parameters import LONG, Parametric, between, drawn, one_of, texture
from pipeline.world.shapes import Shape


@register("roller")
@dataclass(frozen=True)
class Roller(Parametric):
    noun = "rolling pin"

    length: float = between(0.30, 0.38, size=LONG)
    radius: float = between(0.021, 0.029)
    # length of the thick part
    body: float = drawn(lambda rng, pin: pin.length - 2 * rng.uniform(0.062, 0.078))
    handle: float = between(0.48, 0.6, of="radius")  # radius of the handles
    wood: str = one_of(tuple(WOODS))
    handle_colour: str = one_of(("", *COLOURS))  # "" for handles of the same wood
    seed: int = texture()

    def shape(self) -> Shape:
        r, h, half, end = self.radius, self.handle, self.body / 2, self.length / 2
        body = revolve(
            [
                (0, -half),
                (0.9 * r, -half),
                (r, -half + 0.003),
                (r, half - 0.003),
                (0.9 * r, half),
                (0, half),
            ],
            24,
        )
        span = end - half
        tip = [(h, 0.6 * span), (0.8 * h, span - 0.006), (0.5 * h, span), (0, span)]
        grip = revolve([(0, 0), (0.75 * h, 0), (h, 0.018), *tip], 16, crease=60)
        skin = wood(self.wood, self.seed)
        other = (
            plastic(self.handle_colour) if self.handle_colour else wood(self.wood, self.seed + 1)
        )
        mirrored = np.array([0.7071067811865476, 0, -0.7071067811865476, 0])
        middle = (end + half) / 2
        return Shape(
            visual=(
                (at(body, (0, 0, r), ALONG_X), skin),
                (at(grip, (half, 0, r), ALONG_X), other),
                (at(grip, (-half, 0, r), mirrored), other),
            ),
            collision=(
                *cylinder_collider(r, r - half, r + half, (0, 0), ALONG_X),
                # a flat to rest on, so that it does not roll away
                *box_collider(half, 0.35 * r, 0.5 * r, (0, 0, 0.5 * r)),
                *cylinder_collider(h, r - span / 2, r + span / 2, (middle, 0), ALONG_X),
                *cylinder_collider(h, r - span / 2, r + span / 2, (-middle, 0), ALONG_X),
            ),
            mass=650 * np.pi * (r**2 * self.body + h**2 * (self.length - self.body)),
            friction=0.6,
        )

    def frames(self) -> NamedFrames:
        half, end = self.body / 2, self.length / 2
        places = [half + 0.55 * (end - half), half + 0.7 * (end - half)]
        grips = {
            kind: bar_pinches(
                [sign * x for x in places], self.handle, self.radius, rolls=(-20, 0, 20), kind=kind
            )
            for kind, sign in (("left_end", -1), ("right_end", 1))
        }
        return standing(
            2 * self.radius,
            (*grips["left_end"], *grips["right_end"]),
            left_end=mark(-end, 0, self.radius, (-1, 0, 0), (0, 0, 1)),
            right_end=mark(end, 0, self.radius, (1, 0, 0), (0, 0, 1)),
        )

    def facts(self) -> dict[str, str]:
        return super().facts() | {"colour": self.wood, "handles": self.handle_colour or self.wood}
