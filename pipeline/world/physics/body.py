"""A body, what moves it, the room it takes, and scenery: plain data."""

from dataclasses import dataclass

import numpy as np

from pipeline.motion.scenery import Piece, Prop
from pipeline.poses import Floats, Pose, compose, pose
from pipeline.world.objects.contract import Family, Slide
from pipeline.world.objects.geometry import box, cylinder, sphere
from pipeline.world.shapes import Collider, Material, Mesh, Parts

TABLE_TOP = 0.74
"""m; its height."""

TABLE_HALF = (0.6, 0.35)  # m, in x and y

TABLE_THICKNESS = 0.05

TABLE_COLLISION = Collider(
    "box", (*TABLE_HALF, TABLE_THICKNESS / 2), pose((0.0, 0.0, TABLE_TOP - TABLE_THICKNESS / 2))
)
"""The table top as a collision piece in the world frame."""

BORNE = 0.5
"""s for which a hook or a hand bears a target that was touched, until a gripper has closed on it.
"""


@dataclass(frozen=True, eq=False)
class Body:
    """`pose` (7,) is the manipulation pose in the world.

    `inside` names the body it rides in; with a `slide` it runs there like a drawer. A `borne` one
    is let go BORNE s after the first touch.
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


Outline = tuple[Pose, Floats]
"""World pose (7,) of an upright body, and its bounds (2,3) in its own frame."""


def outline_of(body: Body) -> Outline:
    return body.pose, body.instance.shape().aabb()


def apart(a: Outline, b: Outline, gap: float) -> bool:
    """Whether two outlines are `gap` m apart from above (separating axes)."""
    p, q = _corners(a), _corners(b)
    for corners in (p, q):
        for edge in (corners[1] - corners[0], corners[2] - corners[1]):
            axis = edge / np.linalg.norm(edge)
            pa, pb = p @ axis, q @ axis
            if pa.min() - pb.max() >= gap or pb.min() - pa.max() >= gap:
                return True
    return False


def _corners(outline: Outline) -> Floats:
    pose, ((x0, y0, _), (x1, y1, _)) = outline
    yaw = 2 * np.arctan2(pose[6], pose[3])
    c, s = np.cos(yaw), np.sin(yaw)
    corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    return corners @ np.array([[c, s], [-s, c]]) + pose[:2]


def parts_of(prop: Prop) -> Parts:
    """A prop's look in its own frame."""
    return tuple((_mesh(piece), Material(piece.colour, 0.7)) for piece in prop.pieces)


def colliders_of(prop: Prop) -> tuple[Collider, ...]:
    """A prop's collision pieces in its own frame."""
    return tuple(
        Collider(piece.kind, piece.size, np.asarray(piece.at, float)) for piece in prop.pieces
    )


def _mesh(piece: Piece) -> Mesh:
    if piece.kind == "box":
        hx, hy, hz = piece.size
        return box(hx, hy, hz).moved(piece.at)
    if piece.kind == "sphere":
        return sphere(piece.size[0], 12, 20).moved(piece.at)
    radius, half = piece.size
    return cylinder(radius, 2 * half, 48).moved(compose(piece.at, pose((0, 0, -half))))
