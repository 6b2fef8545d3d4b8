"""Names in paths, and of sides and cameras."""

import re
from collections.abc import Collection, Iterable, Mapping

MANIFEST = "manifest.yaml"  # where it is, is a dataset
EXPORT_RECORD = "export.json"

SIDES = ("left", "right")  # the arms, in the order of every vector
NONE = "none"  # the arm that is not there in an embodiment's name: `franka-panda+none`


def sides_of(vector_names: Collection[str]) -> tuple[str, ...]:
    """The arms that a state vector has, in the order of SIDES."""
    return tuple(side for side in SIDES if f"{side}_gripper" in vector_names)


HEAD, LEFT_WRIST, RIGHT_WRIST = "head_camera", "left_camera", "right_camera"
OBSERVER = "observer_camera"
"""Cameras as episode files call them."""

CAMERAS = {"head": HEAD, "left": LEFT_WRIST, "right": RIGHT_WRIST, "observer": OBSERVER}
"""Cameras as recipes and options call them; the observer stands across the table."""

MOUNTED = ("head", "left", "right")  # on every robot

EXPORTED_CAMERAS = {
    HEAD: "cam_high",
    LEFT_WRIST: "cam_left_wrist",
    RIGHT_WRIST: "cam_right_wrist",
    OBSERVER: "cam_observer",
}
"""Cameras as exports call them, unless the format has names of its own."""

_WORD = r"[A-Za-z0-9]+(?:[_-][A-Za-z0-9]+)*"
_NAME = re.compile(_WORD)
_EMBODIMENT = re.compile(rf"{_WORD}(?:\+{_WORD})?")
LONGEST = 64

RETIRED = "robot_meshes"
"""A key of earlier versions: robots drawn with their vendor's meshes."""


def is_name(text: object) -> bool:
    """Letters, digits, single underscores or hyphens inside: safe in a path."""
    return isinstance(text, str) and len(text) <= LONGEST and _NAME.fullmatch(text) is not None


def is_embodiment(text: object) -> bool:
    """Whether it names a robot, or a pair of arms written left+right."""
    return (
        isinstance(text, str)
        and len(text) <= 2 * LONGEST + 1
        and _EMBODIMENT.fullmatch(text) is not None
    )


def exported_names(cameras: Iterable[str], given: Mapping[str, str]) -> dict[str, str]:
    """Exported camera names: `given`, else EXPORTED_CAMERAS, else its own. Raises ValueError for
    wrong or repeated ones.
    """
    cameras = tuple(cameras)
    if missing := sorted(set(given) - set(cameras)):
        raise ValueError(f"there is no camera {missing[0]}: cameras are {', '.join(cameras)}")
    names = {camera: given.get(camera, EXPORTED_CAMERAS.get(camera, camera)) for camera in cameras}
    for name in names.values():
        if not is_name(name):
            raise ValueError(f"{name!r} is no camera name: use letters, digits, single underscores")
    if len(set(names.values())) < len(names):
        pairs = ", ".join(f"{camera}={name}" for camera, name in names.items())
        raise ValueError(f"two cameras get the same name: {pairs}")
    return names
