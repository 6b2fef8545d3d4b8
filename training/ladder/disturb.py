"""Demonstrations as if the arms were somewhat off their path: what teaches a network the way
back."""

from dataclasses import replace

import numpy as np

from pipeline.planning.kinematics import fk_batch
from pipeline.planning.planner import planner_for
from pipeline.poses import Floats
from training.ladder.features import State


def disturbances(
    embodiment: str, frames: int, untouched: int, spread: float, rng: np.random.Generator
) -> Floats:
    """Offsets (T,A) of the arm joints, rad: each frame and arm has a size drawn evenly up to
    `spread` and a normal direction.

    Grippers, and all frames from `untouched` on, when a body may be in the hand, have no offset."""
    out = list[Floats]()
    for chain in planner_for(embodiment).chains.values():
        joints = len(chain.home)
        size = rng.uniform(0, spread, (frames, 1))
        out += [size * rng.normal(size=(frames, joints)), np.zeros((frames, 1))]
    offsets = np.concatenate(out, 1)
    offsets[untouched:] = 0
    return offsets


def disturbed(state: State, embodiment: str, offsets: Floats) -> State:
    """The state with its arm joints off by `offsets` (T,A) and its tools where forward kinematics
    says they are then."""
    tools, first = state.tools.copy(), 0
    for k, chain in enumerate(planner_for(embodiment).chains.values()):
        arm = slice(first, first + len(chain.home))
        q = state.joints[:, arm]
        tools[:, k, :3] += fk_batch(chain, q + offsets[:, arm])[:, :3] - fk_batch(chain, q)[:, :3]
        first += len(chain.home) + 1
    return replace(state, joints=state.joints + offsets, tools=tools)
