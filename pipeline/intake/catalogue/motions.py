"""What `domino-data motions` prints and draws."""

import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.data.atomic import write_atomic
from pipeline.motion.contract import MotionRequest, NoMotion, Streams
from pipeline.motion.models import MODELS, levels_of
from pipeline.motion.workspace import Workspace
from pipeline.poses import yawed
from pipeline.tasks.contract import TASKS

EXAMPLE = MotionRequest(
    1,
    0.1,
    4.0,
    yawed((0.0, 0.0, 0.80), 0.0),
    Workspace(-0.35, 0.35, -0.25, 0.25),
    radius=0.03,
    height=0.06,
    tail=0.25,
    floor=0.74,
)
"""The motions that are drawn: alpha 0.1 m/s, 4 s to a meeting 6 cm above the table."""

DRAWN = 5


def listing() -> list[dict[str, Any]]:
    """All models by name: version, levels from 0 with their descriptions, and the tasks that move
    by them."""
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
    """Write a PNG with paths of every model by level, from above and, where height changes, from
    the side. Raises OSError."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    names = sorted(MODELS)
    figure = Figure(figsize=(2.6 * len(names), 5.2), dpi=80, layout="constrained")
    axes = figure.subplots(2, len(names), squeeze=False)
    for column, name in enumerate(names):
        above, beside = axes[:, column]
        above.set_title(name, fontsize=10)
        for number, level in MODELS[name].levels.items():
            for path in _paths(name, number):
                above.plot(path[:, 0], path[:, 1], color=level.colour, lw=1.0, alpha=0.8)
                beside.plot(path[:, 0], path[:, 2], color=level.colour, lw=1.0, alpha=0.8)
        for axis, label in ((above, "y (m)"), (beside, "z (m)")):
            axis.plot(
                *np.asarray(EXAMPLE.end_pose)[[0, 1 if axis is above else 2]],
                ".",
                color="#111827",
                ms=4,
            )
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
        streams = Streams(
            np.random.default_rng([seed, level]), np.random.default_rng([seed, level, 1])
        )
        asked = replace(EXAMPLE, level=level)
        try:
            motion = MODELS[name].draw(asked, streams)
        except NoMotion:
            continue
        paths.append(motion.pose(np.linspace(0.0, asked.duration, 120))[:, :3])
    return paths
