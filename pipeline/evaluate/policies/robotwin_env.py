"""TASK_ENV as RoboTwin's deploy_policy.py files know it, over our environment."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pipeline.data.names import SIDES
from pipeline.evaluate.actions import ActionError, ToolPoses, check_action
from pipeline.evaluate.policies.policy import Observation, Start
from pipeline.evaluate.policies.turns import Turns
from pipeline.planning.planner import planner_of
from pipeline.poses import Floats, compose, pose
from pipeline.world.robots import get_embodiment

BEHIND_TCP = 0.12
"""m; the original's tool poses are this far behind the tool centre point, along its x axis."""

_TO_TCP, _FROM_TCP = pose([BEHIND_TCP, 0, 0]), pose([-BEHIND_TCP, 0, 0])


class RobotwinRobot:
    """Observations and actions of a robot in the original's form."""

    def __init__(self, embodiment: str) -> None:
        robot = get_embodiment(embodiment)
        self._planner, self._tools = planner_of(robot), ToolPoses(robot)
        self.arm_dims = {
            side: len(robot.arms[side].arm_joints) if side in robot.arms else 0 for side in SIDES
        }

    def observation(self, seen: Observation, command: Floats) -> dict[str, Any]:
        """observation/<camera>/rgb (H,W,3) uint8, joint_action/..., endpose/... (7,) wxyz,
        instruction, timestamp (s).

        `command` (A,) are the joint targets in force, which the original reports as joint_action
        and as grippers; tool poses are measured. Files of `export --format robotwin` hold the same.
        """
        measured, targets = (
            self._planner.split(np.asarray(seen.joints, float)),
            self._planner.split(command),
        )
        joints: dict[str, Any] = {"vector": command.copy()}
        endpose: dict[str, Any] = {}
        for side, (q, gripper) in targets.items():
            joints |= {f"{side}_arm": q.tolist(), f"{side}_gripper": gripper}
            tool = compose(self._planner.fk(side, measured[side][0]), _FROM_TCP)
            endpose |= {f"{side}_endpose": tool.tolist(), f"{side}_gripper": gripper}
        return {
            "observation": {name: {"rgb": image} for name, image in seen.images.items()},
            "pointcloud": [],
            "joint_action": joints,
            "endpose": endpose,
            "instruction": seen.instruction,
            "timestamp": seen.time,
        }

    def joints(self, action: ArrayLike, kind: str, measured: Floats, command: Floats) -> Floats:
        """Joint targets (A,) of an action of one of three kinds. Raises ActionError.

        `qpos` is (A,); `ee` (8S,) has a pose of the tool and the gripper per arm; `delta_ee` (8S,)
        the same with poses relative to the measured ones, in their own frames.
        """
        if kind == "qpos":
            return check_action(action, len(command))
        if kind not in ("ee", "delta_ee"):
            raise ActionError(f"action_type {kind!r} is unknown: choose qpos, ee or delta_ee")
        now = self._planner.split(measured)
        values = check_action(action, 8 * len(now)).copy()
        for i, side in enumerate(now):
            part = slice(8 * i, 8 * i + 7)
            given = pose(values[part][:3], _unit(values[part][3:], side))
            if kind == "delta_ee":
                given = compose(compose(self._planner.fk(side, now[side][0]), _FROM_TCP), given)
            values[part] = compose(given, _TO_TCP)
        return self._tools.joints(values, command)[0]


def _unit(quaternion: Floats, side: str) -> Floats:
    if np.linalg.norm(quaternion) < 1e-6:
        raise ActionError(f"the quaternion of the {side} tool is zero")
    return quaternion


class TaskEnv:
    """What eval(TASK_ENV, model, observation) is given. An action is executed in one control
    period."""

    def __init__(self, robot: RobotwinRobot, start: Start, turns: Turns) -> None:
        self._robot, self._start, self._turns = robot, start, turns
        self._seen = turns.first()
        self._command = np.asarray(self._seen.joints, float)
        self.instruction, self.take_action_cnt, self.eval_success = start.instruction, 0, False

    def get_instruction(self) -> str:
        """The instruction of the episode."""
        return self.instruction

    def get_obs(self) -> dict[str, Any]:
        """The observation now: see RobotwinRobot."""
        return self._robot.observation(self._seen, self._command)

    def take_action(self, action: ArrayLike, action_type: str = "qpos") -> None:
        """Execute an action and wait until its control period is over. Raises ActionError."""
        self._command = self._robot.joints(
            action, action_type, np.asarray(self._seen.joints, float), self._command
        )
        self._seen = self._turns.after(self._command)
        self.take_action_cnt += 1

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(
            f"TASK_ENV has no {name} here: only get_instruction, get_obs, take_action, instruction,"
            " take_action_cnt, eval_success"
        )
