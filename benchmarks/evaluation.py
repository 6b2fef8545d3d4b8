"""Closed-loop evaluation, measured: `python -m benchmarks.evaluation` prints control steps a second
against the floor of bare physics and rendering.

`together` compares one scene at a time with many scenes, for a policy that takes 5 ms an answer;
`parts` measures where the processor time of a step goes.
`run --rows DIR` runs the study of the reference policies (benchmarks/study) into DIR and resumes
where it was stopped; `page --rows DIR` writes its tables and plots into
docs/measurements/evaluation.md. `resume` kills evaluations half-way and compares one process with
two workers.
"""

import argparse
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks import together
from benchmarks.hardware import hardware
from benchmarks.study import page
from benchmarks.study.plan import TEN, groups
from benchmarks.study.resume import compare
from benchmarks.study.rows import StudyRows, markdown
from benchmarks.study.run import run
from pipeline.data.clock import DEFAULT_FPS, PHYSICS_HZ
from pipeline.data.names import MOUNTED
from pipeline.data.recipe.model import Cell
from pipeline.data.setup import Setup
from pipeline.evaluate.actions import interpolate_targets
from pipeline.evaluate.episode import EpisodeJob, run_episode
from pipeline.evaluate.names import make_here, policy_name
from pipeline.evaluate.scenes.case import Case, expert_actions
from pipeline.evaluate.scenes.manifests import SeedJob, try_seed
from pipeline.evaluate.scenes.trial import Eyes
from pipeline.evaluate.scoring.clock import parse_clock
from pipeline.stages.scene import build_scene
from pipeline.world.drawing.renderer import device_of

PARTS = ("scene", "policy", "render", "physics", "score")


@dataclass(frozen=True)
class Speed:
    """Wall seconds of an episode by what they were spent on, its processor time (s) over all
    threads, its control periods, and the
    floor: bare physics, bare rendering."""

    periods: int
    seconds: dict[str, float]
    processor: float
    bare_physics: float
    bare_render: float

    @property
    def floor(self) -> float:
        """Seconds that nothing can save."""
        return self.bare_physics + self.bare_render


def measure(case: Case, setup: Setup) -> Speed:
    """A replayed episode in a setup, and its floor: the same drive targets in a bare simulation, as
    many images drawn."""
    expert_actions(case)  # remembered: the expert is not what is measured
    began = time.process_time()
    row = run_episode(EpisodeJob(case, policy_name("replay"), parse_clock("sim"), setup=setup))
    processor = time.process_time() - began
    actions = expert_actions(case)[: row["periods"]]
    scene = build_scene(case.spec)
    actor = scene.start(case.target_motion, DEFAULT_FPS, "evaluate")
    simulation = actor.simulation
    eyes = Eyes(scene, setup) if setup.cameras else None
    physics, render, every = 0.0, 0.0, PHYSICS_HZ // DEFAULT_FPS
    for action in actions:
        rows, velocity = interpolate_targets(
            simulation.command, np.asarray(action), every, every / PHYSICS_HZ
        )
        began = time.perf_counter()
        if eyes:
            eyes.look(actor.recorder)
        drawn = time.perf_counter()
        for command in rows:
            simulation.step(command, velocity)
        physics, render = physics + time.perf_counter() - drawn, render + drawn - began
    if eyes:
        eyes.close()
    return Speed(row["periods"], row["seconds_spent"], processor, physics, render)


def fastest(found: Iterable[Speed]) -> Speed:
    """The shortest episode and the shortest floor: what else runs on the machine can only lengthen
    them."""
    speeds = list(found)
    floor = min(speeds, key=lambda s: s.floor)
    return replace(
        min(speeds, key=lambda s: sum(s.seconds.values())),
        processor=min(s.processor for s in speeds),
        bare_physics=floor.bare_physics,
        bare_render=floor.bare_render,
    )


def speed(tasks: Sequence[str], repeats: int = 5) -> str:
    """Markdown: a row a task and number of cameras, each the fastest of some repeats."""
    head = (
        "task",
        "cameras",
        "steps/s",
        "processor ms a step",
        "of floor",
        *(f"{p} %" for p in PARTS),
        "floor, steps/s",
        "floor: physics %",
    )
    body = []
    for task in tasks:
        case = first_case(task)
        for cameras in ((), MOUNTED[:1], MOUNTED):
            s = fastest(
                measure(case, Setup(cameras=cameras, textures="unseen")) for _ in range(repeats)
            )
            total = sum(s.seconds.values())
            shares = (f"{100 * s.seconds.get(part, 0.0) / total:.0f}" for part in PARTS)
            ratio = (
                f"{s.periods / total:.0f}",
                f"{1000 * s.processor / s.periods:.1f}",
                f"{s.floor / total:.0%}",
            )
            body.append(
                (
                    task,
                    len(cameras),
                    *ratio,
                    *shares,
                    f"{s.periods / s.floor:.0f}",
                    f"{100 * s.bare_physics / s.floor:.0f}",
                )
            )
    return markdown(head, body)


def first_case(task: str) -> Case:
    """The first scene of a task at level 1, alpha 0.1, that the expert solves."""
    cell, seed = Cell(task, "aloha-agilex", 1, 0.1, "clean"), 100_000
    while not isinstance(case := try_seed(SeedJob(cell, seed)), Case):
        seed += 1
    return case


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "what",
        nargs="?",
        choices=("speed", "together", "parts", "run", "page", "resume"),
        default="speed",
    )
    parser.add_argument(
        "--rows", type=Path, default=Path("out/study"), help="where the rows of the study are"
    )
    parser.add_argument(
        "--tasks", default="", help="names; three for speed, ten for the study by default"
    )
    parser.add_argument("--policy", default="", help="FILE.py of a network whose share is measured")
    parser.add_argument(
        "--seeds", type=int, default=20, help="admitted scenes of every task and cell"
    )
    parser.add_argument(
        "--episodes", type=int, default=100, help="episodes that are killed and gone on with"
    )
    args = parser.parse_args()
    tasks = args.tasks.split(",") if args.tasks else ()
    first, one_camera = (*tasks, "click_bell")[0], Setup(cameras=MOUNTED[:1], textures="unseen")
    match args.what:
        case "run":
            run(args.rows, [group for task in tasks or TEN for group in groups(task)], args.seeds)
        case "page":
            page.write(StudyRows.read(args.rows))
        case "resume":
            with TemporaryDirectory() as where:
                print(compare(Path(where), args.episodes), hardware(), sep="\n")
        case "together":
            print(hardware(), together.table(first_case(first), one_camera), sep="\n\n")
        case "parts":
            network = make_here(policy_name(args.policy)) if args.policy else None
            print(hardware(), together.parts(first_case(first), one_camera, network), sep="\n\n")
        case _:
            device = device_of("raster")
            print(
                f"{hardware(device)}\n\n{speed(tasks or ('click_bell', 'shake_bottle', 'place_container_plate'))}"  # noqa: E501
            )


if __name__ == "__main__":
    main()
