"""The lists that `domino-data tasks`, `objects`, `embodiments` and `motions` print, by name."""

import io
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.data.atomic import write_atomic
from pipeline.motion.contract import MotionRequest, NoMotion, Streams
from pipeline.motion.models import MODELS, levels_of
from pipeline.motion.workspace import Workspace
from pipeline.poses import transform, yawed
from pipeline.tasks import TASKS
from pipeline.tasks.contract import Draw
from pipeline.tasks.layout import families_of
from pipeline.world import robots
from pipeline.world.cameras import cameras_of
from pipeline.world.objects.contract import FAMILIES
from pipeline.world.robots.contract import Arm, arm_limits, arm_poses, link_poses

REACH_SAMPLES, REACH_STEPS, REACH_ROUNDS = 2000, 33, 6

EXAMPLE = MotionRequest(
    *(1, 0.1, 4.0, yawed((0.0, 0.0, 0.80), 0.0), Workspace(-0.35, 0.35, -0.25, 0.25)),
    radius=0.03,
    height=0.06,
    tail=0.25,
    floor=0.74,
)
"""The motions that are drawn: alpha 0.1 m/s, 4 s to a meeting 6 cm above the table."""

DRAWN = 5


def list_tasks() -> list[dict[str, Any]]:
    out = []
    for name, task in sorted(TASKS.items()):
        rng = np.random.default_rng(0)
        paragraph = " ".join((type(task).__doc__ or "").strip().split("\n\n")[0].split())
        out.append(
            {
                "name": name,
                "suite": task.suite,
                "motion": task.motion,
                "category": task.category,
                "objects": [p.name for p in task.layout(Draw(rng, rng))],
                "step_limit": task.step_limit,
                "target": task.target,
                "manipulated": task.manipulated,
                "description": paragraph.split(". ")[0].rstrip("."),
            }
        )
    return out


def list_objects(names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """The instance of seed 0 of each family: m, kg, frames x y z qw qx qy qz, and the tasks that
    draw it."""
    out = {}
    for name in names:
        one = FAMILIES[name].draw(np.random.Generator(np.random.Philox(0)))
        shape, frames = one.shape(), one.frames()
        out[name] = {
            "noun": one.words().noun,
            "size": np.ptp(shape.aabb(), axis=0).round(4).tolist(),
            "mass": round(shape.mass, 4),
            "parameters": list(vars(one)),
            "frames": {label: p.round(5).tolist() for label, p in frames.points.items()},
            "grasps": dict(Counter(g.kind for g in frames.grasps)),
            "tasks": [task for task in sorted(TASKS) if name in families_of(TASKS[task])],
        }
    return out


def list_robots() -> list[dict[str, Any]]:
    out = []
    for name in robots.MODELS:
        e = robots.get_embodiment(name)
        limits = {
            f"{side}_{joint.name}": [joint.lower, joint.upper]
            for side, arm in e.arms.items()
            for joint in arm.joints
            if joint.name in arm.arm_joints
        }
        out.append(
            {
                "name": name,
                "aliases": list(e.aliases),
                "dof": len(e.vector_names),
                "joints": list(e.vector_names),
                "limits": limits,
                "reach": {side: round(reach(arm), 3) for side, arm in e.arms.items()},
                "max_opening": {side: arm.gripper.max_opening for side, arm in e.arms.items()},
                "cameras": [c.name for c in cameras_of(e)],
            }
        )
    return out


def reach(arm: Arm) -> float:
    """Farthest distance (m) of the tcp from the origin of the arm's first joint, within the joint
    limits: the best of a fixed sample of configurations, improved joint by joint."""
    first = next(j for j in arm.joints if j.name == arm.arm_joints[0])
    shoulder = arm_poses(arm, arm.home)[first.child][:3]  # which no joint moves

    def distance(q: np.ndarray) -> np.ndarray:
        poses = link_poses(arm, dict(zip(arm.arm_joints, q.T, strict=True)))
        return np.linalg.norm(transform(poses[arm.hand], arm.tcp[:3]) - shoulder, axis=-1)

    lower, upper = arm_limits(arm).T
    sample = np.random.default_rng(0).uniform(lower, upper, (REACH_SAMPLES, len(lower)))
    best = sample[np.argmax(distance(sample))]
    for _ in range(REACH_ROUNDS):
        for i in range(len(best)):
            rows = np.repeat(best[None], 1 + REACH_STEPS, 0)
            rows[1:, i] = np.linspace(lower[i], upper[i], REACH_STEPS)
            best = rows[np.argmax(distance(rows))]
    return float(distance(best[None])[0])


def list_motions() -> list[dict[str, Any]]:
    return [
        {
            "name": name,
            "version": MODELS[name].version,
            "levels": {number: level.text for number, level in levels_of(name).items()},
            "tasks": sorted(task.name for task in TASKS.values() if task.motion == name),
        }
        for name in sorted(MODELS)
    ]


def write_paths(page: Path) -> None:
    """Write a PNG with paths of every model by level, from above and from the side."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    names = sorted(MODELS)
    figure = Figure(figsize=(2.6 * len(names), 5.2), dpi=80, layout="constrained")
    axes = figure.subplots(2, len(names), squeeze=False)
    for column, name in enumerate(names):
        above, beside = axes[:, column]
        above.set_title(name, fontsize=10)
        for axis, k, label in ((above, 1, "y (m)"), (beside, 2, "z (m)")):
            for number, level in MODELS[name].levels.items():
                for path in _paths(name, number):
                    axis.plot(path[:, 0], path[:, k], color=level.colour, lw=1.0, alpha=0.8)
            axis.plot(*np.asarray(EXAMPLE.end_pose)[[0, k]], ".", color="#111827", ms=4)
            axis.set_aspect("equal", adjustable="datalim")
            axis.tick_params(labelsize=6)
            axis.set_ylabel(label, fontsize=7)
        beside.set_xlabel("x (m)", fontsize=7)
    buffer = io.BytesIO()
    FigureCanvasAgg(figure).print_png(buffer, metadata={"Software": None})
    write_atomic(page, buffer.getvalue())


def _paths(name: str, level: int) -> list[np.ndarray]:
    paths: list[np.ndarray] = []
    for seed in range(DRAWN):
        keys = ([seed, level], [seed, level, 1])
        asked = replace(EXAMPLE, level=level)
        try:
            motion = MODELS[name].draw(asked, Streams(*map(np.random.default_rng, keys)))
        except NoMotion:
            continue
        paths.append(motion.pose(np.linspace(0.0, asked.duration, 120))[:, :3])
    return paths
