"""Catching a moving can: `python -m benchmarks.moving_can --workers 2 --out FILE.md`.

For every robot and speed a can of 6 cm diameter slides over the table in a straight line at exactly
that speed and is to be grasped and held up. A draw is a place on the table, a yaw and height of the
can, and a direction; the three stages of a build solve it once. No draw is replaced: where the
plan, the motion or the grasp fails, the draw has failed, with its reason. Every speed and every run
sees the same places.

The speed is exact, where level 1 draws one of at most alpha. The direction is drawn as in a build:
the first of up to 1000 random ones whose path stays on the table, in view and clear of the arm
until the meeting; `no_motion` means that there is none.
"""

import argparse
import itertools
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import cast

import numpy as np

from benchmarks.hardware import hardware
from pipeline.data.recipe.model import Recipe
from pipeline.data.spec import EpisodeSpec
from pipeline.expert.actor import Actor, Skill
from pipeline.expert.skills import grasp, lift
from pipeline.motion.contract import MotionRequest
from pipeline.motion.planar_shapes import DRAW, TERMS, DrawnPaths
from pipeline.stages.attempt import attempt
from pipeline.stages.failure import Failure
from pipeline.tasks.contract import (
    INTERCEPTION,
    TASKS,
    Draw,
    Placement,
    Region,
    Task,
    register,
    side_of,
)
from pipeline.tasks.outcome import Outcome
from pipeline.world.objects.families.goods.bottles import Can
from pipeline.world.physics.body import Body
from pipeline.world.robots import MODELS, get_embodiment

SPEEDS = (0.05, 0.1, 0.2)
RADIUS = 0.03
LEVEL = 1


class CatchCan(Task):
    """Catch the can and lift it: at the end both fingers hold it, 5 cm or more above where it
    stood."""

    category = INTERCEPTION
    target = "can"
    seen = unseen = ("Catch {can}.",)
    least_seen = least_unseen = 1  # no episode of it is stored, so nobody reads its sentences

    def layout(self, draw: Draw) -> Iterator[Placement]:
        can = replace(cast(Can, draw.one_of("can")), radius=RADIUS)
        yield Placement(
            "can",
            can,
            Region(
                x=(-0.25, 0.25), y=(-0.18, 0.05), yaw=(-math.pi, math.pi), away_from_centre=0.05
            ),
        )

    def arms(self, bodies: dict[str, Body]) -> dict[str, str]:
        return {"arm": side_of(bodies["can"])}

    def meet(self, a: Actor) -> Iterator[Skill]:
        yield grasp(a.arms["arm"], "can", pitch=0.5)

    def finish(self, a: Actor) -> Iterator[Skill]:
        yield lift(a.arms["arm"], 0.10)

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        return {"held": o.holds(arms["arm"], "can"), "lifted": o.rise("can") > 0.05}


def draw_exact_speed(rng: np.random.Generator, n: int, asked: MotionRequest) -> DrawnPaths:
    """Constant velocity of exactly alpha m/s in any direction; stands in for level 1."""
    angle = rng.uniform(0.0, 2 * np.pi, n)
    travel = asked.alpha * asked.total * np.stack([np.cos(angle), np.sin(angle)], -1)
    c = np.zeros((n, 1, 2, TERMS))
    c[:, 0, :, 0], c[:, 0, :, 1] = asked.end[:2] - travel, travel
    return DrawnPaths(np.full((n, 1), asked.total), c, np.zeros(n, bool))


@contextmanager
def moving_cans() -> Iterator[None]:
    """While it is open the task exists and level 1 means the exact speed; neither outlives it."""
    plain, DRAW[LEVEL] = DRAW[LEVEL], draw_exact_speed
    register(CatchCan)
    try:
        yield
    finally:
        DRAW[LEVEL] = plain
        TASKS.remove(CatchCan.name)


@dataclass(frozen=True)
class Try:
    """Outcome of one draw: the can's speed (m/s), empty reason when lifted, then also the seconds
    from the start to the meeting."""

    robot: str
    speed: float
    reason: str
    meeting: float = 0.0


def one(spec: EpisodeSpec) -> Try:
    """One draw, solved once."""
    with moving_cans():
        try:
            rollout = attempt(spec, Recipe())
        except Failure as failure:
            return Try(spec.embodiment, spec.alpha, f"{failure.stage}: {failure.reason}")
    return Try(
        spec.embodiment, round(rollout.motion.features().average_speed, 9), "", rollout.meeting
    )


def run(specs: Sequence[EpisodeSpec], workers: int) -> list[Try]:
    """All draws, over processes when asked for more than one worker."""
    if workers == 1:
        return [one(spec) for spec in specs]
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        return list(pool.map(one, specs, chunksize=1))


def table(tries: Sequence[Try]) -> str:
    """Markdown: robots down, speeds across, per cent lifted; then the reasons of the draws that
    failed."""
    robots, speeds = list(dict.fromkeys(t.robot for t in tries)), sorted({t.speed for t in tries})
    rows = [
        "| robot | "
        + " | ".join(f"{speed:.2f} m/s" for speed in speeds)
        + " | median s to the meeting |"
    ]
    rows.append("|---|" + "---:|" * (len(speeds) + 1))
    for robot in robots:
        groups = [[t for t in tries if (t.robot, t.speed) == (robot, speed)] for speed in speeds]
        cells = " | ".join(
            f"{100 * np.mean([not t.reason for t in group]):.0f}" for group in groups
        )
        meetings = [t.meeting for group in groups for t in group if not t.reason]
        rows.append(
            f"| {robot} | {cells} | {np.median(meetings):.2f} |"
            if meetings
            else f"| {robot} | {cells} | |"
        )
    reasons = Counter((t.robot, t.speed, t.reason) for t in tries if t.reason)
    if reasons:
        rows += ["", "| robot | speed | reason | draws |", "|---|---:|---|---:|"]
        rows += [
            f"| {robot} | {speed:.2f} | {reason} | {n} |"
            for (robot, speed, reason), n in sorted(reasons.items())
        ]
    return "\n".join(rows)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--robots", default="all", help="comma separated")
    parser.add_argument("--speeds", default=",".join(map(str, SPEEDS)), help="m/s, comma separated")
    parser.add_argument("--draws", type=int, default=20, help="draws per robot and speed")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    robots = (
        list(MODELS)
        if args.robots == "all"
        else [get_embodiment(r).name for r in args.robots.split(",")]
    )
    speeds = [float(x) for x in args.speeds.split(",")]
    specs = [
        EpisodeSpec("catch_can", robot, LEVEL, speed, "clean", 0, seed)
        for robot, speed, seed in itertools.product(robots, speeds, range(args.draws))
    ]
    tries = run(specs, args.workers)
    head = (
        f"Per cent of {args.draws} draws lifted, one attempt each: a can of {200 * RADIUS:.0f} cm"
        " diameter at constant speed."
    )
    text = "\n\n".join([head, hardware(), table(tries)])
    print(text)
    if args.out:
        args.out.write_text(text + "\n")


if __name__ == "__main__":
    main()
