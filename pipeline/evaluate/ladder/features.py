"""What the networks of the ladder see of one frame, of a demonstration or of a running trial."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.poses import quat_rotate

Floats = NDArray[np.float64]

INPUTS = ("position", "velocity", "two_frames")
"""Rungs: where everything is now; and the target's velocity; and where everything was a moment ago."""


@dataclass(frozen=True, eq=False)
class State:
    """T frames: measured joints (T,A), tool positions (T,2,3), poses (T,B,7) of the bodies with the target first, the target's
    velocity (T,3)."""

    joints: Floats
    tools: Floats
    poses: Floats
    velocity: Floats


def features(state: State, kind: str, back: int = 1) -> Floats:
    """(T,F): joints, the way from each tool to each body, position and two axes of each body; for `velocity` the target's
    velocity too; for `two_frames` the same of the frame `back` frames earlier (the first one stands for those before it)."""
    ways = state.poses[:, None, :, :3] - state.tools[:, :, None]
    axes = [quat_rotate(state.poses[..., 3:], np.array(axis)) for axis in ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0))]
    parts = [state.joints, ways, state.poses[..., :3], *axes]
    now = np.concatenate([part.reshape(len(state.joints), -1) for part in parts], 1)
    if kind == "velocity":
        return np.concatenate([now, state.velocity], 1)
    if kind == "two_frames":
        return np.concatenate([now, now[np.maximum(np.arange(len(now)) - back, 0)]], 1)
    return now


def target_first(bodies: Sequence[str], target: str) -> list[int]:
    """Indices of the bodies with the target before the others, which keep their order by name."""
    return sorted(range(len(bodies)), key=lambda i: (bodies[i] != target, bodies[i]))


def chunks(joints: Floats, actions: Floats, length: int, grippers: Sequence[int]) -> Floats:
    """What is learnt (T-1,length,A): the next actions after each frame as differences from the joints measured at it, grippers as
    they are; the last action stands for those after the end."""
    index = np.minimum(np.arange(len(actions) - 1)[:, None] + np.arange(length), len(actions) - 2)
    return actions[index] - reference(joints[:-1], grippers)[:, None]


def reference(joints: Floats, grippers: Sequence[int]) -> Floats:
    """The joints (T,A) that actions are differences from: zero for grippers."""
    out = np.array(joints)
    out[:, list(grippers)] = 0
    return out
