"""The way of the tcp along a joint path: its length, whether it is a detour, and how much of it the
head camera does not see."""

import numpy as np

from pipeline.planning.budgets import DETOURS
from pipeline.planning.kinematics import Chain, fk_batch
from pipeline.planning.path import dense
from pipeline.planning.scene import Carried, Sees
from pipeline.poses import Floats, transform


def tool_way(chain: Chain, path: Floats) -> Floats:
    """World poses (M,7) of the tcp along joint waypoints (K,n), DETOURS.resolution apart."""
    return fk_batch(chain, dense(path, DETOURS.resolution))


def length_of(way: Floats) -> float:
    """Length (m) of a way (M,7)."""
    return float(np.linalg.norm(np.diff(way[:, :3], axis=0), axis=1).sum())


def longest(way: Floats) -> float:
    """Length (m) up to which a way (M,7) from its start to its end is no detour."""
    return DETOURS.slack + DETOURS.ratio * float(np.linalg.norm(way[-1, :3] - way[0, :3]))


def unseen_length(way: Floats, carried: Carried, sees: Sees) -> float:
    """Length (m) of a way (M,7) on which the middle of what is carried is out of view; 0 if it
    begins or ends there."""
    middle = np.mean([piece.pose[:3] for piece in carried.pieces], axis=0)
    seen = sees(np.array([transform(tcp, transform(carried.pose, middle)) for tcp in way]))
    if not (seen[0] and seen[-1]):
        return 0.0
    steps = np.linalg.norm(np.diff(way[:, :3], axis=0), axis=1)
    return float(steps[~seen[1:]].sum())
