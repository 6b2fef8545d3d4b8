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

from pipeline.poses import Floats, Pose, compose, frame, pose

from .errors import DominoError
from .joints import Joint, joint_motion, joints_to, read_joint
from .names import NONE, SIDES, is_embodiment

ROBOTS = Path(__file__).parents[1] / "assets" / "robots"  # of this package


class ChainError(DominoError):
    """A robot whose kinematics cannot be read."""


@dataclass(frozen=True, eq=False)
class ToolChain:
    """The joints from an arm's root link, at `base` (7,) in the world, to its hand, and the tool
    frame (7,) in the hand.
    """

    base: Pose
    path: list[Joint]
    tool: Pose

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints that move, by name."""
        return tuple(joint.name for joint in self.path if joint.kind != "fixed")

    def poses(self, q: ArrayLike) -> Floats:
        """World poses (T,7) of the tool for joints (T,n), rad or m."""
        q = np.asarray(q, float)
        positions, out = iter(q.T), np.broadcast_to(self.base, (len(q), 7))
        for joint in self.path:
            out = compose(out, joint.origin)
            if joint.kind != "fixed":
                out = compose(out, joint_motion(joint, next(positions)))
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
        urdf = ElementTree.parse(os.fspath(directory / "robot.urdf"))
        path = joints_to(settings["hand"], map(read_joint, urdf.iterfind("joint")))
        return _chain(settings, path, side, layout)
    except (OSError, ValueError, KeyError, AttributeError, ElementTree.ParseError) as error:
        raise ChainError(f"{directory}: cannot be read as a robot: {error}") from error


def _chain(settings: dict[str, Any], path: list[Joint], side: str, layout: str) -> ToolChain:
    tcp, place = settings["tcp"], settings["place"][side]
    approach = tcp["approach"]
    opening = np.cross(np.cross(approach, tcp["opening"]), approach)
    position = place["position"]
    if layout == "original":
        position = settings.get("original", {}).get(side, position)
    base = np.array([*position, *place["quaternion"]], float)
    return ToolChain(base, path, frame(tcp["position"], approach, opening))
