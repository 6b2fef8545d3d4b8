"""What is derived from the log of an exported episode."""

import numpy as np
from numpy.typing import NDArray

from pipeline.data.episode.events import spans
from pipeline.data.names import SIDES
from pipeline.motion.models import motion_from_json
from pipeline.motion.paths import trace_ahead
from pipeline.motion.recorded import Interception
from pipeline.poses import Floats

from .episodes import ExportError, Facts


def interception(facts: Facts) -> Interception:
    """What the log says about the meeting. Raises ExportError if the motion cannot be read."""
    try:
        motion = motion_from_json(facts.motion)
    except ValueError as error:
        raise ExportError(f"{facts.source}: {error}") from error
    return Interception(facts.meta, facts.log, motion, facts.target)


def event_columns(facts: Facts) -> tuple[list[str], NDArray[np.float32]]:
    """Kinds (T,) in force at each frame, joined by +, and whether there are any."""
    active = [
        (span.event.kind, span.holds(facts.log.times))
        for span in spans(facts.meta.events, facts.log.events)
    ]
    kinds = ["+".join(kind for kind, holds in active if holds[t]) for t in range(len(facts))]
    return kinds, np.array([kind != "" for kind in kinds], np.float32)


def contact_flags(facts: Facts, body: str) -> NDArray[np.float32]:
    """Flags (T,2), left and right: 1 after a touch in the interval that ends there."""
    bodies, rows = facts.log.bodies, facts.log.contacts
    flags = np.zeros((len(facts), len(SIDES)), np.float32)
    a, b = rows["a"], rows["b"]
    for column, side in enumerate(SIDES):
        arm = [
            i
            for i, name in enumerate(bodies)
            if name.startswith(f"{side}_") and name not in facts.meta.objects
        ]
        of = bodies.index(body)
        hit = ((a == of) & np.isin(b, arm)) | ((b == of) & np.isin(a, arm))
        flags[rows["frame"][hit], column] = 1
    return flags


def trace_of(facts: Facts, camera: str) -> Floats:
    """The target's path (T,H,3) in a camera's next second (motion/paths.py)."""
    kind = facts.meta.drawing.cameras[camera].camera(camera).type
    return trace_ahead(kind, facts.camera_poses[camera], facts.target[:, :3], facts.fps)
