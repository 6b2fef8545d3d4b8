"""A capped bottle that lies on its side, its cap towards +x."""

from dataclasses import dataclass, replace

import numpy as np

from pipeline.poses import Pose, compose, pose, quat_about
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.families.goods.bottle import HEIGHT, Bottle
from pipeline.world.objects.grasping import bar_pinches
from pipeline.world.objects.kit import mark, standing
from pipeline.world.objects.parameters import LONG, between
from pipeline.world.shapes import Shape


@register("lying_bottle")
@dataclass(frozen=True)
class LyingBottle(Bottle):
    """The origin is under the middle of its length, where it touches the table; frame "cap" looks
    out of the bottle."""

    noun = "bottle"

    height: float = between(*HEIGHT, size=LONG)

    @property
    def _laid(self) -> Pose:
        """Pose of the standing bottle in this frame."""
        return pose((-self.height / 2, 0, self.radius), quat_about((0, 1, 0), np.pi / 2))

    def shape(self) -> Shape:
        upright = super().shape()
        return replace(
            upright,
            visual=tuple((mesh.moved(self._laid), skin) for mesh, skin in upright.visual),
            collision=tuple(
                replace(c, pose=compose(self._laid, c.pose)) for c in upright.collision
            ),
        )

    def frames(self) -> NamedFrames:
        r, end = self.radius, self.height / 2
        along = [share * self.body - end for share in (0.3, 0.45, 0.6, 0.75)]
        return standing(
            2 * r, bar_pinches(along, r, r, kind="body"), cap=mark(end, 0, r, (1, 0, 0), (0, 0, -1))
        )
