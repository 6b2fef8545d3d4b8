"""How many pairs of scenes, with and without an event, have the same bytes until it happens.

    python -m benchmarks.events OUT.jsonl [--pairs 200] [--images 10] [--kinds stop swap]

Robots move at random, targets cross the table. State and actions of every pair are compared, and of
every n-th one the head camera's images at the event and before it. Lines of OUT.jsonl that are
there are not made again."""

import argparse
import json
from pathlib import Path
from typing import Any, get_args

import numpy as np

from pipeline.data.episode.events import EventKind, EventSpec
from pipeline.data.setup import Setup
from pipeline.data.setup.rules import Rules
from pipeline.data.spec import CONTROL, EVENTFUL, EpisodeSpec
from pipeline.evaluate.scenes.trial import Trial
from pipeline.motion.planar import PlanarMotion, Segment
from pipeline.motion.wrapped import Company
from pipeline.stages.drawing.render import appearance_of, capture
from pipeline.stages.failure import Failure
from pipeline.stages.scene import Scene, build_scene

KINDS = [kind for kind in get_args(EventKind) if kind != "latency"]
TASKS = ("click_bell", "place_empty_cup", "place_a2b_left", "shake_bottle")
ONLY = {"goal": "place_a2b_left", "instruction": "pick_named"}  # tasks that a kind needs
SETUP = Setup(cameras=("head",), size=(160, 120))


def start(scene: Scene, turn: float) -> tuple[Scene, Trial]:
    """A trial whose target comes to its place in a direction (rad), from 0.2 m away in 2 s."""
    end, way = scene.bodies[scene.task.target].pose, 0.2 * np.array([np.cos(turn), np.sin(turn)])
    piece = Segment(0.0, 2.0, np.stack([end[:2] - way, way], axis=1))
    motion = PlanarMotion(1, 0.1, 2.0, 0.0, float(end[2]), end[3:], (piece,))
    others = {n: PlanarMotion.still(scene.bodies[n].pose, 2.0) for n in scene.task.movers}
    motion = Company(motion, others) if others else motion
    scene = scene.furnished(motion)
    if not scene.sees(np.asarray(motion.pose(0.0))[:3]):
        raise Failure("benchmark", "out_of_view", "the target would begin out of view")
    return scene, Trial(scene, motion)


def run(kind: str, seed: int, arm: str) -> tuple[Scene, Trial, float]:
    """One arm: 1.6 s of a robot that moves at random."""
    task = ONLY.get(kind, TASKS[seed % len(TASKS)])
    spec = EpisodeSpec(task, "aloha-agilex", 1, 0.1, "clean", 2 * seed, seed, arm=arm)
    rng = spec.rng("benchmark")
    at = round(float(rng.uniform(0.3, 0.9)), 3)
    scene = build_scene(spec, Rules(events=(EventSpec.model_validate(f"{kind}@{at}"),)))
    while True:
        try:
            scene, trial = start(scene, float(rng.uniform(-np.pi, np.pi)))
            break
        except Failure:  # the target would begin in another body, or unseen
            continue
    command = trial.simulation.home_vector()
    while trial.simulation.steps < 384 and not trial.ending:
        command = command + rng.normal(0.0, 0.02, len(command))
        trial.advance(trial.limits.clipped(command, trial.simulation.command, 1 / 15))
    return scene, trial, at


def compare(kind: str, seed: int, images: bool) -> dict[str, Any]:
    """Whether the two arms of a pair are the same until the event, and differ after it."""
    (one, a, at), (two, b, _) = (run(kind, seed, arm) for arm in (EVENTFUL, CONTROL))
    first, second = a.log(), b.log()
    frames = int((first.times <= at + 1e-9).sum())
    names = ("poses", "qpos", "qvel", "state", "tcp", "target_velocity")
    same = all(
        getattr(first, n)[:frames].tobytes() == getattr(second, n)[:frames].tobytes() for n in names
    )
    same &= first.action[: frames - 1].tobytes() == second.action[: frames - 1].tobytes()
    row = {"kind": kind, "seed": seed, "task": one.spec.task, "at": at, "state": bool(same)}
    row["after"] = any(getattr(first, n).tobytes() != getattr(second, n).tobytes() for n in names)
    if images:
        kept = [frames - 4, frames - 1]
        seen = [
            capture(appearance_of(scene, SETUP), log, SETUP, kept).views[0].rgb.tobytes()
            for scene, log in ((one, first), (two, second))
        ]
        row["images"] = seen[0] == seen[1]
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--pairs", type=int, default=200)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    parser.add_argument("--images", type=int, default=10, help="compare images of every n-th pair")
    options = parser.parse_args()
    kinds = options.kinds
    rows = [json.loads(line) for line in options.out.open()] if options.out.exists() else []
    done = {(row["kind"], row["seed"]) for row in rows}
    with options.out.open("a") as file:
        for n in range(options.pairs):
            kind, seed = kinds[n % len(kinds)], n // len(kinds)
            if (kind, seed) not in done:
                rows.append(compare(kind, seed, seed % options.images == 0))
                print(json.dumps(rows[-1]), file=file, flush=True)
    for kind in kinds:
        of = [row for row in rows if row["kind"] == kind]
        drawn = [row["images"] for row in of if "images" in row]
        print(
            f"{kind:11} state equal until the event {sum(r['state'] for r in of)} of {len(of)},"
            f" images {sum(drawn)} of {len(drawn)}; state differs after it in"
            f" {sum(r['after'] for r in of)}"
        )


if __name__ == "__main__":
    main()
