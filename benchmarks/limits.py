"""What every commanded sample asks of the joints, how hard the robot presses on what, and how far
hands travel: `python -m benchmarks.limits --robots all --experts planned,reactive --slots 60`.

Fills slots as a build does, without images, and reads accepted episodes at every physics step (240
Hz). Velocity, acceleration and jerk are first, second and third differences of the commanded
positions, the rest before and after included, as shares of the limits: the robot's own joint
speeds, `MotionLimits.acceleration` and `MotionLimits.jerk`. Forces are impulses of one physics step
times 240, in N, of the kinds of pipeline/world/physics/contacts.py, of fingers on what they press,
and of what is held on the target that it meets. Ways are those of the tool in each run of a skill,
against the straight line from its start to its end.
"""

import argparse
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from random import Random
from typing import NamedTuple
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from benchmarks.hardware import hardware
from pipeline.data.clock import PHYSICS_HZ
from pipeline.data.episode.state_log import StateLog
from pipeline.data.names import SIDES
from pipeline.data.recipe.model import Recipe, Slot
from pipeline.planning.budgets import LIMITS
from pipeline.stages.attempt import Rollout, attempt
from pipeline.stages.failure import Failure
from pipeline.tasks.contract import expand_tasks
from pipeline.world.physics.contacts import ContactKinds
from pipeline.world.physics.simulation import Simulation
from pipeline.world.robots import MODELS, get_embodiment
from pipeline.world.robots.contract import Embodiment

SHARES = ("velocity", "acceleration", "jerk")

FORCES = {
    "arms": "arm on arm",
    "hands": "hand on hand",
    "palm": "palm or link on body or table",
    "table": "finger on table",
    "finger": "finger on body",
    "press": "press",
    "touch": "press, step of the touch",
    "meeting": "held body on target",
}
"""Kinds of force and their columns. "touch" is the press at the step of the touch, at which a
moving target is still kinematic and does not give way."""


class Way(NamedTuple):
    """Length (m) of the way of one tool in a run of a skill, and of the straight line between its
    ends."""

    skill: str
    length: float
    straight: float


@dataclass(frozen=True)
class Worst:
    """The largest share of each limit and the largest force of each kind in one episode, and its
    ways."""

    task: str
    robot: str
    expert: str
    values: dict[str, float]
    ways: list[Way]


def ways_of(log: StateLog) -> list[Way]:
    """The ways of an episode, from its frames."""
    found = list[Way]()
    for run in log.skills:
        frames = (log.times >= run.start / PHYSICS_HZ) & (log.times <= run.end / PHYSICS_HZ)
        for side in run.arms:
            way = log.tcp[frames, log.sides.index(side), :3]
            if len(way) > 1:
                length = float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())
                found.append(Way(run.skill, length, float(np.linalg.norm(way[-1] - way[0]))))
    return found


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
                done = attempt(recipe.spec(slot, number), recipe)
            except Failure:
                continue
        robot, log = done.scene.embodiment, done.replay.log
        found = dict.fromkeys(FORCES, 0.0) | shares(robot, np.array(steps.commands))
        for kind, force in _forces(done, steps.forces):
            found[kind] = max(found[kind], force)
        return Worst(done.scene.spec.task, robot.name, recipe.expert, found, ways_of(log))
    return None


def _forces(
    done: Rollout, forces: Sequence[Mapping[tuple[str, str], float]]
) -> Iterator[tuple[str, float]]:
    """Kinds and forces (N) of all contacts of an episode, from those of each physics step."""
    log, target, contact = (
        done.replay.log,
        done.scene.task.target,
        ContactKinds(done.scene.embodiment),
    )
    pressing = {k for r in log.skills if r.skill == "press" for k in range(r.start + 1, r.end + 1)}
    touched = next((round(e.time * PHYSICS_HZ) for e in log.events if e.name == "meeting"), -1)
    links = {name for name in log.bodies if name.startswith(("left_", "right_"))}
    for k, pairs in enumerate(forces, 1):
        for pair, force in pairs.items():
            kind = contact.of(*pair)
            if kind == "finger" and k in pressing:
                kind = "touch" if k == touched else "press"
            near = abs(k - touched) < PHYSICS_HZ / 2
            if near and target in pair and not {*links, "table"} & {*pair}:
                kind = "meeting"
            if kind and not (k == touched and target in pair and kind != "touch"):
                yield kind, force


def table(found: Sequence[Worst]) -> str:
    """Markdown: one row a robot, an expert and a task with the largest of each kind."""
    groups = defaultdict[str, list[Worst]](list)
    for name in ("robot", "expert"):
        for worst in sorted(found, key=lambda w: getattr(w, name)):
            groups[f"**{getattr(worst, name)}**"].append(worst)
    for worst in sorted(found, key=lambda w: w.task):
        groups[worst.task].append(worst)
    head = ["", "episodes", *SHARES, *(f"{title}, N" for title in FORCES.values())]
    rows = ["| " + " | ".join(head) + " |", "|---|" + "---:|" * (len(head) - 1)]
    for name, group in groups.items():
        worst = {kind: max(w.values[kind] for w in group) for kind in (*SHARES, *FORCES)}
        cells = [f"{worst[kind]:.2f}" for kind in SHARES]
        cells += [f"{worst[kind]:.0f}" if worst[kind] >= 0.5 else "" for kind in FORCES]
        rows.append(" | ".join([f"| {name}", str(len(group)), *cells]) + " |")
    return "\n".join(rows)


def ways_table(found: Sequence[Worst]) -> str:
    """Markdown: one row a skill, how much longer the ways of the tool are than straight lines."""
    groups = defaultdict[str, list[Way]](list)
    for worst in found:
        for way in worst.ways:
            groups[way.skill].append(way)
    rows = ["| skill | ways | median, m | beyond the line: median, m | 95 %, m | most, m |"]
    rows.append("|---|" + "---:|" * 5)
    for skill, ways in sorted(groups.items()):
        lengths, beyond = (
            np.array([way.length for way in ways]),
            np.array([way.length - way.straight for way in ways]),
        )
        cells = [np.median(lengths), *np.quantile(beyond, (0.5, 0.95, 1.0))]
        rows.append(f"| {skill} | {len(ways)} | " + " | ".join(f"{c:.2f}" for c in cells) + " |")
    return "\n".join(rows)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--tasks", default="all")
    parser.add_argument("--robots", default="all")
    parser.add_argument("--experts", default="planned")
    parser.add_argument("--levels", default="1")
    parser.add_argument("--alpha", default="0.1")
    parser.add_argument("--slots", type=int, help="of all slots, as many at random")
    parser.add_argument(
        "--seed", type=int, default=0, help="seed of the recipe: other ones are other layouts"
    )
    parser.add_argument("--workers", type=int, default=2)
    args = parser.parse_args()
    robots = (
        list(MODELS)
        if args.robots == "all"
        else [get_embodiment(r).name for r in args.robots.split(",")]
    )
    values = {
        "tasks": expand_tasks(args.tasks.split(",")),
        "embodiments": robots,
        "levels": [int(x) for x in args.levels.split(",")],
        "seed": args.seed,
        "alpha": [float(x) for x in args.alpha.split(",")],
        "episodes": 1,
    }
    recipes = [Recipe.model_validate(values | {"expert": e}) for e in args.experts.split(",")]
    jobs = [(recipe, slot) for recipe in recipes for slot in recipe.slots()]
    Random(args.seed).shuffle(jobs)
    jobs = jobs[: args.slots]
    with ProcessPoolExecutor(args.workers, mp_context=get_context("spawn")) as pool:
        found = [
            worst for worst in tqdm(pool.map(fill, jobs), total=len(jobs), unit="slot") if worst
        ]
    presses = [w.values["press"] for w in found if w.values["press"]]
    median = f"{np.median(presses):.0f} N" if presses else "none"
    print(f"{len(found)} episodes of {len(jobs)} slots; median press: {median}.")
    print("", hardware(), table(found), ways_table(found), sep="\n\n")


if __name__ == "__main__":
    main()
