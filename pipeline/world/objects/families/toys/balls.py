"""Balls: a plain one, and one with a stripe that fits a gripper."""

from dataclasses import dataclass, replace

import numpy as np

from pipeline.world.looks.materials import made_of, plastic
from pipeline.world.objects.colliders import ALONG_Y, sphere_collider
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.geometry import at, revolve, sphere
from pipeline.world.objects.grasping import side_pinches
from pipeline.world.objects.kit import COLOURS, mark, standing
from pipeline.world.objects.parameters import LARGE, Parametric, between, one_of
from pipeline.world.shapes import Shape


@register("ball")
@dataclass(frozen=True)
class Ball(Parametric):
    """A small ball, such as is tipped out of a bin."""

    radius: float = between(0.007, 0.010, size=LARGE)
    density: float = between(900, 1500)
    material: str = one_of(("plastic", "rubber"))
    colour: str = one_of(COLOURS)

    def shape(self) -> Shape:
        r = self.radius
        skin = made_of(self.material, self.colour)
        return Shape(
            visual=((at(sphere(r, 8, 14), (0, 0, r)), skin),),
            collision=sphere_collider(r, (0, 0, r)),
            mass=self.density * 4 / 3 * np.pi * r**3,
            friction=0.6,
        )

    def frames(self) -> NamedFrames:
        return standing(2 * self.radius, middle=mark(0, 0, self.radius))


@register("play_ball")
@dataclass(frozen=True)
class PlayBall(Ball):
    """A ball that fits a gripper, with a stripe that shows how it rolls."""

    noun = "ball"

    radius: float = between(0.022, 0.028, size=LARGE)
    density: float = between(300, 600)

    def shape(self) -> Shape:
        r, plain = self.radius, super().shape()
        turn = np.radians(np.arange(-15, 16, 5))
        stripe = revolve(
            np.column_stack([1.004 * r * np.cos(turn), r + 1.004 * r * np.sin(turn)]), 24, 60.0
        )
        return replace(
            plain, visual=(*plain.visual, (at(stripe, (0, -r, r), ALONG_Y), plastic("white")))
        )

    def frames(self) -> NamedFrames:
        r, angle = self.radius, np.radians(np.arange(-80, 81, 20))
        outline = np.column_stack([r * np.cos(angle), r + r * np.sin(angle)])
        return NamedFrames(super().frames().points, side_pinches(r, r, outline=outline))
