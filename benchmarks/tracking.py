"""A replayed plan beside a hand that tracks, on insertion into a moving pot: `python -m
benchmarks.tracking [--task put_can_pot] [--layouts 8]`.

Of layouts that have a dry run and a motion, how many succeed. "Replayed" plays the plan for the
still scene; "planned track" moves the hand with the known motion; "reactive track" with what is
seen. With errors the target comes 100 ms late and 5 mm beside the motion that the planned hands
know, and the reactive one sees it 100 ms late with 5 mm of noise.
"""

import argparse
from collections import Counter
from dataclasses import replace

import numpy as np
from tqdm import tqdm

from benchmarks.hardware import hardware
from pipeline.data.recipe.model import Recipe
from pipeline.data.setup.rules import Sight
from pipeline.data.spec import EpisodeSpec
from pipeline.evaluate.scoring.clock import Retimed
from pipeline.expert.tracking import TRACK
from pipeline.motion.contract import TargetMotion
from pipeline.planning.failure import PlanFailure
from pipeline.stages.attempt import draw_motion
from pipeline.stages.dry_run import DryRun
from pipeline.stages.failure import Failure, failing_as
from pipeline.stages.replay import commands, finish, react
from pipeline.stages.scene import Scene, build_scene
from pipeline.world.robots import MODELS

DELAY, OFF = 0.1, 0.005
WAYS = ("replayed", "planned track", "reactive track")


def succeeds(way: str, scene: Scene, dry: DryRun, motion: TargetMotion, wrong: bool) -> bool:
    """Whether one layout is solved in one of WAYS, with or without errors."""
    try:
        if way == WAYS[2]:
            react(scene, motion, Sight(delay=DELAY, noise=OFF) if wrong else Sight(), 15)
            return True
        known = (
            dry
            if way == WAYS[1]
            else replace(dry, runs=[run for run in dry.runs if run.skill != TRACK])
        )
        actor = scene.start(motion if not wrong else _Beside(motion, scene.spec.seed), 15, "replay")
        with failing_as("replay", actor):
            actor.play(*commands(actor, known, motion), dry.runs)
            actor.held = dict(dry.held)
            finish(scene, actor, "replay")
        return True
    except (Failure, PlanFailure):
        return False


class _Beside(Retimed):
    """The motion, late and aside in a direction drawn from a seed."""

    def __init__(self, motion: TargetMotion, seed: int) -> None:
        super().__init__(motion, late=DELAY)
        angle = np.random.default_rng(seed).uniform(0, 2 * np.pi)
        object.__setattr__(
            self, "_aside", OFF * np.array([np.cos(angle), np.sin(angle), 0, 0, 0, 0, 0])
        )

    def pose(self, t: object) -> np.ndarray:
        return super().pose(np.asarray(t, float)) + self.__dict__["_aside"]


def main() -> None:
    """Measure and print one table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--task", default="put_can_pot", help="one whose script tracks")
    parser.add_argument("--robots", default=",".join(MODELS))
    parser.add_argument("--layouts", type=int, default=8)
    args = parser.parse_args()
    print(f"{args.task}, alpha 0.1 m/s, levels 1 to 3 in turn; {hardware()}\n")
    print(
        "| robot | "
        + " | ".join(f"{way}{errors}" for errors in ("", ", 100 ms and 5 mm") for way in WAYS)
        + " |"
    )
    print("|---|" + "---:|" * 6)
    for robot in args.robots.split(","):
        won, tried = Counter[tuple[bool, str]](), 0
        for seed in tqdm(range(4 * args.layouts), desc=robot):
            scene = build_scene(
                EpisodeSpec(args.task, robot, 1 + seed % 3, 0.1, "clean", 0, 700 + seed)
            )
            try:
                dry, motion, _ = draw_motion(scene, Recipe())
            except Failure:
                continue
            tried, furnished = tried + 1, scene.furnished(motion)
            for wrong in (False, True):
                won.update(
                    (wrong, way) for way in WAYS if succeeds(way, furnished, dry, motion, wrong)
                )
            if tried == args.layouts:
                break
        print(
            f"| {robot} | "
            + " | ".join(f"{won[wrong, way]}/{tried}" for wrong in (False, True) for way in WAYS)
            + " |",
            flush=True,
        )


if __name__ == "__main__":
    main()
