"""What a real arm must do to repeat the commands, in rad and m: `python -m benchmarks.real_robot`.

Fills one slot a robot and task as a build does, without images, and reads commands at every physics
step (240 Hz): largest speed, acceleration and jerk of arm joints, and largest speed of a jaw. Tool
speeds, and the distance of the measured joints from the command in force at that moment, are read
at 15 Hz. The target's speed is that before it is touched. Slots that no attempt fills are left out.
"""

import argparse
from collections import defaultdict

import numpy as np
from numpy.typing import NDArray

from benchmarks.hardware import hardware
from benchmarks.limits import in_units, watched
from pipeline.data.clock import PHYSICS_HZ
from pipeline.data.recipe.model import Recipe, Slot
from pipeline.stages.attempt import attempt
from pipeline.stages.failure import Failure
from pipeline.world.robots import MODELS

TASKS = ("click_bell", "place_container_plate", "beat_block_hammer", "handover_block")
COLUMNS = {
    "speed, rad/s": np.max,
    "acceleration, rad/s2": np.max,
    "jerk, rad/s3": np.max,
    "jaw, m/s": np.max,
    "tool, m/s": np.max,
    "error, 95 %, mrad": np.median,
    "error, most, mrad": np.max,
    "target, mean, cm/s": np.median,
    "target, most, cm/s": np.max,
}


def measured(recipe: Recipe, slot: Slot) -> list[float] | None:
    """The values of COLUMNS of a slot's accepted episode; None if every attempt fails."""
    for number in range(recipe.attempts):
        with watched() as steps:
            try:
                done = attempt(recipe.spec(slot, number), recipe)
            except Failure:
                continue
        robot, log = done.scene.embodiment, done.replay.log
        commands = in_units(robot, np.array(steps.commands))
        still = np.repeat(commands[[0, -1]], 3, axis=0)
        q = np.concatenate([still[:3], commands, still[3:]])
        jaws = np.array([name.endswith("gripper") for name in log.vector_names])
        peaks = [np.abs(np.diff(q, n, axis=0)).max(0) * PHYSICS_HZ**n for n in (1, 2, 3)]
        tool = np.linalg.norm(np.diff(log.tcp[..., :3], axis=0), axis=-1) * recipe.fps
        lag = 1000 * np.abs(log.state[1:] - log.action[:-1])[:, ~jaws]
        moving = np.abs(np.diff(log.action[:, ~jaws], axis=0)) > 1e-3
        values = [float(peak[~jaws].max()) for peak in peaks]
        values += [float(peaks[0][jaws].max()), float(tool.max())]
        values += [float(np.percentile(lag[moving], 95)), float(lag.max())]
        touched = log.time_of("release") or log.times[-1]
        speed = 100 * np.linalg.norm(log.target_velocity[log.times < touched], axis=1)
        return [*values, float(speed.mean()), float(speed.max())]
    return None


def table(rows: dict[str, list[list[float]]]) -> str:
    """Markdown: robots down, values across."""
    lines = [
        f"| robot | episodes | {' | '.join(COLUMNS)} |",
        "|---|" + "---:|" * (1 + len(COLUMNS)),
    ]
    for robot, found in rows.items():
        columns: list[NDArray[np.float64]] = list(np.array(found).T)
        cells = [f"{of(c):.3g}" for c, of in zip(columns, COLUMNS.values(), strict=True)]
        lines.append(f"| {robot} | {len(found)} | {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", default=",".join(MODELS))
    parser.add_argument("--tasks", default=",".join(TASKS))
    parser.add_argument("--level", type=int, default=1)
    options = parser.parse_args()
    rows = defaultdict[str, list[list[float]]](list)
    for robot in options.robots.split(","):
        recipe = Recipe(
            name="real",
            tasks=tuple(options.tasks.split(",")),
            embodiments=(robot,),
            levels=(options.level,),
            episodes=1,
        )
        for slot in recipe.physical_slots():
            if (values := measured(recipe, slot)) is not None:
                rows[robot].append(values)
    print(f"{table(rows)}\n\n{hardware()}")


if __name__ == "__main__":
    main()
