"""The simulator's knowledge of objects as columns (docs/labels.md)."""

from collections.abc import Sequence

import numpy as np

from pipeline.data.episode.world import contact_forces, twists_of
from pipeline.poses import Floats

from .episodes import ExportError, Facts

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
    """Values (T,N) of each column of `label_names`."""
    log, names = facts.log, labelled(facts) if labels else []
    rows, columns = [log.bodies.index(name) for name in names], dict[str, Floats]()
    for label in labels:
        values = np.zeros((len(log), PLACES, len(LABELS[label])))
        if label == "poses":
            of_bodies = log.poses
        elif label == "twists":
            of_bodies = twists_of(log, facts.meta.target)
        else:  # the sum of the contact forces on each body
            of_bodies = np.zeros((len(log), len(log.bodies)))
            forces = contact_forces(log, facts.meta.physics_hz)
            for side in ("a", "b"):
                np.add.at(of_bodies, (log.contacts["frame"], log.contacts[side]), forces)
            of_bodies = of_bodies[..., None]
        values[:, : len(rows)] = of_bodies[:, rows]
        columns[f"objects{joint}{label}"] = values.reshape(len(log), -1)
    return columns
