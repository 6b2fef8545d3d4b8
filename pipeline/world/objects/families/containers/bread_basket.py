"""A shallow bread basket, hollow, without handle."""

from dataclasses import dataclass

import numpy as np

from pipeline.world.looks.materials import fabric, wrapped
from pipeline.world.objects.colliders import box_collider, walls_of_boxes
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.families.containers.basket import TONES, open_box, wound
from pipeline.world.objects.geometry import at, box, rounded_rectangle, sweep
from pipeline.world.objects.grasping import box_pinches
from pipeline.world.objects.kit import mark, standing
from pipeline.world.objects.parameters import LARGE, Parametric, between, one_of, texture
from pipeline.world.shapes import Shape, seen_along

WALL = 0.006


@register("bread_basket")
@dataclass(frozen=True)
class BreadBasket(Parametric):
    colour: str = one_of(TONES)
    hx: float = between(0.085, 0.115, size=LARGE)
    hy: float = between(0.062, 0.08)
    height: float = between(0.034, 0.05)
    corner: float = between(0.012, 0.035)
    cloth: str = one_of(TONES, other_than="colour")  # colour of the cloth inside
    seed: int = texture()

    def shape(self) -> Shape:
        body = open_box(self.hx, self.hy, self.height, WALL, self.corner)
        rim = np.column_stack(
            [
                rounded_rectangle(self.hx - 0.003, self.hy - 0.003, self.corner, 4),
                np.full(20, self.height - 0.002),
            ]
        )
        cloth = at(
            box(0.94 * (self.hx - WALL), 0.94 * (self.hy - WALL), 0.0008), (0, 0, WALL + 0.0008)
        )
        cloth = seen_along(cloth, np.eye(2, 3), 0.05)
        return Shape(
            visual=(
                (body, wrapped("wicker", self.colour, self.seed, 0.7)),
                (
                    wound(sweep(rim, 0.004, 6, closed=True), np.concatenate([rim, rim[:1]])),
                    wrapped("cord", self.colour, self.seed, 0.6, 64),
                ),
                (cloth, fabric(self.cloth, self.seed + 1)),
            ),
            collision=(
                *box_collider(self.hx, self.hy, WALL / 2, (0, 0, WALL / 2)),
                *walls_of_boxes(self.hx, self.hy, WALL, self.height),
            ),
            mass=0.22 * self.hx * self.hy / 0.007,
            friction=0.7,
        )

    def frames(self) -> NamedFrames:
        floor = mark(0, 0, WALL)
        rim = [
            g
            for sign in (1, -1)
            for g in box_pinches(
                0.5 * self.hx,
                WALL / 2,
                self.height / 2,
                (0, sign * (self.hy - WALL / 2), self.height / 2),
                axes="y",
                kind="rim",
            )
        ]
        return standing(self.height, rim, inside=floor, centre=floor)
