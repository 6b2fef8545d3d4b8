"""The arrays of the group `interception` of an episode file: what its physics says about the
meeting, by key below the group.

First contacts stand in the group, too; the state log carries them (StateLog.touches). Tracks of the
objects in the images are added where the images are drawn (stages/drawing/tracks.py).
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.motion.recorded.interception import Interception, pose_at

CONDITIONS = "conditions/"
TRACKS = "tracks/"


def physics_arrays(
    derived: Interception, conditions: Mapping[str, NDArray[np.bool_]]
) -> dict[str, NDArray[Any]]:
    """Arrays by key: clock, planned and real meeting, contacts, holding, speed (docs/formats.md has
    each), and the success conditions (T,) by name."""
    log, rate = derived.log, derived.rate
    planned = derived.meta.meeting_time
    values: dict[str, NDArray[Any]] = {
        "sim_step": derived.steps,
        "sim_time": derived.steps / rate,
        "sim_timestep": np.array(1 / rate),
        "lead": np.array(float(derived.motion.lead)),
        "motion_start_time": np.array(derived.motion_start + 0.0),
        "motion_start_step": np.array(round(derived.motion_start * rate)),
        "planned_time": np.array(planned),
        "planned_step": np.array(planned * rate),
        "planned_position": derived.planned_position,
        "target_speed": np.linalg.norm(log.target_velocity, axis=1),
        "contact_mask": derived.contact_pairs > 0,
        "contact_points": derived.contact_points,
        "contact_centroid": derived.contact_centroids,
        "stable_grasp": derived.held,
    }
    real = log.time_of("meeting")
    if real is not None:
        place = pose_at(log.times, derived.target, real)[:3]
        step = round(real * rate)
        values |= {
            "meeting_time": np.array(real),
            "meeting_step": np.array(step),
            "meeting_position": place,
        }
    return values | {
        f"{CONDITIONS}{name}": np.asarray(holds, bool) for name, holds in conditions.items()
    }


def conditions_of(arrays: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[np.bool_]]:
    """The success conditions (T,) by name from the arrays of the group."""
    return {
        key.removeprefix(CONDITIONS): values
        for key, values in arrays.items()
        if key.startswith(CONDITIONS)
    }
