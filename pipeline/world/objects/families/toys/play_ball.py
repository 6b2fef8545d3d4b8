"""A ball that fits a gripper, with a stripe that shows how it rolls."""

from dataclasses import dataclass, replace

import numpy as np

from pipeline.world.looks.materials import plastic
from pipeline.world.objects.colliders import ALONG_Y
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.families.toys.ball import Ball
from pipeline.world.objects.geometry import at, revolve
from pipeline.world.objects.grasping import side_pinches
from pipeline.world.objects.parameters import LARGE, between
from pipeline.world.shapes import Shape


@register("play_ball")
@dataclass(frozen=True)
class PlayBall(Ball):
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
