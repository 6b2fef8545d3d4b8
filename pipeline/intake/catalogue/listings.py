"""The lists that `domino-data` prints by name."""

import io
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.data.atomic import write_atomic
from pipeline.motion.contract import MotionRequest, NoMotion, Streams
from pipeline.motion.models import MODELS, levels_of
from pipeline.motion.workspace import Workspace
from pipeline.poses import Floats, yawed
from pipeline.tasks import TASKS
from pipeline.tasks.contract import Draw
from pipeline.tasks.layout import families_of
from pipeline.world import robots
from pipeline.world.cameras import cameras_of
from pipeline.world.objects.contract import FAMILIES

EXAMPLE = MotionRequest(
    *(1, 0.1, 4.0, yawed((0.0, 0.0, 0.80), 0.0), Workspace(-0.35, 0.35, -0.25, 0.25)),
    radius=0.03,
    height=0.06,
    tail=0.25,
    floor=0.74,
)
"""The motions that are drawn: alpha 0.1 m/s, 4 s to a meeting 6 cm above the table."""


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
            "max_opening": {side: arm.gripper.max_opening for side, arm in e.arms.items()},
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


def write_paths(page: Path) -> None:
    """Write a PNG with paths of every model by level, from above and from the side."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    names = sorted(MODELS)
    figure = Figure(figsize=(2.6 * len(names), 5.2), dpi=80, layout="constrained")
    axes = figure.subplots(2, len(names), squeeze=False)
    for name, (above, beside) in zip(names, axes.T, strict=True):
        above.set_title(name, fontsize=10)
        beside.set_xlabel("x (m)", fontsize=7)
        for axis, k, label in ((above, 1, "y (m)"), (beside, 2, "z (m)")):
            for number, level in MODELS[name].levels.items():
                for path in _paths(name, number):
                    axis.plot(path[:, 0], path[:, k], color=level.colour, lw=1.0, alpha=0.8)
            axis.plot(*np.asarray(EXAMPLE.end_pose)[[0, k]], ".", color="#111827", ms=4)
            axis.set_aspect("equal", adjustable="datalim")
            axis.tick_params(labelsize=6)
            axis.set_ylabel(label, fontsize=7)
    buffer = io.BytesIO()
    FigureCanvasAgg(figure).print_png(buffer, metadata={"Software": None})
    write_atomic(page, buffer.getvalue())


def _paths(name: str, level: int) -> Iterator[Floats]:
    for seed in range(5):
        streams = Streams(*map(np.random.default_rng, ([seed, level], [seed, level, 1])))
        try:
            motion = MODELS[name].draw(replace(EXAMPLE, level=level), streams)
        except NoMotion:
            continue
        yield motion.pose(np.linspace(0.0, EXAMPLE.duration, 120))[:, :3]
