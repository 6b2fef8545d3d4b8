"""XPolicyLab's Model classes: --policy xpolicylab:FILE.py?key=value

`get_action()` returns an action (A,), a chunk (H,A) of joint targets, or dicts of format v1.0."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pipeline.data.names import HEAD, LEFT_WRIST, OBSERVER, RIGHT_WRIST
from pipeline.evaluate.actions import ActionError
from pipeline.poses import Floats
from pipeline.world.robots.contract import Embodiment

from .files import digest_of, module_of, parse_settings
from .policy import Observation, Policy, PolicyError, PolicyName, Start, chunk_of
from .robotwin import RobotwinRobot, robot_at

METHODS = ("reset", "update_obs", "get_action")
CAMERAS = {
    HEAD: "cam_head",
    LEFT_WRIST: "cam_left_wrist",
    RIGHT_WRIST: "cam_right_wrist",
    OBSERVER: "cam_third_view",
}


class XPolicyLabRobot:
    """XPolicyLab's format v1.0, as in files of `export --format xpolicylab`."""

    def __init__(self, robot: Embodiment) -> None:
        self._robotwin = RobotwinRobot(robot)
        self._sides = robot.sides

    def observation(self, seen: Observation, command: Floats, fps: int) -> dict[str, Any]:
        """Images (H,W,3); joints of `state` are the targets in force, `command` (A,), poses are
        measured."""
        targets = self._robotwin.planner.split(command)
        state: dict[str, Any] = {}
        for side, (tool, tcp) in self._robotwin.tool_poses(seen.joints).items():
            state |= {
                f"{side}_arm_joint_state": targets[side][0].astype(np.float32),
                f"{side}_ee_joint_state": np.array([targets[side][1]], np.float32),
                f"{side}_ee_pose": tool.astype(np.float32),
                f"{side}_tcp_pose": tcp.astype(np.float32),
            }
        vision = {
            CAMERAS.get(name, name): {"color": image, "shape": image.shape[:2]}
            for name, image in seen.images.items()
        }
        for name, depth in seen.depth.items():
            vision[CAMERAS.get(name, name)]["depth"] = depth
        return {
            "data_format_version": "v1.0",
            "instruction": seen.instruction,
            "instructions": [seen.instruction],
            "env_idx": 0,
            "vision": vision,
            "state": state,
            "additional_info": {"frequency": fps},
        }

    def chunk(self, answer: Any, measured: Floats, command: Floats) -> Floats:
        """Joint targets (H,A). Raises ActionError."""
        steps: Any = [answer] if isinstance(answer, Mapping) else answer
        if not isinstance(steps, list | tuple) or not steps or not isinstance(steps[0], Mapping):
            return chunk_of(steps, len(command))
        rows = list[Floats]()
        for step in steps:
            try:
                kind = "qpos" if any(name.endswith("_arm_joint_state") for name in step) else "ee"
                keys = ("arm_joint_state" if kind == "qpos" else "ee_pose", "ee_joint_state")
                names = [f"{side}_{key}" for side in self._sides for key in keys]
                parts = [np.asarray(step[name], float).ravel() for name in names]
            except (AttributeError, KeyError, TypeError, ValueError) as error:
                raise ActionError(f"a step of the answer has no numbers {error}") from error
            command = self._robotwin.joints(np.concatenate(parts), kind, measured, command)
            rows.append(command)
        return np.stack(rows)


class XPolicyLabPolicy:
    def __init__(self, model: Any) -> None:
        self._model = model
        self._episode: tuple[Start, XPolicyLabRobot] | None = None
        self._command: Floats | None = None

    def reset(self, start: Start) -> None:
        self._episode, self._command = (start, XPolicyLabRobot(robot_at(start))), None
        self._model.reset()

    def act(self, observation: Observation) -> ArrayLike:
        if self._episode is None:
            raise PolicyError("asked before reset")
        start, robot = self._episode
        measured = np.asarray(observation.joints, float)
        # a chunk is executed whole: its last row is in force when the next observation is made
        command = measured if self._command is None else self._command
        self._model.update_obs(robot.observation(observation, command, start.fps))
        chunk = robot.chunk(self._model.get_action(), measured, command)
        self._command = chunk[-1]
        return chunk


class XPolicyLabForm:
    def name(self, text: str) -> PolicyName:
        settings = parse_settings(text)
        path = Path(settings.path).resolve()
        label = f"xpolicylab:{path.name}@{digest_of([path])}{settings.text}"
        return PolicyName(settings.at(path), label)

    def make(self, text: str) -> Policy:
        settings = parse_settings(text)
        kind = getattr(module_of(Path(settings.path)), "Model", None)
        if not isinstance(kind, type):
            raise PolicyError(f"{settings.path}: has no class Model")
        if missing := [name for name in METHODS if not callable(getattr(kind, name, None))]:
            raise PolicyError(f"{settings.path}: Model has no method {missing[0]}")
        return XPolicyLabPolicy(kind(settings.options))
