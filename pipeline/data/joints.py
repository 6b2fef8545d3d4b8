"""The joints of a URDF, and how they move its links."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pipeline.poses import Floats, Pose, pose, quat_from_rpy

FREE = ("floating", "planar")
KINDS = {k: k for k in ("revolute", "prismatic", "fixed", *FREE)} | {"continuous": "revolute"}
LIMITS = ("lower", "upper", "velocity", "effort")


@dataclass(frozen=True, eq=False)
class Joint:
    """A URDF joint: `origin` is the child frame in the parent at zero, `axis` in the child; rad or
    m, N m or N."""

    name: str
    kind: str  # revolute | prismatic | fixed
    parent: str
    child: str
    origin: Pose
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    lower: float = 0.0
    upper: float = 0.0
    velocity: float = 0.0
    effort: float = 0.0


def read_joint(element: Any) -> Joint:
    """The joint of a `<joint>`, whose vectors have three numbers. Raises ValueError."""
    name, written = element.get("name", ""), element.get("type", "")
    kind, ends = KINDS.get(written), [element.find(tag) for tag in ("parent", "child")]
    parent, child = ("" if end is None else end.get("link", "") for end in ends)
    if not (kind and parent and child):
        kinds = ", ".join(k for k in KINDS if k not in FREE)
        raise ValueError(f"joint {name!r} needs a parent, a child and a type of {kinds}")
    axis = vector_of(element.find("axis"), "xyz", (1.0, 0.0, 0.0))
    if kind == "fixed":
        axis = np.array([0.0, 0.0, 1.0])
    if not axis.any():
        raise ValueError(f"joint {name!r} has an axis of length 0")
    # an axis of length 1 stays as it is written, to the last digit
    length = float(np.linalg.norm(axis))
    x, y, z = (axis if abs(length - 1) < 1e-12 else axis / length).tolist()
    lower, upper, velocity, effort = (number_of(element.find("limit"), k) for k in LIMITS)
    if written == "continuous":
        lower, upper = -2 * np.pi, 2 * np.pi
    limits = lower, upper, velocity, effort
    return Joint(name, kind, parent, child, origin_of(element), (x, y, z), *limits)


def origin_of(element: Any) -> Pose:
    """Pose (7,) of an element's `<origin xyz rpy>` (m, rad)."""
    origin = element.find("origin")
    roll, pitch, yaw = vector_of(origin, "rpy", (0.0, 0.0, 0.0)).tolist()
    return pose(vector_of(origin, "xyz", (0.0, 0.0, 0.0)), quat_from_rpy(roll, pitch, yaw))


def vector_of(element: Any, key: str, default: tuple[float, ...]) -> Floats:
    """The numbers of an attribute, `default` without it."""
    text = None if element is None else element.get(key)
    return np.array(default if text is None else [float(v) for v in text.split()])


def number_of(element: Any, key: str) -> float:
    """The number of an attribute, 0 without it."""
    return 0.0 if element is None else float(element.get(key, 0.0))


def joints_to(link: str, joints: Iterable[Joint]) -> list[Joint]:
    """The joints from the root to a link; none for an unknown link."""
    above, path = {joint.child: joint for joint in joints}, list[Joint]()
    while link in above and len(path) <= len(above):
        path.append(above[link])
        link = path[-1].parent
    return path[::-1]


def joint_motion(joint: Joint, position: ArrayLike) -> Pose:
    """Poses (..., 7) of the moved child frame in the unmoved one."""
    position = np.asarray(position, float)
    axis = np.asarray(joint.axis, float)
    moved = np.zeros((*position.shape, 7))
    moved[..., 3] = 1.0
    if joint.kind == "revolute":
        moved[..., 3] = np.cos(position / 2)
        moved[..., 4:] = np.sin(position / 2)[..., None] * axis / np.linalg.norm(axis)
    elif joint.kind == "prismatic":
        moved[..., :3] = position[..., None] * axis
    return moved
