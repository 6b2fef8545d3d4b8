"""What is derived from the log of an exported episode."""

from collections.abc import Sequence

import numpy as np

from pipeline.data.episode.events import by_role, spans
from pipeline.data.episode.world import contact_forces, twists_of
from pipeline.data.names import SIDES
from pipeline.motion.models import motion_from_json
from pipeline.motion.recorded import Interception, trace_ahead
from pipeline.poses import Floats, Floats32

from .episodes import ExportError, Facts


def interception(facts: Facts) -> Interception:
    """What the log says about the meeting. Raises ExportError if the motion cannot be read."""
    try:
        motion = motion_from_json(facts.motion)
    except ValueError as error:
        raise ExportError(f"{facts.source}: {error}") from error
    return Interception(facts.meta, facts.log, motion)


def event_columns(facts: Facts) -> tuple[list[str], Floats32]:
    """Kinds (T,) in force at each frame, joined by +, and whether there are any."""
    active = [
        (span.event.kind, span.holds(facts.log.times))
        for span in spans(facts.meta.events, facts.log.events)
    ]
    kinds = ["+".join(kind for kind, holds in active if holds[t]) for t in range(len(facts))]
    return kinds, np.array([kind != "" for kind in kinds], np.float32)


def contact_flags(facts: Facts, body: str) -> Floats32:
    """Flags (T,2), left and right: 1 after a touch in the interval that ends there."""
    log = by_role(facts.log, facts.meta.events, facts.meta.target)
    bodies, rows = log.bodies, log.contacts
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


LABELS = {
    "poses": ("x", "y", "z", "qw", "qx", "qy", "qz"),
    "twists": ("vx", "vy", "vz", "wx", "wy", "wz"),
    "forces": ("force",),
}
"""Numbers of an object in each label: world frame, m, rad/s, N."""

PLACES = 8
"""Objects in a column; zeros stand for those that an episode has not."""


def labelled(facts: Facts) -> list[str]:
    """Target, manipulated, others by name, distractors. Raises ExportError."""
    meta = facts.meta
    first = [meta.target, meta.manipulated]
    names = sorted(
        (name for name in meta.objects if name in facts.log.bodies),
        key=lambda name: (
            first.index(name) if name in first else len(first),
            name in meta.clutter,
            name,
        ),
    )
    if len(names) > PLACES + len(meta.clutter):
        raise ExportError(f"{facts.source}: has {len(names)} objects; --labels holds {PLACES}")
    return names[:PLACES]


def label_names(labels: Sequence[str], joint: str = "_") -> dict[str, list[str]]:
    """ "objects_poses" -> ["0_x", ...]"""
    return {
        f"objects{joint}{label}": [f"{i}_{part}" for i in range(PLACES) for part in LABELS[label]]
        for label in labels
    }


def label_values(facts: Facts, labels: Sequence[str], joint: str = "_") -> dict[str, Floats]:
    log, names = facts.log, labelled(facts) if labels else []
    rows, columns = [log.bodies.index(name) for name in names], dict[str, Floats]()
    for label in labels:
        values = np.zeros((len(log), PLACES, len(LABELS[label])))
        if label == "poses":
            of_bodies = log.poses
        elif label == "twists":
            of_bodies = twists_of(log, facts.meta)
        else:  # the sum of the contact forces on each body
            of_bodies = np.zeros((len(log), len(log.bodies)))
            forces = contact_forces(log, facts.meta.physics_hz)
            for side in ("a", "b"):
                np.add.at(of_bodies, (log.contacts["frame"], log.contacts[side]), forces)
            of_bodies = of_bodies[..., None]
        values[:, : len(rows)] = of_bodies[:, rows]
        columns[f"objects{joint}{label}"] = values.reshape(len(log), -1)
    return columns
