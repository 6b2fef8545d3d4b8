"""RoboTwin's deploy_policy.py files, unmodified: --policy robotwin:policy/ACT?ckpt_dir=...

usr_args are the keys of deploy_policy.yml, then the options of the name, then left_arm_dim and
right_arm_dim."""

import importlib
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pipeline.data.names import SIDES
from pipeline.data.parsing import read_yaml
from pipeline.evaluate.actions import ActionError, ToolPoses, check_action
from pipeline.planning.planner import planner_of
from pipeline.poses import Floats, compose, pose
from pipeline.world.robots import get_embodiment
from pipeline.world.robots.contract import Embodiment
from pipeline.world.robots.pairs import raised

from .files import PolicySettings, digest_of, parse_settings
from .policy import Observation, Policy, PolicyError, PolicyName, Start, foreign
from .turns import Turns

BEHIND_TCP = 0.12  # m; tool poses are this far behind the tool centre point, along its x axis

_TO_TCP, _FROM_TCP = pose([BEHIND_TCP, 0, 0]), pose([-BEHIND_TCP, 0, 0])


def robot_at(start: Start) -> Embodiment:
    """The episode's robot, with its bases where they stand."""
    robot = get_embodiment(start.embodiment, start.setup.layout)
    return raised(robot, start.lift) if start.lift else robot


class RobotwinRobot:
    def __init__(self, robot: Embodiment) -> None:
        self.planner, self._tools = planner_of(robot), ToolPoses(robot)
        arms = {side: robot.arms[side].arm_joints for side in robot.arms}
        self.arm_dims = {side: len(arms.get(side, ())) for side in SIDES}

    def tool_poses(self, joints: ArrayLike) -> dict[str, tuple[Floats, Floats]]:
        """The original's pose (7,) and the tcp's (7,) by arm, in the world."""
        parts = self.planner.split(np.asarray(joints, float))
        tcps = {side: self.planner.fk(side, q) for side, (q, _) in parts.items()}
        return {side: (compose(tcp, _FROM_TCP), tcp) for side, tcp in tcps.items()}

    def observation(self, seen: Observation, command: Floats) -> dict[str, Any]:
        """As `export --format robotwin` writes it, with `timestamp` (s): joints are the targets in
        force, `command` (A,), tool poses (7,) wxyz are measured."""
        joints: dict[str, Any] = {"vector": command.copy()}
        endpose: dict[str, Any] = {}
        tools = self.tool_poses(seen.joints)
        for side, (q, gripper) in self.planner.split(command).items():
            joints |= {f"{side}_arm": q.tolist(), f"{side}_gripper": gripper}
            endpose |= {f"{side}_endpose": tools[side][0].tolist(), f"{side}_gripper": gripper}
        return {
            "observation": {name: {"rgb": image} for name, image in seen.images.items()},
            "pointcloud": [],
            "joint_action": joints,
            "endpose": endpose,
            "instruction": seen.instruction,
            "timestamp": seen.time,
        }

    def joints(self, action: ArrayLike, kind: str, measured: Floats, command: Floats) -> Floats:
        """Joint targets (A,) of an action: `qpos` (A,), `ee` (8S,) tool poses, or `delta_ee` from
        the measured ones. Raises ActionError."""
        if kind == "qpos":
            return check_action(action, len(command))
        if kind not in ("ee", "delta_ee"):
            raise ActionError(f"action_type {kind!r} is unknown: choose qpos, ee or delta_ee")
        tools = np.stack([tool for tool, _ in self.tool_poses(measured).values()])
        relative_to = tools if kind == "delta_ee" else None
        values = check_action(action, 8 * len(tools))
        return self._tools.joints(values, command, relative_to, _TO_TCP)[0]


class TaskEnv:
    """TASK_ENV of eval. An action is one control period."""

    def __init__(
        self, robot: RobotwinRobot, start: Start, turns: Turns[Observation, Floats]
    ) -> None:
        self._robot, self._turns = robot, turns
        self._seen = turns.first()
        self._command = np.asarray(self._seen.joints, float)
        self.instruction, self.take_action_cnt, self.eval_success = start.instruction, 0, False

    def get_instruction(self) -> str:
        return self.instruction

    def get_obs(self) -> dict[str, Any]:
        return self._robot.observation(self._seen, self._command)

    def take_action(self, action: ArrayLike, action_type: str = "qpos") -> None:
        """Waits until its control period is over. Raises ActionError."""
        measured = np.asarray(self._seen.joints, float)
        self._command = self._robot.joints(action, action_type, measured, self._command)
        self._seen = self._turns.after(self._command)
        self.take_action_cnt += 1

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"TASK_ENV has no {name} here: see docs/policy_server.md")


FILE = "deploy_policy.py"


class RobotwinPolicy:
    """The first episode, which knows the robot, makes the model."""

    def __init__(self, settings: PolicySettings) -> None:
        self._settings, self._path = settings, settings.path
        folder = _directory_of(settings)
        if str(folder.parent) not in sys.path:
            sys.path.insert(0, str(folder.parent))  # the package may import its neighbours
        with foreign(f"{folder / FILE}: cannot be loaded"):
            self._code = importlib.import_module(f"{folder.name}.deploy_policy")
        for function in ("get_model", "eval"):
            if not callable(getattr(self._code, function, None)):
                raise PolicyError(f"{self._path}: {FILE} has no function {function}")
        self._model: Any = None
        self._embodiment = ""
        self._turns: Turns[Observation, Floats] | None = None
        self.inferences = 0

    def reset(self, start: Start) -> None:
        if self._turns is not None:
            self._turns.end()
        robot = RobotwinRobot(robot_at(start))
        if self._embodiment != start.embodiment:
            arguments = _user_arguments(self._settings, robot.arm_dims)
            # what cannot be loaded now cannot be loaded for any other episode
            with foreign(f"{self._path}: get_model failed"):
                self._model = self._code.get_model(arguments)
            self._embodiment = start.embodiment
        reset_model = getattr(self._code, "reset_model", None)
        if callable(reset_model):
            reset_model(self._model)

        def play(turns: Turns[Observation, Floats]) -> None:
            env = TaskEnv(robot, start, turns)
            while True:
                before = env.take_action_cnt
                self.inferences += 1
                self._code.eval(env, self._model, env.get_obs())
                if env.take_action_cnt == before:
                    raise PolicyError(f"{self._path}: eval returned without taking an action")

        self._turns = Turns(play)

    def act(self, observation: Observation) -> ArrayLike:
        if self._turns is None:
            raise PolicyError(f"{self._path}: asked before reset")
        if (action := self._turns.ask(observation)) is None:
            raise PolicyError("the policy's code has ended: it is asked again at the next episode")
        return action


def _directory_of(settings: PolicySettings) -> Path:
    path = Path(settings.path).resolve()
    folder = path.parent if path.name == FILE else path
    if not (folder / FILE).is_file():
        raise PolicyError(f"--policy {settings.kind}:{settings.path}: there is no {FILE}")
    if not folder.name.isidentifier():
        what = f"{folder.name!r} is no name of a Python package: rename it"
        raise PolicyError(f"--policy {settings.kind}:{settings.path}: {what}")
    return folder


def _user_arguments(settings: PolicySettings, arm_dims: dict[str, int]) -> dict[str, Any]:
    path = _directory_of(settings) / "deploy_policy.yml"
    values = (read_yaml(path) if path.exists() else None) or {}
    if not isinstance(values, dict):
        raise PolicyError(f"{path}: is no map")
    return values | settings.options | {f"{side}_arm_dim": dim for side, dim in arm_dims.items()}


class RobotwinForm:
    def name(self, text: str) -> PolicyName:
        settings = parse_settings(text)
        folder = _directory_of(settings)
        kinds = (".py", ".yml", ".yaml", ".json")
        files = sorted(p for p in folder.rglob("*") if p.suffix in kinds)
        label = f"robotwin:{folder.name}@{digest_of(files)}{settings.text}"
        return PolicyName(settings.at(folder), label)

    def make(self, text: str) -> Policy:
        return RobotwinPolicy(parse_settings(text))
