"""The plots of a card."""

import io
from collections.abc import Sequence
from typing import Any

import numpy as np

from pipeline.motion.models import level_name, level_of
from pipeline.poses import Floats

from .survey import SurveyedEpisode

PATHS = 400
WORDS = {
    "start": ("where targets start", "x (m)", "y (m)"),
    "path": ("motions until the meeting (dot)", "x (m)", "y (m)"),
    "speed": ("speed until the meeting", "m/s", "samples"),
    "length": ("length of episodes", "s", "episodes"),
}
"""Title and labels of the axes of each plot."""


def plots(seen: Sequence[SurveyedEpisode]) -> bytes:
    """A PNG of five plots with at most PATHS paths; deterministic."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 7), dpi=90, layout="constrained")
    axes = figure.subplot_mosaic([["start", "path", "speed"], ["length", "range", "range"]])
    levels = sorted({one.level for one in seen})
    by_level = [[one for one in seen if one.level == level] for level in levels]
    colors = [level_of(*level).colour for level in levels]
    for level, color, mine in zip(levels, colors, by_level, strict=True):
        starts = np.array([one.path[0] for one in mine])
        axes["start"].scatter(*starts.T, s=10, color=color, label=level_name(*level), alpha=0.7)
        for one in mine[:: -(-len(seen) // PATHS)]:
            axes["path"].plot(*one.path.T, color=color, lw=0.8, alpha=0.6)
            axes["path"].plot(*one.path[-1], ".", color="#111827", ms=3)
    speeds = [np.concatenate([one.speeds for one in mine]) for mine in by_level]
    lengths = [[one.seconds for one in mine] for mine in by_level]
    for name, values in (("speed", speeds), ("length", lengths)):
        axes[name].hist(values, bins=_edges(values), stacked=True, color=colors)
    _ranges(axes["range"], seen)
    axes["range"].set_title("range of actions (rad; grippers 0 to 1)", fontsize=10)
    for name, (title, x, y) in WORDS.items():
        axes[name].set_title(title, fontsize=10)
        axes[name].set_xlabel(x, fontsize=8)
        axes[name].set_ylabel(y, fontsize=8)
    for axis in axes.values():
        axis.tick_params(labelsize=8)
    for name in ("start", "path"):
        axes[name].set_aspect("equal", adjustable="datalim")
    axes["start"].legend(fontsize=8)
    buffer = io.BytesIO()
    FigureCanvasAgg(figure).print_png(buffer, metadata={"Software": None})
    return buffer.getvalue()


def _edges(values: Sequence[Sequence[float] | Floats]) -> list[float]:
    """Edges of 20 bins; nearly equal values fall into the middle ones."""
    every = np.concatenate([np.asarray(each, float) for each in values])
    low, high = float(every.min()), float(every.max())
    pad = 0.5 * max(abs(high), 1e-3) if high - low <= 1e-6 * abs(high) else 0.0
    return np.linspace(low - pad, high + pad, 21).tolist()


def _ranges(axis: Any, seen: Sequence[SurveyedEpisode]) -> None:
    robot = seen[0].spec.embodiment
    mine = [one for one in seen if one.spec.embodiment == robot]
    low, high = np.min([one.low for one in mine], 0), np.max([one.high for one in mine], 0)
    at = np.arange(len(low))
    axis.bar(at, high - low, bottom=low, color="#2563eb", width=0.6)
    axis.set_xticks(at, mine[0].names, rotation=60, ha="right", fontsize=7)
    axis.set_ylabel(robot, fontsize=8)
