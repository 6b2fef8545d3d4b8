"""Tracks of an episode's objects in its cameras, for the group `interception`: from state log and appearance, without drawing."""

from collections.abc import Sequence
from typing import Any

from numpy.typing import NDArray

from pipeline.data.cameras import world_poses
from pipeline.data.episode.state_log import StateLog
from pipeline.motion.recorded.group import TRACKS
from pipeline.stages.drawing.render import Appearance, body_poses
from pipeline.world.drawing.room import table_legs, table_top
from pipeline.world.drawing.silhouettes import solids_of, track_bodies


def track_arrays(appearance: Appearance, log: StateLog, objects: Sequence[str]) -> dict[str, NDArray[Any]]:
    """Arrays by key, "tracks/<camera>/box" and so on (world/silhouettes.Track), of the `objects` in their order."""
    fixed = [*appearance.furniture, *table_legs(), *table_top(appearance.visuals)]
    solids, poses = solids_of(appearance.bodies, fixed), body_poses(log)
    found: dict[str, NDArray[Any]] = {}
    for camera in appearance.cameras:
        track = track_bodies(solids, poses, objects, camera.type, world_poses(camera, poses, len(log)))
        found |= {f"{TRACKS}{camera.name}/{name}": values for name, values in vars(track).items()}
    return found
