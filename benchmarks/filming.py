"""Films of episodes from across the table, for figures."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from pipeline.data.cameras import Camera, CameraType, View, look
from pipeline.data.episode.file import EpisodeFile
from pipeline.data.episode.state_log import StateLog
from pipeline.data.names import OBSERVER
from pipeline.data.slots.assets import AssetStore
from pipeline.poses import Pose
from pipeline.stages.drawing.render import render, stored_appearance

FILMED = CameraType(640, 480, 40.0)
FACING, FREE = (-0.40, -0.70, -0.50), 0.10
"""The way a film looks, across the table at the robot, and the share of the image that stays
free."""


def film(path: Path, bodies: Path, *cameras: str) -> list[View]:
    """A stored episode at 640x480, from a framing camera and the stored ones."""
    with EpisodeFile(path) as file:
        episode = file.read()
    appearance = stored_appearance(episode, AssetStore(bodies))
    size = {"width": FILMED.width, "height": FILMED.height}
    stored = appearance.seen_by(*cameras).cameras
    outside = facing(episode.log, episode.meta.target, episode.meta.manipulated)
    seen = (outside, *(replace(c, type=replace(c.type, **size)) for c in stored))
    return render(replace(appearance, cameras=seen, preset="raster"), episode.log)


def facing(log: StateLog, *bodies: str) -> Camera:
    """The camera across the table that sees both arms and these bodies at every frame."""
    arms = tuple(f"{side}_" for side in log.sides)
    acting = [name for name in log.bodies if name.startswith(arms) or name in bodies]
    points = np.concatenate([log.pose(name)[:, :3] for name in acting])
    return Camera(OBSERVER, FILMED, None, framed(points, FACING, FILMED, FREE))


def framed(points: ArrayLike, forward: ArrayLike, kind: CameraType, margin: float = 0.05) -> Pose:
    """World pose of the nearest upright camera along `forward` that shows all points (N,3), with
    a free `margin`.
    """
    f = np.asarray(forward, float) / np.linalg.norm(forward)
    left = np.cross([0.0, 0.0, 1.0], f)
    left /= np.linalg.norm(left)
    size = np.array([kind.width / kind.height, 1.0])
    across = np.tan(np.radians(kind.fovy) / 2) * (1 - 2 * margin) * size
    p = np.asarray(points, float)
    depth, sides = p @ f, p @ np.stack([left, np.cross(f, left)], 1)
    # |side - centre| <= across (depth - eye) for every point bounds `eye` from both sides
    low, high = ((across * depth[:, None] + sign * sides).min(0) for sign in (-1, 1))
    eye, centre = float(((low + high) / (2 * across)).min()), (high - low) / 2
    return look(f * eye + left * centre[0] + np.cross(f, left) * centre[1], f, left)
