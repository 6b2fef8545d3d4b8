"""Speed of the gymnasium environments without a camera: `python -m benchmarks.environments [--tasks
...]`.

Both arms sway about home. The floor is the same drive targets in a simulation that nobody observes,
records or judges. Processor time, the fastest of five rounds.
"""

import argparse
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchmarks.hardware import hardware
from benchmarks.study.rows import markdown
from pipeline.data.clock import DEFAULT_FPS, PHYSICS_HZ
from pipeline.evaluate import DominoEnv
from pipeline.evaluate.actions import interpolate_targets
from pipeline.evaluate.scenes.case import BLIND
from pipeline.stages.scene import build_scene

STEPS, ROUNDS = 150, 5
KINDS = {"policy, score": {}, "state, dense": {"observations": "state", "reward": "dense"}}


def seconds(work: Callable[[], object]) -> float:
    """Processor seconds of some work."""
    began = time.process_time()
    work()
    return time.process_time() - began


def bare(env: DominoEnv, actions: NDArray[np.float64]) -> Callable[[], None]:
    """What steps a bare simulation of the environment's scene through actions (T,A)."""
    assert env.case is not None
    simulation = (
        build_scene(env.case.spec).start(env.case.target_motion, DEFAULT_FPS, "evaluate").simulation
    )
    steps, limits = PHYSICS_HZ // DEFAULT_FPS, env.trial.limits

    def work() -> None:
        for action in actions:
            goal = limits.clipped(action, simulation.command, 1 / DEFAULT_FPS)
            rows, velocity = interpolate_targets(simulation.command, goal, steps, 1 / DEFAULT_FPS)
            for row in rows:
                simulation.step(row, velocity)

    return work


def measure(env: DominoEnv) -> tuple[float, float, float]:
    """Seconds of a reset, of a step, and of a step of the bare simulation."""
    env.reset()
    home = env.trial.simulation.home_vector()
    arms = np.array([not name.endswith("gripper") for name in env.action_names])
    actions = home + 0.2 * np.sin(np.arange(STEPS) / 10)[:, None] * arms
    rounds: list[tuple[float, float, float]] = []
    for _ in range(ROUNDS):
        reset = seconds(env.reset)
        stepped = seconds(lambda: [env.step(action) for action in actions])
        rounds.append((reset, stepped / STEPS, seconds(bare(env, actions)) / STEPS))
    reset, step, floor = (min(column) for column in zip(*rounds, strict=True))
    return reset, step, floor


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--tasks", default="click_bell,shake_bottle,place_container_plate")
    body: list[tuple[object, ...]] = []
    for task in parser.parse_args().tasks.split(","):
        for name, kind in KINDS.items():
            env = DominoEnv(task, level=0, setup=BLIND, scenes=1, **kind)
            reset, step, floor = measure(env)
            body.append(
                (
                    task,
                    name,
                    f"{1e3 * reset:.0f}",
                    f"{1 / step:.0f}",
                    f"{1 / floor:.0f}",
                    f"{floor / step:.2f}",
                )
            )
    print(
        markdown(("task", "environment", "reset, ms", "steps/s", "bare, steps/s", "ratio"), body),
        hardware(),
        sep="\n\n",
    )


if __name__ == "__main__":
    main()
