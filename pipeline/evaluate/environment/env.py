"""The gymnasium environment, one control period a step: docs/reinforcement_learning.md."""

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from pipeline.data.clock import DEFAULT_FPS
from pipeline.data.recipe.model import Cell
from pipeline.data.setup import Setup
from pipeline.data.spec import EpisodeSpec
from pipeline.evaluate.actions import ToolPoses, check_action, joint_limits, pose_action_names
from pipeline.evaluate.policies.policy import observe
from pipeline.evaluate.scenes.benchmark import frozen_scenes
from pipeline.evaluate.scenes.case import UNSEEN, Case, blind, setup_of
from pipeline.evaluate.scenes.manifests import TRAINING, case_of_seed, check_case, first_seed
from pipeline.evaluate.scenes.trial import (
    SUCCESS,
    TIME_LIMIT,
    Eyes,
    Trial,
    instruction_now,
    instruction_of,
)
from pipeline.evaluate.scoring.metrics import score
from pipeline.motion.models import levels_of
from pipeline.poses import Floats32, Pixels
from pipeline.tasks import TASKS
from pipeline.tasks.layout import can_do
from pipeline.world.robots import get_embodiment

from .observation import NOTHING, Meter, PolicyView, Shaped, StateView, TaskProgress

ACTIONS = ("joint", "ee", "delta_ee")
OBSERVATIONS = ("policy", "state")
REWARDS = ("score", "dense")


class DominoEnv(gymnasium.Env[Any, Floats32]):
    """One task x embodiment x level x alpha x domain (docs/reinforcement_learning.md). `setup` is
    a Setup, keys of one, or the directory of a dataset.

    Observation "policy": "agent_pos" (A,), "instruction"; "pixels" (H,W,3) uint8 by camera; by the
    setup "depth" (H,W) uint16 mm, "segmentation" (H,W) uint8, "pointcloud" (N,6). "state": one
    vector (N,) with `state_names`. Numbers beyond the spaces are cut.

    Action "joint" (A,): drive targets at the end of the period. "ee" (8S,): per arm a tool pose (x,
    y, z, qw, qx, qy, qz; world) and a gripper value; "delta_ee" is relative to the measured pose.

    Reward "score": the manipulation score (0-100) at the end. "dense": 1 at a success plus the
    change of a potential (Meter); the step limit is then `terminated`, as `time_left` shows it.

    `scenes=N` draws from N scenes that the expert solves, once a process; with 0 a reset without a
    seed runs the expert on a new scene. With a `benchmark` seed n takes its frozen scene n, and a
    reset without a seed the next one. Raises ValueError, RecipeError."""

    metadata = {  # noqa: RUF012
        "render_modes": ["rgb_array"],
        "render_fps": DEFAULT_FPS,
    }

    def __init__(
        self,
        task: str,
        embodiment: str = "aloha-agilex",
        level: int = 1,
        alpha: float = 0.1,
        domain: str = "clean",
        *,
        setup: Setup | Mapping[str, Any] | str | Path = UNSEEN,
        actions: str = "joint",
        observations: str = "policy",
        reward: str = "score",
        discount: float = 0.99,
        scenes: int = 0,
        benchmark: str = "",
        instructions: str = "unseen",
        render_mode: str | None = None,
    ) -> None:
        kinds = {
            "actions": (actions, ACTIONS),
            "observations": (observations, OBSERVATIONS),
            "reward": (reward, REWARDS),
        }
        for name, (value, known) in kinds.items():
            if value not in known:
                raise ValueError(f"{name} {value!r} is unknown: choose {', '.join(known)}")
        if not isinstance(scenes, int) or scenes < 0:
            raise ValueError(f"scenes {scenes!r}: give a whole number")
        if benchmark and scenes:
            raise ValueError("scenes and benchmark: give one of the two")
        setup = setup_of(setup)
        if level not in (levels := levels_of(TASKS[task].motion)):
            known = ", ".join(map(str, levels))
            raise ValueError(f"level {level!r} is unknown: {TASKS[task].motion} has {known}")
        robot = get_embodiment(embodiment)
        if not can_do(TASKS[task], robot.sides):
            raise ValueError(f"task {task!r}: {robot.name} has no arm for it: use two arms")
        spec = EpisodeSpec(task, robot.name, level, alpha, domain, 0, 0)
        self._cell = Cell.of(spec)
        self.setup = setup if observations == "policy" else blind(setup)
        self.task, self._split, self.render_mode = task, instructions, render_mode
        self.fps, self.metadata = setup.fps, self.metadata | {"render_fps": setup.fps}
        limits = joint_limits(robot)
        self.action_names = limits.names if actions == "joint" else pose_action_names(robot)
        low, high = limits.lower, limits.upper
        if actions != "joint":
            lowest = 0.0 if actions == "ee" else -2.0
            low = np.array([-2.0, -2.0, lowest, -1.0, -1.0, -1.0, -1.0, 0.0] * len(robot.sides))
            high = np.array([2.0, 2.0, 2.0, 1.0, 1.0, 1.0, 1.0, 1.0] * len(robot.sides))
        self.action_space = gymnasium.spaces.Box(low.astype(np.float32), high.astype(np.float32))
        self._view = (
            PolicyView(robot, setup) if observations == "policy" else StateView(robot, TASKS[task])
        )
        self.state_names: tuple[str, ...] = getattr(self._view, "names", ())
        self.observation_space: gymnasium.Space[Any] = self._view.space
        if reward == "dense" and not 0 < discount <= 1:
            raise ValueError(f"discount {discount!r}: give a number above 0 and at most 1")
        self._discount = discount if reward == "dense" else None
        self._measures = reward == "dense" or observations == "state"
        self._scenes = scenes
        self._frozen = frozen_scenes(benchmark, self._cell) if benchmark else ()
        self._next = 0
        self._trial: Trial | None = None
        self._eyes: Eyes | None = None
        self._poses, self._relative = actions != "joint", actions == "delta_ee"
        self._tools: ToolPoses | None = None
        self.task_description = ""
        self.case: Case | None = None
        """The scene of the episode, for evaluators: no policy may receive it."""

    @property
    def trial(self) -> Trial:
        if self._trial is None:
            raise RuntimeError("reset the environment before it is used")
        return self._trial

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Seed n is its scene, or that of the next derived seed that is solved. Raises NoCase,
        OtherCase."""
        super().reset(seed=seed)
        case = (options or {}).get("case") or self._draw_case(seed)
        check_case(case, self._cell, self.setup)
        self.close()
        scene = case.scene(self.setup)
        self._trial = Trial(scene, case.target_motion, self.setup)
        self.task_description = instruction_of(scene, self._split)
        if self.setup.cameras:
            self._eyes = Eyes(scene, self.setup)
        elif self.render_mode:
            self._eyes = Eyes(scene, self.setup.override({"cameras": ["head"]}))
        if self._poses:  # the randomized domain and the setup move the bases
            self._tools = ToolPoses(scene.embodiment)
        self.case = case
        self._meter = Meter(self._trial) if self._measures else None
        progress = self._meter.measure() if self._meter else NOTHING
        discount = self._discount
        self._shaped = None if discount is None else Shaped(discount, progress.potential)
        info = {"is_success": False, "task_description": self.task_description}
        return self._observe(progress), info

    def step(self, action: Floats32) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """One control period. Raises ActionError for an action of another shape or that is not
        finite."""
        trial, info = self.trial, dict[str, Any]()
        values = check_action(action, len(self.action_names))
        if self._tools is not None:
            simulation = trial.simulation
            tcps = [simulation.tcp(side) for side in simulation.embodiment.sides]
            tools = np.stack(tcps) if self._relative else None
            values, info["unreachable"] = self._tools.joints(values, simulation.command, tools)
        trial.advance(values)
        info["is_success"] = trial.ending == SUCCESS
        progress = self._meter.measure() if self._meter else NOTHING
        reward = self._shaped.reward(progress.potential, trial.ending) if self._shaped else 0.0
        if trial.ending:
            result = score(trial)
            reward = reward if self._shaped else result.manipulation_score
            info |= {"ending": trial.ending, "score": asdict(result)}
        truncated = trial.ending == TIME_LIMIT and self._shaped is None
        over = bool(trial.ending) and not truncated
        return self._observe(progress), reward, over, truncated, info

    def render(self) -> Pixels | None:
        if self.render_mode is None or self._eyes is None:
            return None
        return next(iter(self._eyes.look(self.trial.recorder).images.values()))

    def close(self) -> None:
        if self._eyes is not None:
            self._eyes.close()
        self._eyes = None

    def _observe(self, progress: TaskProgress) -> Any:
        eyes = self._eyes if self.setup.cameras else None
        now = instruction_now(self.trial, self._split, self.task_description)
        seen = observe(self.trial, eyes, now)
        return self._view.observe(self.trial, seen, progress)

    def _draw_case(self, seed: int | None) -> Case:
        if self._frozen:
            number = self._next if seed is None else seed
            self._next = number + 1
            return self._frozen[number % len(self._frozen)]
        if self._scenes:
            seed = first_seed(TRAINING) + int(self.np_random.integers(self._scenes))
        drawn = int(self.np_random.integers(1 << 31)) if seed is None else seed
        return case_of_seed(self._cell, drawn, self.setup)
