"""What every commanded sample asks of the joints, and what the hands press with: `python -m
benchmarks.limits --robots all`.

Fills slots as a build does, without images, and reads accepted episodes at every physics step (240
Hz). Velocity, acceleration and jerk are first, second and third differences of the commanded
positions, the rest before and after included, as shares of the
limits: the robot's own joint speeds, `MotionLimits.acceleration` and `MotionLimits.jerk`. Forces
are impulses of one physics step times 240, in N: of fingers on what they press, of what is held on
the target that it meets, of palms and arms on any body.
"""

import argparse
from collections import defaultdict
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from benchmarks.hardware import hardware
from pipeline.data.clock import PHYSICS_HZ
from pipeline.data.names import SIDES
from pipeline.data.recipe.model import Recipe, Slot
from pipeline.planning.budgets import LIMITS
from pipeline.stages.attempt import Phases, attempt
from pipeline.stages.failure import Failure
from pipeline.tasks.contract import expand_tasks
from pipeline.world.physics.simulation import Simulation
from pipeline.world.robots import MODELS, get_embodiment
from pipeline.world.robots.contract import Embodiment

KINDS = ("velocity", "acceleration", "jerk", "press", "touch", "meeting", "palm")
"""Columns of the table; the last four are forces in N. "touch" is the press at the step of the
touch, at which a moving target is still kinematic and does not give way."""


@dataclass(frozen=True)
class Worst:
    """The largest of each of KINDS in one episode."""

    task: str
    robot: str
    values: dict[str, float]


class Steps:
    """Every physics step of the newest simulation: commands (N,A), the first one at home, and
    forces (N) of touching pairs."""

    def __init__(self) -> None:
        self.simulation: Simulation | None = None
        self.commands: list[NDArray[np.float64]] = []
        self.forces: list[dict[tuple[str, str], float]] = []

    def add(self, simulation: Simulation) -> None:
        """Note a step that was just taken."""
        if simulation is not self.simulation or simulation.steps == 1:
            self.simulation, self.commands, self.forces = simulation, [simulation.home_vector()], []
        names = simulation.names
        self.commands.append(np.array(simulation.command))
        self.forces.append(
            {
                (names[a], names[b]): PHYSICS_HZ * impulse
                for a, b, impulse, *_ in simulation.contacts()
            }
        )


@contextmanager
def watched() -> Iterator[Steps]:
    """Note the physics steps that the block takes."""
    steps, step = Steps(), Simulation.step

    def noting(
        self: Simulation, command: NDArray[np.float64], velocity: NDArray[np.float64]
    ) -> None:
        step(self, command, velocity)
        steps.add(self)

    with patch.object(Simulation, "step", noting):
        yield steps


def in_units(robot: Embodiment, commands: NDArray[np.float64]) -> NDArray[np.float64]:
    """Commands (N,A) in rad and m: a gripper value becomes the way (m) of one jaw."""
    strokes = np.ones(commands.shape[1])
    for side, last in zip(SIDES, (commands.shape[1] // 2 - 1, commands.shape[1] - 1), strict=True):
        gripper = robot.arms[side].gripper
        strokes[last] = abs(gripper.opened[0] - gripper.closed[0])
    return commands * strokes


def speeds(robot: Embodiment) -> NDArray[np.float64]:
    """Largest speeds (A,) of the joints by the robot's own description, rad/s or m/s."""
    out = list[float]()
    for side in SIDES:
        arm = robot.arms[side]
        own = {joint.name: joint.velocity for joint in arm.joints}
        out += [*(own[name] for name in arm.arm_joints), arm.gripper.speed]
    return np.array(out)


def shares(robot: Embodiment, commands: NDArray[np.float64]) -> dict[str, float]:
    """Largest velocity, acceleration and jerk of commands (N,A), one a physics step, as shares of
    the limits."""
    still = np.repeat(commands[[0, -1]], 3, axis=0)
    q = in_units(robot, np.concatenate([still[:3], commands, still[3:]]))
    limits = {"velocity": speeds(robot), "acceleration": LIMITS.acceleration, "jerk": LIMITS.jerk}
    return {
        kind: float((np.abs(np.diff(q, n, axis=0)) * PHYSICS_HZ**n / limit).max())
        for n, (kind, limit) in enumerate(limits.items(), 1)
    }


def fill(job: tuple[Recipe, Slot]) -> Worst | None:
    """The largest values of a slot's accepted episode; None where every attempt fails."""
    recipe, slot = job
    for number in range(recipe.attempts):
        with watched() as steps:
            try:
                done = attempt(recipe.spec(slot, number), recipe, Phases())
            except Failure:
                continue
        robot, log = done.scene.embodiment, done.replay.log
        fingers = {f"{side}_{name}" for side in SIDES for name in robot.arms[side].gripper.fingers}
        links = {name for name in log.bodies if name.startswith(("left_", "right_"))}
        pressing = [range(run.start + 1, run.end + 1) for run in log.skills if run.skill == "press"]
        touched = next((round(e.time * PHYSICS_HZ) for e in log.events if e.name == "meeting"), -1)
        met, found = (
            round(done.meeting * PHYSICS_HZ),
            dict.fromkeys(KINDS, 0.0) | shares(robot, np.array(steps.commands)),
        )
        for k, forces in enumerate(steps.forces, 1):
            for (one, other), force in forces.items():
                pair = {one, other}
                kind = ""
                if pair & fingers and any(k in r for r in pressing):
                    kind = "touch" if k == touched else "press"
                elif (
                    done.scene.task.target in pair
                    and not pair & links
                    and "table" not in pair
                    and abs(k - met) < PHYSICS_HZ / 2
                ):
                    kind = "meeting"
                elif pair & (links - fingers) and not pair <= links:
                    kind = "palm"
                if kind:
                    found[kind] = max(found[kind], force)
        return Worst(done.scene.spec.task, robot.name, found)
    return None


def table(found: Sequence[Worst]) -> str:
    """Markdown: one row a robot and one a task with the largest of each kind, and the median
    press."""
    groups = defaultdict[str, list[Worst]](list)
    for worst in found:
        groups[f"**{worst.robot}**"].append(worst)
    for worst in sorted(found, key=lambda w: w.task):
        groups[worst.task].append(worst)
    head = (
        "| | episodes | velocity | acceleration | jerk | press N | at the touch N | held body on"
        " target N | palm or arm N |"
    )
    rows = [head, "|---|" + "---:|" * 8]
    for name, group in groups.items():
        worst = {kind: max(w.values[kind] for w in group) for kind in KINDS}
        cells = [f"{worst[kind]:.2f}" for kind in KINDS[:3]] + [
            f"{worst[kind]:.0f}" if worst[kind] else "" for kind in KINDS[3:]
        ]
        rows.append(" | ".join([f"| {name}", str(len(group)), *cells]) + " |")
    return "\n".join(rows)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--tasks", default="all")
    parser.add_argument("--robots", default="all")
    parser.add_argument("--levels", default="1")
    parser.add_argument("--alpha", default="0.1")
    parser.add_argument(
        "--slots", type=int, default=1, help="slots per task, robot, level and alpha"
    )
    parser.add_argument(
        "--seed", type=int, default=0, help="seed of the recipe: other ones are other layouts"
    )
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, help="also write the table here")
    args = parser.parse_args()
    tasks = expand_tasks(args.tasks.split(","))
    robots = (
        list(MODELS)
        if args.robots == "all"
        else [get_embodiment(r).name for r in args.robots.split(",")]
    )
    wanted = {
        "tasks": tasks,
        "embodiments": robots,
        "levels": [int(x) for x in args.levels.split(",")],
        "seed": args.seed,
    }
    recipe = Recipe.model_validate(
        wanted | {"alpha": [float(x) for x in args.alpha.split(",")], "episodes": args.slots}
    )
    jobs = [(recipe, slot) for slot in recipe.slots()]
    with ProcessPoolExecutor(args.workers, mp_context=get_context("spawn")) as pool:
        found = [
            worst for worst in tqdm(pool.map(fill, jobs), total=len(jobs), unit="slot") if worst
        ]
    presses = [w.values["press"] for w in found if w.values["press"]]
    median = f"{np.median(presses):.0f} N" if presses else "none"
    text = (
        f"{len(found)} episodes of {len(jobs)} slots; median press:"
        f" {median}.\n\n{hardware()}\n\n{table(found)}"
    )
    print(text)
    if args.out:
        args.out.write_text(text + "\n")


if __name__ == "__main__":
    main()
