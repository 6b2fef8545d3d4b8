"""How many drawn shapes of a target's motion pass each filter, and what those of level 3 are like.

`python -m benchmarks.shape_filters` takes about two minutes. Ends are drawn in the workspaces of
all tasks, 5 cm or more from their edges; alpha is 0.1 m/s.
"""

from collections import Counter
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.motion.contract import MotionRequest
from pipeline.motion.models.planar import judge_shapes
from pipeline.motion.planar import greatest_speed
from pipeline.motion.planar_shapes import DRAW, DrawnPaths
from pipeline.stages.back_calculate import END_SPEED
from pipeline.tasks import TASKS
from pipeline.tasks.contract import expand_tasks

ALPHA, ENDS, SHAPES, EDGE = 0.1, 4, 1000, 0.05
REASONS = ("", "speed", "miss", "workspace", "smooth", "end_speed")


def end_speeds(paths: DrawnPaths) -> NDArray[np.float64]:
    """Speed (N,) in m/s of each path at its end."""
    last = (paths.durations > 0).sum(-1) - 1
    rows = np.arange(len(last))
    slopes = (paths.coefficients[rows, last] * np.arange(paths.coefficients.shape[-1])).sum(-1)
    return np.linalg.norm(slopes / paths.durations[rows, last][:, None], axis=-1)


def row(level: int, total: float, rng: np.random.Generator) -> str:
    """A line of the table in docs/measurements/fidelity.md."""
    counts, otherwise, fastest = Counter[str](), 0, 0.0
    for task in (TASKS[name] for name in expand_tasks(())):
        space = task.workspace
        for _ in range(ENDS):
            end = np.append(rng.uniform(space.lower + EDGE, space.upper - EDGE), 0.75)
            asked = MotionRequest(level, ALPHA, total, end, space)
            paths = DRAW[level](rng, SHAPES, asked)
            limited = replace(asked, end_speed_limit=END_SPEED * ALPHA)
            counts.update(judge_shapes(paths, limited).tolist())
            others = judge_shapes(paths, asked) == ""
            otherwise += int(others.sum())
            fastest = max(fastest, end_speeds(paths)[others].max(initial=0.0))
    share = " | ".join(f"{100 * counts[reason] / counts.total():.1f}" for reason in REASONS)
    over = 100 * (otherwise - counts[""]) / otherwise
    return f"| {level} | {total} | {share} | {over:.1f} | {fastest / ALPHA:.0f} alpha |"


def pieces(total: float, end_speed: float | None, rng: np.random.Generator) -> str:
    """What shapes of level 3 that pass the filters are like: per cent of pieces that are straight
    and of shapes with two pieces; median, 90th and 99th percentile of the greatest speed (m/s)."""
    straight, two, greatest = list[bool](), list[bool](), list[float]()
    for task in (TASKS[name] for name in expand_tasks(())):
        space = task.workspace
        for _ in range(ENDS):
            end = np.append(rng.uniform(space.lower + EDGE, space.upper - EDGE), 0.75)
            asked = MotionRequest(3, ALPHA, total, end, space, end_speed_limit=end_speed)
            paths = DRAW[3](rng, SHAPES, asked)
            for i in np.flatnonzero(judge_shapes(paths, asked) == ""):
                own, lasts = paths.coefficients[i], paths.durations[i]
                used = np.flatnonzero(lasts)
                straight += [not own[k, :, 2:].any() for k in used]
                two.append(len(used) == 2)
                greatest.append(float(max(np.max(greatest_speed(own[k]) / lasts[k]) for k in used)))
    shares = f"{100 * np.mean(straight):.0f} | {100 * np.mean(two):.0f}"
    speeds = " | ".join(f"{speed:.2f}" for speed in np.quantile(greatest, (0.5, 0.9, 0.99)))
    bound = "any" if end_speed is None else f"{end_speed:g}"
    return f"| {total:g} | {bound} | {shares} | {speeds} |"


def main() -> None:
    rng = np.random.default_rng(0)
    for level in DRAW:
        for total in (1.5, 2.5, 5.0):
            print(row(level, total, rng), flush=True)
    for total in (2.0, 3.0, 5.0):
        for end_speed in (None, END_SPEED * ALPHA):
            print(pieces(total, end_speed, np.random.default_rng(0)), flush=True)


if __name__ == "__main__":
    main()
