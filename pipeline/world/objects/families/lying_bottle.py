"""A capped bottle that lies on its side, its cap towards +x."""

from dataclasses import dataclass, replace

import numpy as np

from pipeline.poses import Pose, compose, pose, quat_about
from pipeline.world.objects.contract import NamedFrames, Words, register
from pipeline.world.objects.families.bottle import HEIGHT, Bottle
from pipeline.world.objects.grasping import bar_pinches
from pipeline.world.objects.kit import mark, size_word, standing
from pipeline.world.objects.words import describe
from pipeline.world.shapes import Shape


@register("lying_bottle")
@dataclass(frozen=True)
class LyingBottle(Bottle):
    """The origin is under the middle of its length, where it touches the table; frame "cap" looks out of the bottle."""

    @property
    def _laid(self) -> Pose:
        """Pose of the standing bottle in this frame."""
        return pose((-self.height / 2, 0, self.radius), quat_about((0, 1, 0), np.pi / 2))

    def shape(self) -> Shape:
        standing = super().shape()
        return replace(
            standing,
            visual=tuple((mesh.moved(self._laid), skin) for mesh, skin in standing.visual),
            collision=tuple(replace(c, pose=compose(self._laid, c.pose)) for c in standing.collision),
        )

    def frames(self) -> NamedFrames:
        r, end = self.radius, self.height / 2
        along = [share * self.body - end for share in (0.3, 0.45, 0.6, 0.75)]
        return standing(2 * r, bar_pinches(along, r, r, kind="body"), cap=mark(end, 0, r, (1, 0, 0), (0, 0, -1)))

    def words(self) -> Words:
        return describe(
            "lying_bottle",
            "bottle",
            colour=self.colour,
            size=size_word(self.height, HEIGHT, ("short", "medium-sized", "long")),
            cap=self.cap_colour,
            label=self.label_colour,
        )
