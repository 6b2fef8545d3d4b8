"""One task as LeRobot's evaluation wants it: index -> admitted scene, rewards that sum to MS, a
`_max_episode_steps`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from pipeline.data.clock import at_rate
from pipeline.data.names import exported_names
from pipeline.data.recipe.model import Cell
from pipeline.data.setup import Setup
from pipeline.evaluate.environment.env import DominoEnv
from pipeline.evaluate.scenes.benchmark import frozen_scenes
from pipeline.evaluate.scenes.case import UNSEEN, Case
from pipeline.evaluate.scenes.manifests import Manifests, inline
from pipeline.tasks import TASKS
from pipeline.world.robots import get_embodiment


@dataclass(frozen=True)
class Scenes:
    """Which scenes a task is tried on: episode n, LeRobot's seed `first_seed` + n, is the n-th
    frozen one of the `benchmark`, or without one the n-th admitted one of the protocol."""

    cell: Cell
    manifests: Path
    protocol_seed: int = 0
    first_seed: int = 1000
    setup: Setup = UNSEEN
    benchmark: str = ""

    def case(self, seed: int) -> Case:
        """The scene of a seed; the expert runs if no manifest has it yet. Raises ValueError for a
        seed before the first, or one beyond the scenes of the benchmark."""
        index = seed - self.first_seed
        if index < 0:
            raise ValueError(
                f"seed {seed} comes before the first, {self.first_seed}: set env.first_seed to"
                " --seed"
            )
        if self.benchmark:
            frozen = frozen_scenes(self.benchmark, self.cell)
            if index >= len(frozen):
                raise ValueError(
                    f"benchmark {self.benchmark} has {len(frozen)} scenes of {self.cell.path}:"
                    f" set eval.n_episodes to {len(frozen)} at most"
                )
            return frozen[index]
        manifests = Manifests(self.manifests, self.protocol_seed, self.setup)
        return manifests.admitted([self.cell], index + 1, inline)[self.cell][index]


class DominoTask(gymnasium.Env[dict[str, Any], NDArray[np.float32]]):
    """A task of one cell. Nothing is simulated or drawn before the first reset.

    Observation: "pixels" {exported camera: (H,W,3) uint8}, "agent_pos" (A,) float32. The reward is
    0 until the episode ends. Then it is the route completion, and in one more step, in which
    nothing moves, the manipulation score minus that; where the two are equal there is no such step.
    A reset without a seed goes on with the next scene.
    """

    metadata = DominoEnv.metadata

    def __init__(self, scenes: Scenes) -> None:
        cell, self._scenes, setup = scenes.cell, scenes, scenes.setup
        self._env = DominoEnv(
            cell.task, cell.embodiment, cell.level, cell.alpha, cell.domain, setup=setup
        )
        observed: Any = self._env.observation_space
        seen = observed["pixels"]
        self._names, self.metadata = (
            exported_names([name for name in setup.camera_names if name in seen.spaces], {}),
            self._env.metadata,
        )
        self.render_mode, self.task = "rgb_array", cell.task
        self._max_episode_steps = at_rate(TASKS[cell.task].step_limit, setup.fps) + 1
        self.action_space = self._env.action_space
        joints = gymnasium.spaces.Box(-np.inf, np.inf, (len(self._env.action_names),), np.float32)
        images: dict[str, gymnasium.Space[Any]] = {
            name: seen[camera] for camera, name in self._names.items()
        }
        self.observation_space = gymnasium.spaces.Dict(
            {"pixels": gymnasium.spaces.Dict(images), "agent_pos": joints}
        )
        self._next = scenes.first_seed
        self._last: dict[str, Any] = {}
        self._owed: tuple[float, bool, bool, dict[str, Any]] | None = None

    @property
    def task_description(self) -> str:
        """The instruction of the episode."""
        return self._env.task_description

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Start the episode of a seed."""
        super().reset(seed=seed)
        wanted = self._next if seed is None else seed
        self._next, self._owed = wanted + 1, None
        observation, info = self._env.reset(options={"case": self._scenes.case(wanted)})
        return self._convert(observation), info

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """One control period, or the closing step."""
        if self._owed is not None:
            (reward, terminated, truncated, info), self._owed = self._owed, None
            return self._last, reward, terminated, truncated, info
        observation, reward, terminated, truncated, info = self._env.step(action)
        seen = self._convert(observation)
        if terminated or truncated:
            completion = info["score"]["route_completion"]
            # vector environments stack what is in every info: only plain values
            info = {
                "is_success": info["is_success"],
                "manipulation_score": reward,
                "route_completion": completion,
            }
            if reward != completion:
                self._owed = (reward - completion, terminated, truncated, info)
                return seen, completion, False, False, info
        return seen, reward, terminated, truncated, {"is_success": False} | info

    def render(self) -> NDArray[np.uint8]:
        """The first camera's image of the last observation."""
        return next(iter(self._last["pixels"].values()))

    def close(self) -> None:
        """Free the renderer."""
        self._env.close()

    def _convert(self, observation: dict[str, Any]) -> dict[str, Any]:
        images = {name: observation["pixels"][camera] for camera, name in self._names.items()}
        self._last = {"pixels": images, "agent_pos": observation["agent_pos"]}
        return self._last


def vector_length(embodiment: str) -> int:
    """Numbers in the joint vector of a robot."""
    return len(get_embodiment(embodiment).vector_names)
