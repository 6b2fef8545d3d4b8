"""Simulator truth of an episode's bodies: twists, contact forces, meshes."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.data.actions import rotations_of
from pipeline.data.cameras import Surfaces
from pipeline.poses import Floats, Floats32, quat_conjugate, quat_multiply

from .events import exchanged
from .meta import EpisodeMeta
from .state_log import StateLog


@dataclass(frozen=True, eq=False)
class BodyFacts:
    """A body's mesh in its frame, vertices (V,3) m and triangles (M,3), mass (kg) and friction,
    if known.
    """

    vertices: Floats32
    triangles: NDArray[np.uint32]
    mass: float | None
    friction: float | None


@dataclass(eq=False)
class WorldTruth:
    """What one camera sees of the bodies: `box` (T,N,4) px, `visible` (T,N) of `objects`."""

    bodies: Mapping[str, BodyFacts]
    surfaces: Surfaces
    objects: tuple[str, ...]
    box: Floats32
    visible: Floats32


def twists_of(log: StateLog, meta: EpisodeMeta) -> Floats:
    """World twists (T,B,6): origin velocity (m/s), angular velocity (rad/s). The first
    target's is recorded, others are pose differences.
    """
    frames = np.arange(len(log))
    before, after = np.maximum(frames - 1, 0), np.minimum(frames + 1, len(log) - 1)
    seconds = np.maximum(log.times[after] - log.times[before], 1e-9)[:, None, None]
    turned = quat_multiply(log.poses[after, :, 3:], quat_conjugate(log.poses[before, :, 3:]))
    moved = log.poses[after, :, :3] - log.poses[before, :, :3]
    twists = np.concatenate([moved, rotations_of(turned, "axis-angle")], -1) / seconds
    index = log.bodies.index(meta.target)
    span = exchanged(meta.events, log.events)
    own = slice(None) if span is None else ~span.holds(log.times)
    twists[own, index, :3] = log.target_velocity[own]
    if log.target_angular_velocity is not None:
        twists[own, index, 3:] = log.target_angular_velocity[own]
    return twists


def contact_forces(log: StateLog, physics_hz: int) -> Floats:
    """Force (N,) in N of each contact: its impulse over a physics step."""
    return log.contacts["impulse"].astype(float) * physics_hz
