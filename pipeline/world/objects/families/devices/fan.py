"""A small desk fan, facing -y."""

from dataclasses import dataclass

import numpy as np

from pipeline.poses import quat_about
from pipeline.world.looks.materials import plastic
from pipeline.world.objects.colliders import ALONG_Y, cylinder_collider, disc
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.geometry import at, box, cylinder, revolve, sweep
from pipeline.world.objects.grasping import TILTED, box_pinches
from pipeline.world.objects.kit import COLOURS, mark, standing
from pipeline.world.objects.parameters import LARGE, Parametric, between, drawn, one_of
from pipeline.world.objects.surface import join
from pipeline.world.shapes import Shape


@register("fan")
@dataclass(frozen=True)
class Fan(Parametric):
    colour: str = one_of(COLOURS)
    height: float = between(0.13, 0.165, size=LARGE)
    radius: float = between(0.042, 0.052)  # of the cage
    half: float = between(0.014, 0.018)  # half thickness of the cage
    foot: float = between(0.04, 0.05)
    blades: int = drawn(lambda rng, so_far: int(rng.integers(3, 6)))
    blade_colour: str = one_of(COLOURS, other_than="colour")

    def shape(self) -> Shape:
        r, w, z = self.radius, self.half, self.height - self.radius
        skin, blade_skin = plastic(self.colour), plastic(self.blade_colour)
        hoop = revolve([(r, -w), (r, w), (r - 0.004, w), (r - 0.004, -w), (r, -w)], 24)
        back = at(cylinder(r - 0.003, 0.002, 20), (0, 0, w - 0.003))
        angle = np.linspace(0, 2 * np.pi, 16, endpoint=False)
        ring = np.column_stack(
            [0.55 * r * np.cos(angle), 0.55 * r * np.sin(angle), np.full(16, -w + 0.001)]
        )
        spokes = [
            at(
                box(r - 0.002, 0.0009, 0.0009),
                (0, 0, -w + 0.001),
                quat_about((0, 0, 1), k * np.pi / 4),
            )
            for k in range(4)
        ]
        guard = join(*spokes, sweep(ring, 0.0012, 4, closed=True))
        blade = at(box(0.36 * r, 0.2 * r, 0.0012), (0.47 * r, 0, 0), quat_about((1, 0, 0), 0.45))
        blades = join(
            *(blade.moved(_turn(2 * np.pi * k / self.blades)) for k in range(self.blades))
        )
        hub = at(cylinder(0.18 * r, 1.6 * w, 10, 0.002), (0, 0, -0.9 * w))
        face = quat_about((1, 0, 0), -np.pi / 2)
        stem_top = z - r + 0.004
        return Shape(
            visual=(
                *(
                    (at(m, (0, 0, z), face), s)
                    for m, s in (
                        (hoop, skin),
                        (back, plastic("charcoal")),
                        (guard, skin),
                        (blades, blade_skin),
                        (hub, blade_skin),
                    )
                ),
                (cylinder(self.foot, 0.014, 20, 0.003), skin),
                (at(cylinder(0.009, stem_top - 0.012, 12), (0, 0, 0.012)), skin),
            ),
            collision=disc(self.foot, 0.014)
            + cylinder_collider(0.009, 0.012, stem_top)
            + cylinder_collider(r, z - w, z + w, (0, 0), ALONG_Y),
            mass=0.3,
            friction=0.6,
        )

    def frames(self) -> NamedFrames:
        z = self.height - self.radius
        grasps = box_pinches(
            0.6 * self.radius,
            self.half,
            self.radius,
            (0, 0, z),
            heights=(2 * self.radius - 0.02, 2 * self.radius - 0.03),
            pitches=(15, *TILTED),
            offsets=(-0.4, 0.0, 0.4),
            axes="y",
        )
        return standing(self.height, grasps, front=mark(0, -self.half, z, (0, -1, 0), (1, 0, 0)))

    def facts(self) -> dict[str, str]:
        return super().facts() | {
            "blade": self.blade_colour,
            "blades": ("three", "four", "five")[self.blades - 3],
        }


def _turn(angle: float) -> np.ndarray:
    return np.concatenate([np.zeros(3), quat_about((0, 0, 1), angle)])
