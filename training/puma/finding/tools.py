"""Where the tools are: by the joints of a frame, at the first touch, and off the path that was
recorded."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.data.names import SIDES
from pipeline.planning.kinematics import fk_batch
from pipeline.planning.planner import planner_for
from pipeline.poses import inverse, transform
from training.puma.config import Config
from training.puma.corpus.cache import Cache
from training.puma.corpus.samples import Arrays
from training.puma.preprocess import Preprocessing

CLEAN = 1 / 3
"""Share of the samples whose joints stay as they were measured."""

NEAR = 0.12
"""Distance (m) on the table from the second body within which a hand may hold it."""


def tools_of(embodiment: str, joints: NDArray[Any]) -> NDArray[np.float32]:
    """World positions (N,2,3) m of the tools for joints (N,A); zeros for an arm that is not
    there."""
    out, first = np.zeros((len(joints), len(SIDES), 3), np.float32), 0
    for side, chain in planner_for(embodiment).chains.items():
        out[:, SIDES.index(side)] = fk_batch(
            chain, np.asarray(joints[:, first : first + len(chain.home)], float)
        )[:, :3]
        first += len(chain.home) + 1
    return out


def touch_points(cache: Cache) -> NDArray[np.float64]:
    """Positions (N,2,3) m of the tools in the target's frame at the first touch of its episode, at
    the end without one."""
    arrays, out = cache.arrays, list[NDArray[np.float64]]()
    for start, length in zip(cache.start, cache.length, strict=True):
        free = arrays["free"][start : start + length]
        at = start + min(int(np.count_nonzero(free)), length - 1)
        [tools] = tools_of(cache.rows[0].embodiment, arrays["state"][at : at + 1])
        target = np.asarray(arrays["target"][at], float)
        out.append(np.repeat(transform(inverse(target), tools)[None], length, 0))
    return np.concatenate(out)


@dataclass(frozen=True)
class Disturbance:
    """Moves measured arm joints off their path by up to about `spread` rad, and the tools with
    them; shuffles the grippers.

    Those of a hand near the second body stay: it may hold it.

    A gripper that closes in the first frames tells which arm the expert has chosen. A network that
    may read this follows its own first guess, made before the target's velocity is known.
    """

    spread: float
    config: Config
    preprocessing: Preprocessing

    def apply(self, arrays: Arrays, rng: np.random.Generator) -> None:
        """Change samples of a target that has not been touched: `state`, `tools`, and `action`
        where it counts from the joints.

        Each has a size drawn evenly and a normal direction.
        """
        prep, count = self.preprocessing, len(arrays["state"])
        arms = np.array([not name.endswith("gripper") for name in prep.names])
        size = (
            rng.uniform(0, self.spread, (count, 1))
            * (rng.random((count, 1)) > CLEAN)
            * arrays["free"][:, None]
        )
        offsets = size * rng.normal(size=(count, len(arms))) * arms
        arrays["state"] = (arrays["state"] + offsets / prep.state.spread).astype(np.float32)
        free = np.flatnonzero(arrays["free"] & ~self._at_second(arrays))
        for gripper in np.flatnonzero(~arms):
            arrays["state"][free, gripper] = arrays["state"][rng.permutation(free), gripper]
        arrays["tools"] = tools_of(prep.embodiments[0], prep.state.backward(arrays["state"]))
        if self.config.model.offsets:
            arrays["action"] = (arrays["action"] - (offsets / prep.action.spread)[:, None]).astype(
                np.float32
            )

    def _at_second(self, arrays: Arrays) -> NDArray[np.bool_]:
        """Whether a hand is near the second body (B,): what it does there, its gripper tells."""
        track = self.config.model.track
        if track is None or track.bodies == 1:
            return np.zeros(len(arrays["track"]), bool)
        second = arrays["track"].reshape(len(arrays["track"]), track.bodies, -1)[:, 1, :2]
        ways = np.linalg.norm(arrays["tools"][:, :, :2] - second[:, None], axis=-1)
        return ways.min(1) < NEAR
