"""A body of a scene: an instance of an object family, its name, and where it stands."""

from dataclasses import dataclass

from pipeline.poses import Pose, pose
from pipeline.world.objects.contract import Family, Slide
from pipeline.world.shapes import Collider

TABLE_TOP = 0.74
"""Height of the table top in m."""

TABLE_HALF = (0.6, 0.35)
"""Half extents of the table top in x and y, m."""

TABLE_THICKNESS = 0.05
"""Thickness of the table top in m."""

TABLE_COLLISION = Collider(
    "box", (*TABLE_HALF, TABLE_THICKNESS / 2), pose((0.0, 0.0, TABLE_TOP - TABLE_THICKNESS / 2))
)
"""The table top as a collision piece in the world frame."""

BORNE = 0.5
"""Seconds for which a hook or a hand bears the weight of a target that was touched, until a gripper
has closed on it."""


@dataclass(frozen=True, eq=False)
class Body:
    """`pose` (7,) is the manipulation pose in the world; a `fixed` body never moves (a goal pad
    glued to the table).

    `inside` names the body it begins in: balls in a bin ride along with it. With a `slide` it runs
    in that body like a drawer, from where it stands. A `borne` one hangs or is held in the air:
    what bears it lets go `BORNE` s after the first touch.
    """

    name: str
    family: str
    instance: Family
    pose: Pose
    fixed: bool = False
    inside: str = ""
    slide: Slide | None = None
    borne: bool = False

    @property
    def rides(self) -> bool:
        """Whether it lies loose in another body."""
        return bool(self.inside) and self.slide is None
