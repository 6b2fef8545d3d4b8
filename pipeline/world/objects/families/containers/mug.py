"""A mug with an ear: hollow, the handle towards +x."""

from dataclasses import dataclass

import numpy as np

from pipeline.poses import quat_rotate
from pipeline.world.looks.materials import glaze
from pipeline.world.objects.colliders import arc_of_capsules, disc, ring_of_boxes
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.geometry import revolve, sweep
from pipeline.world.objects.grasping import handle_pinches, rim_pinches, side_pinches
from pipeline.world.objects.kit import COLOURS, PASTELS, mark, standing
from pipeline.world.objects.parameters import LARGE, Parametric, between, one_of
from pipeline.world.shapes import Shape

WALL = 0.004


@register("mug")
@dataclass(frozen=True)
class Mug(Parametric):
    radius: float = between(0.029, 0.034, size=LARGE)
    colour: str = one_of(COLOURS)
    height: float = between(2.3, 2.9, of="radius")
    ear: float = between(0.03, 0.038)  # how far the handle stands out
    ear_radius: float = between(0.0042, 0.0056)  # half thickness of the handle
    inside: str = one_of(PASTELS, also="colour")

    def ear_path(self) -> np.ndarray:
        """Axis of the handle (N,3), from its upper to its lower root."""
        angle = np.radians(np.linspace(78, -78, 9))
        start = self.radius - 0.012
        x = start + (self.ear + 0.012 - self.ear_radius) * np.cos(angle) ** 0.7
        return np.column_stack(
            [x, np.zeros(9), 0.52 * self.height + 0.34 * self.height * np.sin(angle)]
        )

    def shape(self) -> Shape:
        r, h = self.radius, self.height
        outside = revolve([(0, 0), (r - 0.003, 0), (r, 0.004), (r, h), (r - WALL, h)], 28)
        inside = revolve(
            [(r - WALL, h), (r - WALL, WALL + 0.003), (r - WALL - 0.003, WALL), (0, WALL)], 28
        )
        path = self.ear_path()
        return Shape(
            visual=(
                (outside, glaze(self.colour)),
                (inside, glaze(self.inside)),
                (sweep(path, self.ear_radius, 8), glaze(self.colour)),
            ),
            collision=disc(r, WALL)
            + ring_of_boxes(r, WALL, h, 16)
            + arc_of_capsules(path[::2], self.ear_radius),
            mass=2300 * WALL * np.pi * (r * r + 2 * r * h) * 0.9,
            friction=0.5,
        )

    def frames(self) -> NamedFrames:
        r, h = self.radius, self.height
        floor = mark(0, 0, WALL)
        ear_x = r + self.ear - self.ear_radius
        side = side_pinches(r, (0.5 * h, 0.72 * h), outline=[(r, 0.0), (r, h)])
        clear = [
            g
            for g in side
            if abs(quat_rotate(g.pose[3:], (0, 1, 0))[0]) < 0.85 and g.pose[0] < 0.005
        ]
        free = [g for g in rim_pinches(r, WALL, h) if g.pose[0] < 0.8 * r]
        return standing(
            h,
            (
                *clear,
                *free,
                *handle_pinches((ear_x, 0, 0.52 * h), (0, 0, 1), (1, 0, 0), 2 * self.ear_radius),
            ),
            inside=floor,
            centre=floor,
            handle_hole=mark(r + 0.45 * (self.ear - 2 * self.ear_radius), 0, 0.52 * h, (0, 1, 0)),
        )

    def facts(self) -> dict[str, str]:
        return super().facts() | {"inside": "" if self.inside == self.colour else self.inside}
