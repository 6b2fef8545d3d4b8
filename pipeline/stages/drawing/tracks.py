"""Tracks of an episode's objects in its cameras, without drawing."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.data.cameras import world_poses
from pipeline.data.episode.events import exchanged
from pipeline.data.episode.state_log import StateLog
from pipeline.data.names import HEAD
from pipeline.data.setup import Setup
from pipeline.motion.recorded import LEAST, SECONDS, TRACKS, before_meeting, is_unoccluded
from pipeline.stages.attempt import Rollout
from pipeline.stages.failure import Failure
from pipeline.world.drawing.room import table_legs, table_top
from pipeline.world.drawing.silhouettes import occluders_of, track_bodies

from .render import Appearance, appearance_of, body_poses


def track_arrays(
    appearance: Appearance, log: StateLog, objects: Sequence[str]
) -> dict[str, NDArray[Any]]:
    """Arrays of `objects` by key, such as "tracks/<camera>/box" (silhouettes.BodyTracks)."""
    fixed = [*appearance.furniture, *table_legs(), *table_top(appearance.visuals)]
    solids, poses = occluders_of(appearance.bodies, fixed), body_poses(log)
    found: dict[str, NDArray[Any]] = {}
    for camera in appearance.cameras:
        at = world_poses(camera, poses, len(log))
        track = track_bodies(solids, poses, objects, camera.type, at)
        found |= {f"{TRACKS}{camera.name}/{name}": values for name, values in vars(track).items()}
    return found


def require_view(rollout: Rollout, setup: Setup) -> None:
    """Raise Failure unless the head camera sees the target in half of the frames before the
    meeting.
    """
    log, target = rollout.replay.log, rollout.scene.task.target
    head = setup.model_copy(update={"cameras": ("head",), "size": None})
    seen = appearance_of(rollout.scene, head)
    span = exchanged(rollout.scene.events, log.events)
    names = [target] if span is None else [target, span.event.body]
    each = track_arrays(seen, log, names)[f"{TRACKS}{HEAD}/visible"]
    share = each[:, 0] if span is None else np.where(span.holds(log.times), *each.T[::-1])
    last = before_meeting(log, share)
    if not is_unoccluded(last):
        raise _occluded(rollout, last)


def _occluded(rollout: Rollout, last: NDArray[Any]) -> Failure:
    why = (
        f"in {100 * (last < LEAST).mean():.0f} % of the last {SECONDS:g} s before the meeting less"
        f" than {100 * LEAST:.0f} % of the {rollout.scene.task.target} is visible"
    )
    features, log = rollout.motion.features(), rollout.replay.log
    failure = Failure("view", "occluded", why, steps=rollout.steps, drawn=features, log=log)
    failure.motion, failure.meeting = rollout.motion, rollout.meeting
    return failure
