"""This benchmark for vla-eval 0.8, which is not installed: docs/evaluation.md."""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from pipeline.data.clock import at_rate
from pipeline.data.setup import Setup
from pipeline.evaluate.environment.env import DominoEnv
from pipeline.evaluate.scenes.case import UNSEEN, setup_of
from pipeline.poses import Pixels
from pipeline.tasks import TASKS
from pipeline.world.robots import get_embodiment

type Message = dict[str, Any]
SCORES = ("route_completion", "manipulation_score")


def __getattr__(name: str) -> type:
    if name != "DominoBenchmark":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from vla_eval.benchmarks.base import StepBenchmark

    return type(name, (DominoEpisodes, StepBenchmark), {})


class DominoEpisodes:
    """Tasks of one level, alpha, domain and robot, in scenes of a `benchmark` (name or file).
    Raises KeyError, ValueError."""

    _last_result: Any  # of StepBenchmark

    render_backends: ClassVar[frozenset[str]] = frozenset({"gpu", "cpu"})

    def __init__(
        self,
        tasks: Sequence[str],
        embodiment: str = "aloha",
        level: int = 1,
        alpha: float = 0.1,
        domain: str = "clean",
        *,
        benchmark: str = "domino-v1",
        setup: Setup | Mapping[str, Any] | str = UNSEEN,
    ) -> None:
        super().__init__()
        self._names, self._setup = get_embodiment(embodiment).vector_names, setup_of(setup)
        self._tasks = [TASKS[task].name for task in tasks]
        self._cell, self._benchmark = (embodiment, level, alpha, domain), benchmark
        self._env: DominoEnv | None = None
        self._instruction = ""

    @classmethod
    def configure_render(cls, mode: str) -> dict[str, str]:
        return {}

    def get_tasks(self) -> list[Message]:
        return [{"name": task, "suite": "domino"} for task in self._tasks]

    def reset(self, task: Message) -> Message:
        """Start episode `episode_idx` of a task; its first observation. Raises BenchmarkError."""
        self.cleanup()
        self._env = DominoEnv(
            task["name"], *self._cell, setup=self._setup, benchmark=self._benchmark
        )
        observation, _ = self._env.reset(seed=task["episode_idx"])
        self._instruction = self._env.task_description
        return observation

    def step(self, action: Message) -> Any:
        from vla_eval.benchmarks.base import StepResult

        if self._env is None:
            raise RuntimeError("reset the benchmark before it is stepped")
        values = np.asarray(action.get("actions", action.get("action")), np.float64)
        observation, reward, terminated, truncated, info = self._env.step(
            values.reshape(-1).astype(np.float32)
        )
        return StepResult(observation, reward, terminated or truncated, info)

    def make_obs(self, raw_obs: Message, task: Message) -> Message:
        return {
            "images": dict(raw_obs.get("pixels", {})),
            "task_description": self._instruction,
            "state": np.asarray(raw_obs["agent_pos"], np.float32),
        }

    def get_step_result(self, step_result: Any) -> Message:
        score = step_result.info.get("score", {})
        success = bool(step_result.info.get("is_success", False))
        return {"success": success} | {name: score.get(name, 0.0) for name in SCORES}

    def get_metric_keys(self) -> dict[str, str]:
        return dict.fromkeys(("success", *SCORES), "mean")

    def get_action_spec(self) -> dict[str, Any]:
        return {"joints": self._joints()}

    def get_observation_spec(self) -> dict[str, Any]:
        from vla_eval.specs import IMAGE_RGB, LANGUAGE

        return {"image": IMAGE_RGB, "state": self._joints(), "language": LANGUAGE}

    def get_metadata(self) -> Message:
        longest = max(TASKS[task].step_limit for task in self._tasks)
        return {"max_steps": at_rate(longest, self._setup.fps), "action_names": list(self._names)}

    def get_hold_action(self, last_action: Message | None) -> Message:
        if last_action is not None:
            return last_action
        return {"actions": np.asarray(self._last_result.obs["agent_pos"], np.float32)}

    def render(self) -> Pixels | None:
        images = (self._last_result.obs or {}).get("pixels", {})
        return next(iter(images.values()), None)

    def cleanup(self) -> None:
        if self._env is not None:
            self._env.close()
        self._env = None

    def _joints(self) -> Any:
        from vla_eval.specs import DimSpec

        meaning = "radians, grippers 0 closed to 1 open: " + " ".join(self._names)
        return DimSpec("joints", len(self._names), "joint_positions", description=meaning)
