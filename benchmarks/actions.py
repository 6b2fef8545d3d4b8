"""Recorded actions replayed in closed loop through every representation of an action.

    python -m benchmarks.actions --tasks all --embodiments all --workers 16 --rows rows.jsonl
    python -m benchmarks.actions --rows rows.jsonl --table > tables.md

Of each scene that the expert solves, its actions are written as an export writes them (float32
rows against their references), and read back as the evaluator reads the answers of a policy: a
chunk at a time, against the joints measured when the chunk is asked for and the command in force.
Physics only. Every replay is a line of `--rows`, written when its scene is complete: the same
command resumes. `--table` prints the tables of the file and runs nothing.

The tracking error of a replay is the largest distance of a tool from where it was in the replay of
joints at the same time, over the periods that both have. `noise` adds independent errors to every
number of every row, as a network would: 1 mm and 5 mrad to tool poses, 2 mrad to joints.
"""

import argparse
import json
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from itertools import product
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from benchmarks.action_tables import ReplayedScene, Row, scene_of, tables
from benchmarks.hardware import hardware
from pipeline.data.actions import JOINTS, ActionCodec, Representation
from pipeline.data.chains import read_chains
from pipeline.data.errors import DominoError
from pipeline.data.recipe.model import Cell
from pipeline.evaluate.actions import Answers
from pipeline.evaluate.scenes.case import BLIND, Case, expert_actions
from pipeline.evaluate.scenes.manifests import NoCase, case_of_seed
from pipeline.evaluate.scenes.trial import Trial
from pipeline.poses import Floats, compose, inverse
from pipeline.stages.scene import build_scene
from pipeline.tasks.contract import expand_tasks
from pipeline.world.robots import MODELS, canonical_name

SEED = 39_000
ALPHA = 0.1
CHUNK = 16
METRES, RADIANS, JOINT_RADIANS = 1e-3, 5e-3, 2e-3
ROTATIONS = {"ee": "6d", "ee-relative": "quaternion", "ee-delta": "axis-angle"}


@dataclass(frozen=True)
class ReplayKind:
    """What is replayed: a representation, in chunks of so many actions, with noise or without."""

    representation: Representation
    chunk: int
    noise: bool


JOINT_TARGETS = ReplayKind(JOINTS, 1, False)
"""What the others are compared with."""


def replays() -> Iterator[ReplayKind]:
    """All replays of a scene."""
    words = ("joints", "joints-relative", "joints-delta", *ROTATIONS)
    for noise, chunk, actions in product((False, True), (1, CHUNK), words):
        if actions == "joints" and chunk != 1:
            continue
        rotation = ROTATIONS.get(actions, JOINTS.rotation)
        yield ReplayKind(Representation(actions, rotation), chunk, noise)


class RecordedCase:
    """The recorded episode of a case: commanded and measured joints (T,A), one row a period."""

    def __init__(self, case: Case) -> None:
        self.case, self.commanded = case, expert_actions(case)
        self.trial = self._trial()
        self.measured = np.stack(
            [self._state(self.trial)]
            + [self._advanced(self.trial, row) for row in self.commanded[:-1]]
        )
        self.names = self.trial.scene.embodiment.vector_names

    def _trial(self) -> Trial:
        motion = self.case.target_motion
        scene = build_scene(self.case.spec, self.case.setup.ruling()).furnished(motion)
        return Trial(scene, motion, self.case.setup)

    @staticmethod
    def _state(trial: Trial) -> Floats:
        return trial.simulation.state_vector(trial.simulation.qpos()[0])

    def _advanced(self, trial: Trial, action: Floats) -> Floats:
        if not trial.ending:
            trial.advance(action)
        return self._state(trial)

    def rows(self, codec: ActionCodec, start: int, stop: int) -> Floats:
        """The stored rows of a chunk, float32, with one reference for all where they are
        relative."""
        commanded = self.commanded[start:stop]
        if codec.representation.reference == "delta":
            before = self.commanded[start - 1] if start else self.measured[0]
            against = np.vstack([before, commanded[:-1]])
        else:
            against = np.broadcast_to(self.measured[start], commanded.shape)
        rows = codec.encode(commanded, against)
        return rows.astype(np.float32).astype(np.float64)

    def play(self, replay: ReplayKind) -> tuple[Trial, int]:
        """The trial of a replay, and the tool poses that no joints reach."""
        trial, rng = self._trial(), np.random.default_rng(self.case.spec.seed % 2**32)
        answers = Answers(replay.representation, trial.simulation.embodiment)
        arms = read_chains(self.case.spec.embodiment, self.case.setup.layout)
        codec = ActionCodec(replay.representation, self.names, arms)
        errors = _errors(replay.representation, self.names)
        at, last = 0, self.commanded[-1:]
        while not trial.ending:
            start = min(at, len(self.commanded) - 1)
            if at >= len(self.commanded) and replay.representation.reference == "delta":
                # no motion, with the last gripper values, after the end of the recording
                rows = np.repeat(codec.encode(last, last), replay.chunk, axis=0)
            else:
                rows = self.rows(codec, start, start + replay.chunk)
            if replay.noise:
                rows = rows + rng.normal(size=rows.shape) * errors
            command, state = trial.simulation.command, self._state(trial)
            for action in answers.joints(rows, state, command):
                if not trial.ending:
                    trial.advance(action)
            at += replay.chunk
        return trial, answers.unreachable


def _errors(representation: Representation, names: Sequence[str]) -> Floats:
    """Standard deviation of the noise of each number of an action; none of grippers."""
    kinds = {"x": METRES, "y": METRES, "z": METRES, "gripper": 0.0}
    usual = RADIANS / 2 if representation.rotation == "quaternion" else RADIANS
    if not representation.poses:
        usual = JOINT_RADIANS
    last = [name.partition("_")[2] for name in representation.names(names)]
    return np.array([kinds.get(part, usual) for part in last])


def apart(trial: Trial, reference: Trial) -> tuple[float, float]:
    """Largest distance (m) and angle (rad) of the tools of two trials at the same time."""
    ours, theirs = trial.log().tcp, reference.log().tcp
    frames = min(len(ours), len(theirs))
    between = compose(inverse(theirs[:frames]), ours[:frames]).reshape(-1, 7)
    turns = 2 * np.arcsin(np.minimum(np.linalg.norm(between[:, 4:], axis=1), 1.0))
    return float(np.linalg.norm(between[:, :3], axis=1).max()), float(turns.max())


def play_scene(place: ReplayedScene) -> list[Row]:
    """Every replay of a scene."""
    scene = place._asdict()
    cell = Cell(place.task, place.robot, place.level, ALPHA, "clean")
    try:
        recorded = RecordedCase(case_of_seed(cell, SEED + place.slot, BLIND))
    except NoCase as error:
        return [scene | {"skipped": str(error)}]
    out, reference = list[Row](), recorded.play(JOINT_TARGETS)
    for replay in replays():
        began = time.process_time()
        trial, unreachable = reference if replay == JOINT_TARGETS else recorded.play(replay)
        metres, radians = apart(trial, reference[0])
        out.append(
            {
                **scene,
                "actions": replay.representation.actions,
                "chunk": replay.chunk,
                "noise": replay.noise,
                "success": trial.ending == "success",
                "metres": metres,
                "radians": radians,
                "unreachable": unreachable,
                "seconds": time.process_time() - began,
            }
        )
    return out


def run(
    places: Sequence[ReplayedScene], workers: int, keep: Callable[[Sequence[Row]], None]
) -> None:
    """Replay the scenes on `workers` processes; a scene that stops with an error is printed, and
    is tried again by the next run."""
    began = time.monotonic()
    os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        jobs = {pool.submit(play_scene, place): place for place in places}
        for number, job in enumerate(as_completed(jobs), 1):
            name = " ".join(map(str, jobs[job]))
            try:
                rows = job.result()
            except (DominoError, ArithmeticError, ValueError, RuntimeError) as error:
                print(f"{name}: {type(error).__name__}: {error}", file=sys.stderr)
                continue
            keep(rows)
            solved = sum(row.get("success", False) for row in rows)
            outcome = rows[0].get("skipped") or f"{solved} of {len(rows)} replays succeed"
            elapsed = time.monotonic() - began
            print(f"{number}/{len(jobs)} {elapsed:.0f} s  {name}: {outcome}", file=sys.stderr)


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--tasks", default="all")
    parser.add_argument("--embodiments", default="all")
    parser.add_argument("--levels", default="0,3")
    parser.add_argument("--slots", type=int, default=1, help="scenes of each")
    parser.add_argument("--rows", type=Path, required=True, help="file of JSON lines")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--table", action="store_true", help="run nothing")
    args = parser.parse_args()
    rows = [json.loads(line) for line in args.rows.open()] if args.rows.exists() else []
    if not args.table:
        done = {scene_of(row) for row in rows}
        names = MODELS if args.embodiments == "all" else args.embodiments.split(",")
        every = (
            ReplayedScene(task, robot, level, slot)
            for slot in range(args.slots)
            for task, robot, level in product(
                expand_tasks(args.tasks.split(",")),
                map(canonical_name, names),
                map(int, args.levels.split(",")),
            )
        )
        with args.rows.open("a") as file:

            def keep(more: Sequence[Row]) -> None:
                rows.extend(more)
                file.write("".join(json.dumps(row) + "\n" for row in more))
                file.flush()

            run([place for place in every if place not in done], args.workers, keep)
    print(f"{hardware()}\n\n{tables(rows)}")


if __name__ == "__main__":
    main()
