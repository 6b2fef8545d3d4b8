"""A body of a scene: an instance of an object family, its name, and where it stands."""

from dataclasses import dataclass

from pipeline.poses import Pose
from pipeline.world.objects.contract import Family

TABLE_TOP = 0.74
"""Height of the table top in m."""

TABLE_HALF = (0.6, 0.35)
"""Half extents of the table top in x and y, m."""


@dataclass(frozen=True, eq=False)
class Body:
    """`pose` (7,) is the manipulation pose in the world; a `fixed` body never moves (a goal pad glued to the table)."""

    name: str
    family: str
    instance: Family
    pose: Pose
    fixed: bool = False
