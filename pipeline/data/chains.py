"""Where an arm's tool is for given joints, without a simulator."""

import os
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import ArrayLike

from pipeline.poses import Floats, Pose, compose, frame, pose, quat_from_rpy

from .errors import DominoError
from .names import NONE, SIDES, is_embodiment

ROBOTS = Path(__file__).parents[1] / "assets" / "robots"  # of this package


class ChainError(DominoError):
    """A robot whose kinematics cannot be read."""


@dataclass(frozen=True, eq=False)
class ToolChain:
    """The joints from an arm's root link to its tool frame, m and rad: `base` (7,) in the world,
    `origins` (n,7) before each joint, `tool` (7,) last.
    """

    base: Pose
    joints: tuple[str, ...]
    origins: Floats
    axes: Floats
    prismatic: tuple[bool, ...]
    tool: Pose

    def poses(self, q: ArrayLike) -> Floats:
        """World poses (T,7) of the tool for joints (T,n)."""
        q = np.asarray(q, float)
        out = np.broadcast_to(self.base, (len(q), 7))
        for i, slides in enumerate(self.prismatic):
            motion = np.zeros((len(q), 7))
            if slides:
                motion[:, :3], motion[:, 3] = q[:, i : i + 1] * self.axes[i], 1.0
            else:
                half = q[:, i : i + 1] / 2
                motion[:, 3:4], motion[:, 4:] = np.cos(half), np.sin(half) * self.axes[i]
            out = compose(compose(out, self.origins[i]), motion)
        return compose(out, self.tool)


def read_chains(
    embodiment: str, layout: str = "ours", raised: float = 0.0, folders: Sequence[Path] = ()
) -> dict[str, ToolChain]:
    """The chain of each arm by side, left first; `raised` (m) is how much higher the bases are.
    Raises ChainError.
    """
    if not is_embodiment(embodiment):
        raise ChainError(f"{embodiment!r} is not the name of a robot")
    left, _, right = embodiment.partition("+")
    models = dict(zip(SIDES, (left, right or left), strict=True))
    up = pose((0.0, 0.0, raised))
    chains = {
        side: _read(_directory(model, folders), side, layout)
        for side, model in models.items()
        if model != NONE
    }
    return {side: replace(chain, base=compose(up, chain.base)) for side, chain in chains.items()}


def _directory(name: str, folders: Sequence[Path]) -> Path:
    for folder in (ROBOTS, *folders):
        if (folder / name / "robot.toml").is_file():
            return folder / name
    raise ChainError(
        f"tool poses need the kinematics of {name!r}, which is not installed: name the directory of"
        " its plugin with --plugins"
    )


@lru_cache(64)
def _read(directory: Path, side: str, layout: str) -> ToolChain:
    try:
        settings = tomllib.loads((directory / "robot.toml").read_text())
        above = {
            joint.find("child").attrib["link"]: joint  # pyright: ignore[reportOptionalMemberAccess]
            for joint in ElementTree.parse(os.fspath(directory / "robot.urdf")).iterfind("joint")
        }
        return _chain(settings, above, side, layout)
    except (OSError, ValueError, KeyError, AttributeError, ElementTree.ParseError) as error:
        raise ChainError(f"{directory}: cannot be read as a robot: {error}") from error


def _chain(
    settings: dict[str, Any], above: dict[str, ElementTree.Element], side: str, layout: str
) -> ToolChain:
    path, link = list[ElementTree.Element](), settings["hand"]
    while link in above and len(path) < len(above):
        path.append(above[link])
        link = path[-1].find("parent").attrib["link"]  # pyright: ignore[reportOptionalMemberAccess]
    origins, axes, prismatic, names, carried = [], [], [], [], pose()
    for joint in reversed(path):
        carried = compose(carried, _origin(joint))
        if joint.attrib["type"] == "fixed":
            continue
        axis = _numbers(joint.find("axis"), "xyz", (1.0, 0.0, 0.0))
        origins.append(carried)
        axes.append(axis / np.linalg.norm(axis))
        prismatic.append(joint.attrib["type"] == "prismatic")
        names.append(joint.attrib["name"])
        carried = pose()
    tcp, place = settings["tcp"], settings["place"][side]
    approach = tcp["approach"]
    opening = np.cross(np.cross(approach, tcp["opening"]), approach)
    position = place["position"]
    if layout == "original":
        position = settings.get("original", {}).get(side, position)
    return ToolChain(
        np.array([*position, *place["quaternion"]], float),
        tuple(names),
        np.stack(origins),
        np.stack(axes),
        tuple(prismatic),
        compose(carried, frame(tcp["position"], approach, opening)),
    )


def _origin(joint: ElementTree.Element) -> Pose:
    origin = joint.find("origin")
    roll, pitch, yaw = _numbers(origin, "rpy", (0.0, 0.0, 0.0)).tolist()
    return pose(_numbers(origin, "xyz", (0.0, 0.0, 0.0)), quat_from_rpy(roll, pitch, yaw))


def _numbers(
    element: ElementTree.Element | None, key: str, default: tuple[float, float, float]
) -> Floats:
    text = None if element is None else element.get(key)
    return np.array(default if text is None else [float(word) for word in text.split()])
