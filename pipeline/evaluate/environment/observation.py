"""Observations and their bounded space."""

import string
from collections.abc import Iterable
from typing import Any, NamedTuple

import gymnasium
import numpy as np

from pipeline.data.setup import Setup
from pipeline.evaluate.actions import POSE_NAMES, joint_limits
from pipeline.evaluate.policies.policy import Observation
from pipeline.evaluate.scenes.trial import SUCCESS, Trial
from pipeline.poses import Floats, Floats32
from pipeline.tasks import Draw, Task
from pipeline.tasks.contract import TRACKING
from pipeline.world.cameras import setup_cameras
from pipeline.world.drawing.sensing import HIGHEST, POINTS
from pipeline.world.physics.body import TABLE_HALF, TABLE_TOP
from pipeline.world.robots.contract import Embodiment

NEARNESS = 3.0  # 1/m; a distance d is worth 1 - tanh(3 d): 10 cm are worth 0.71

LIFT = 0.05  # m


class TaskProgress(NamedTuple):
    """Each number is in 0-1; their mean is the potential."""

    approach: float
    hold: float
    lift: float
    place: float

    @property
    def potential(self) -> float:
        return sum(self) / len(self)


NOTHING = TaskProgress(0.0, 0.0, 0.0, 0.0)


class Meter:
    """Measures the progress of a trial once a control period.

    - approach: nearness of the nearest acting tool to the handled body; 1 once it was held
    - hold: 1 once both fingers of an acting arm touched it (one finger if the target is pressed)
    - lift: its greatest rise over LIFT
    - place: from the first touch on, the share of success conditions that hold; if something is
      brought to another body, the mean of that and their nearness"""

    def __init__(self, trial: Trial) -> None:
        scene = trial.scene
        task, bodies = scene.task, scene.bodies.items()
        loose = [name for name, b in bodies if not b.inside and name not in scene.clutter]
        self._trial, self._handled = trial, task.manipulated
        self._sides = sorted(set(scene.arms.values()))
        self._pressed = task.category == TRACKING and task.manipulated == task.target
        others = [task.target, *loose] if task.category == TRACKING else loose
        self._goal = next((name for name in others if name != task.manipulated), "")
        self._held = False

    def measure(self) -> TaskProgress:
        trial = self._trial
        simulation, outcome = trial.simulation, trial.scene.outcome(trial.log())
        at = simulation.pose(self._handled)[:3]
        touch = outcome.touched if self._pressed else outcome.holds
        self._held = self._held or any(touch(side, self._handled) for side in self._sides)
        nearest = min(float(np.linalg.norm(simulation.tcp(side)[:3] - at)) for side in self._sides)
        rise = 0.0 if self._pressed else outcome.highest_rise(self._handled)
        lift, place = min(1.0, max(0.0, rise / LIFT)), 0.0
        if simulation.touched_by:
            conditions = trial.conditions()
            place = sum(conditions.values()) / len(conditions)
            if self._goal:
                apart = float(np.linalg.norm(simulation.pose(self._goal)[:2] - at[:2]))
                place = (place + near(apart)) / 2
        return TaskProgress(1.0 if self._held else near(nearest), float(self._held), lift, place)


class Shaped:
    def __init__(self, discount: float, potential: float) -> None:
        self._discount, self._before = discount, potential

    def reward(self, potential: float, ending: str) -> float:
        """Every ending has the potential 0."""
        after = 0.0 if ending else potential
        before, self._before = self._before, after
        return float(ending == SUCCESS) + self._discount * after - before


def near(distance: float) -> float:
    return 1.0 - float(np.tanh(NEARNESS * distance))


Box = gymnasium.spaces.Box

SLACK = 0.1  # rad, m and share of a gripper by which a measured joint may overshoot its limits

FAR, FAST, SPIN = 3.0, 5.0, 20.0  # m, m/s and rad/s; larger numbers are cut to these

_TEXT = string.ascii_letters + string.digits + string.punctuation + " "


class PolicyView:
    def __init__(self, robot: Embodiment, setup: Setup) -> None:
        limits = joint_limits(robot)
        lower, upper = limits.lower - SLACK, limits.upper + SLACK
        self._joints = Box(lower.astype(np.float32), upper.astype(np.float32))
        parts: dict[str, gymnasium.Space[Any]] = {
            "agent_pos": self._joints,
            "instruction": gymnasium.spaces.Text(500, charset=_TEXT),
        }
        shapes = {c.name: (c.type.height, c.type.width) for c in setup_cameras(robot, setup)}
        for name, tail, kind, stored in (
            ("pixels", (3,), np.uint8, True),
            ("depth", (), np.uint16, setup.depth),
            ("segmentation", (), np.uint8, setup.segmentation),
        ):
            if shapes and stored:
                boxes = dict[str, gymnasium.Space[Any]]()
                for camera, shape in shapes.items():
                    boxes[camera] = Box(0, np.iinfo(kind).max, (*shape, *tail), kind)
                parts[name] = gymnasium.spaces.Dict(boxes)
        if setup.pointcloud:
            x, y = TABLE_HALF[:2]
            ends = ([-x, -y, 0, 0, 0, 0], [x, y, TABLE_TOP + HIGHEST, 1, 1, 1])
            low, high = (np.tile(np.array(end, np.float32), (POINTS, 1)) for end in ends)
            parts["pointcloud"] = Box(low, high)
        self.space = gymnasium.spaces.Dict(parts)

    def observe(self, trial: Trial, seen: Observation, progress: TaskProgress) -> dict[str, Any]:
        out: dict[str, Any] = {
            "agent_pos": _within(self._joints, seen.joints),
            "instruction": seen.instruction,
        }
        parts = {"pixels": seen.images, "depth": seen.depth, "segmentation": seen.segmentation}
        out |= {name: images for name, images in parts.items() if images}
        if seen.pointcloud is not None:
            out["pointcloud"] = seen.pointcloud
        return out


class StateView:
    def __init__(self, robot: Embodiment, task: Task) -> None:
        limits = joint_limits(robot)
        self._bodies = bodies_of(task)
        arms = robot.arms.items()
        self._joints = joints = [f"{side}_{name}" for side, arm in arms for name in arm.arm_joints]
        posed = (*(f"{side}_tool" for side in robot.sides), *self._bodies)
        parts: list[tuple[Iterable[str], Any, Any]] = [
            (limits.names, limits.lower - SLACK, limits.upper + SLACK),
            ([f"{name}_command" for name in limits.names], limits.lower, limits.upper),
            ([f"{name}_velocity" for name in joints], [-SPIN] * len(joints), [SPIN] * len(joints)),
            *(([f"{body}_{name}" for name in POSE_NAMES], *_POSES) for body in posed),
            ([f"{task.target}_v{axis}" for axis in "xyz"], [-FAST] * 3, [FAST] * 3),
            ([*TaskProgress._fields, "time_left"], [0.0] * 5, [1.0] * 5),
        ]
        self.names = tuple(name for names, _, _ in parts for name in names)
        ends = ([np.asarray(part[i], np.float32) for part in parts] for i in (1, 2))
        low, high = map(np.concatenate, ends)
        self.space = Box(low, high)

    def observe(self, trial: Trial, seen: Observation, progress: TaskProgress) -> Any:
        s = trial.simulation
        qpos, qvel = s.qpos()
        velocity = dict(zip(s.joint_names, qvel, strict=True))
        parts = [s.state_vector(qpos), s.command, [velocity[name] for name in self._joints]]
        parts += [s.tcp(side) for side in s.embodiment.sides]
        parts += [s.pose(name) for name in self._bodies]
        left = 1.0 - s.steps / trial.max_steps
        parts += [s.target_twist()[:3], progress, [left]]
        return _within(self.space, np.concatenate(parts))


_POSES = ([-FAR] * 3 + [-1.0] * 4, [FAR] * 3 + [1.0] * 4)


def bodies_of(task: Task) -> tuple[str, ...]:
    """The same in every scene; the target first."""
    placed = [p.name for p in task.layout(Draw(np.random.default_rng(0), np.random.default_rng(0)))]
    return (task.target, *(name for name in placed if name != task.target))


def _within(space: Box, values: Floats) -> Floats32:
    return np.minimum(np.maximum(values.astype(np.float32), space.low), space.high)
