"""The lists that `domino-data` prints by name."""

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from pipeline.intake.objects.standing import instance_of
from pipeline.motion.models import MODELS, levels_of
from pipeline.tasks import TASKS
from pipeline.tasks.contract import Draw
from pipeline.tasks.layout import families_of
from pipeline.world import robots
from pipeline.world.cameras import cameras_of


def list_tasks() -> list[dict[str, Any]]:
    out = []
    for name, task in sorted(TASKS.items()):
        rng = np.random.default_rng(0)
        paragraph = " ".join((type(task).__doc__ or "").strip().split("\n\n")[0].split())
        keys = ("suite", "motion", "category", "step_limit", "target", "manipulated")
        out.append(
            {"name": name}
            | {key: getattr(task, key) for key in keys}
            | {
                "objects": [p.name for p in task.layout(Draw(rng, rng))],
                "description": paragraph.split(". ")[0].rstrip("."),
            }
        )
    return out


def list_objects(names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Seed 0 of each family: m, kg, frames x y z qw qx qy qz, and tasks."""
    out = {}
    for name in names:
        one = instance_of(name)
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
    return [
        {
            "name": name,
            "aliases": list(e.aliases),
            "dof": len(e.vector_names),
            "joints": list(e.vector_names),
            "limits": {
                f"{side}_{joint.name}": [joint.lower, joint.upper]
                for side, arm in e.arms.items()
                for joint in arm.joints
                if joint.name in arm.arm_joints
            },
            "max_opening": {side: arm.gripper.opening for side, arm in e.arms.items()},
            "cameras": [c.name for c in cameras_of(e)],
        }
        for name, e in ((name, robots.get_embodiment(name)) for name in robots.MODELS)
    ]


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
