"""A toy wagon with low sides, its length along x, open at the top."""

import numpy as np

from pipeline.poses import quat_about
from pipeline.world.looks.materials import painted, rubber
from pipeline.world.objects.colliders import slab, tray
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.families.containers.bins import open_box
from pipeline.world.objects.geometry import at, cylinder
from pipeline.world.objects.kit import COLOURS, LONG, Parametric, between, hollow, one_of
from pipeline.world.shapes import Shape

WALL, FLOOR, LOW = 0.004, 0.012, 0.006  # m: sides, height of the floor, of the underside


@register("wagon")
class Wagon(Parametric):
    colour: str = one_of(COLOURS)
    hx: float = between(0.048, 0.054, size=LONG)
    hy: float = between(0.040, 0.044)
    height: float = between(0.024, 0.028)

    def shape(self) -> Shape:
        box = at(open_box(self.hx, self.hy, self.height - LOW, FLOOR - LOW, 0.006), (0, 0, LOW))
        lying = quat_about((1, 0, 0), np.pi / 2)
        wheels = [
            at(cylinder(0.011, 0.005, 16), (x * self.hx, y, 0.011), lying)
            for x in (-0.6, 0.6)
            for y in (-self.hy, self.hy + 0.005)
        ]
        return Shape(
            ((box, painted(self.colour)), *((wheel, rubber("black")) for wheel in wheels)),
            (*slab(self.hx, self.hy, FLOOR), *tray(self.hx, self.hy, WALL, self.height)[1:]),
            mass=0.2,
            friction=0.7,
        )

    def frames(self) -> NamedFrames:
        return hollow(self.height, FLOOR)
