"""Recorded actions replayed in closed loop through every representation of an action.

    python -m benchmarks.actions --tasks click_bell,handover_block --robots aloha-agilex \
        --levels 0,3 --slots 2 --rows rows.jsonl

Of each scene that the expert solves, its actions are written as an export writes them (float32
rows against their references), and read back as the evaluator reads the answers of a policy: a
chunk at a time, against the joints measured when the chunk is asked for and the command in force.
Physics only. Every replay is a line of `--rows`: the same command resumes. `--table` prints the
tables of the file and runs nothing.

The tracking error of a replay is the largest distance of a tool from where it was in the replay of
joints at the same time, over the periods that both have. `noise` adds independent errors to every
number of every row, as a network would: 1 mm and 5 mrad to tool poses, 2 mrad to joints.
"""

import argparse
import json
import sys
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.hardware import hardware
from pipeline.data.actions import JOINTS, ActionCodec, Representation
from pipeline.data.chains import read_chains
from pipeline.data.recipe.model import Cell
from pipeline.evaluate.actions import Answers
from pipeline.evaluate.scenes.case import BLIND, Case, expert_actions
from pipeline.evaluate.scenes.training import NoCase, case_of_seed
from pipeline.evaluate.scenes.trial import Trial
from pipeline.evaluate.scoring.statistics import wilson
from pipeline.poses import Floats, compose, inverse
from pipeline.stages.scene import build_scene
from pipeline.world.robots import canonical_name

TASKS = (
    *("click_bell", "beat_block_hammer", "place_container_plate", "handover_block"),
    "press_stapler",
)
SEED = 39_000
ALPHA = 0.1
CHUNK = 16
METRES, RADIANS, JOINT_RADIANS = 1e-3, 5e-3, 2e-3
ROTATIONS = {"ee": "6d", "ee-relative": "quaternion", "ee-delta": "axis-angle"}

type Row = dict[str, Any]
"""A replay: its scene, what was replayed, whether it succeeded and how far its tools strayed."""


@dataclass(frozen=True)
class ReplayKind:
    """What is replayed: a representation, in chunks of so many actions, with noise or without."""

    representation: Representation
    chunk: int
    noise: bool

    @property
    def key(self) -> list[Any]:
        """What tells a replay from the others of a scene."""
        return [self.representation.actions, self.chunk, self.noise]


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

    def rows(self, replay: ReplayKind, start: int, stop: int) -> Floats:
        """The stored rows of a chunk, float32, with one reference for all where they are
        relative."""
        spec = self.case.spec
        arms = read_chains(spec.embodiment, self.case.setup.layout)
        codec = ActionCodec(replay.representation, self.names, arms)
        commanded = self.commanded[start:stop]
        if replay.representation.reference == "delta":
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
        errors = _errors(replay.representation, self.names)
        at = 0
        while not trial.ending:
            start = min(at, len(self.commanded) - 1)
            rows = self.rows(replay, start, start + replay.chunk)
            if at >= len(self.commanded) and replay.representation.reference == "delta":
                rows = self._still(replay, rows)
            if replay.noise:
                rows = rows + rng.normal(size=rows.shape) * errors
            command, state = trial.simulation.command, self._state(trial)
            for action in answers.joints(rows, state, command):
                if not trial.ending:
                    trial.advance(action)
            at += replay.chunk
        return trial, answers.unreachable

    def _still(self, replay: ReplayKind, rows: Floats) -> Floats:
        """A step of no motion, with the last gripper values: what follows the recording."""
        codec = ActionCodec(
            replay.representation, self.names, read_chains(self.case.spec.embodiment)
        )
        last = self.commanded[-1:]
        return np.repeat(codec.encode(last, last), len(rows), axis=0)


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


def play_scene(case: Case, done: set[str], write: Any) -> None:
    """Every replay of a scene that is not done."""
    recorded, reference = RecordedCase(case), None
    spec = case.spec
    for replay in replays():
        key = json.dumps([spec.task, spec.embodiment, spec.level, spec.seed, *replay.key])
        if key in done:
            continue
        began = time.process_time()
        reference = reference or recorded.play(JOINT_TARGETS)
        trial, unreachable = reference if replay == JOINT_TARGETS else recorded.play(replay)
        metres, radians = apart(trial, reference[0])
        write(
            {
                **{"key": key, "task": spec.task, "robot": spec.embodiment, "level": spec.level},
                **{"actions": replay.representation.actions, "chunk": replay.chunk},
                **{"noise": replay.noise, "success": trial.ending == "success"},
                **{"metres": metres, "radians": radians, "unreachable": unreachable},
                "seconds": time.process_time() - began,
            }
        )


def tables(rows: Sequence[Row]) -> str:
    """Markdown: success and tracking error by representation, without noise and with it."""
    parts = []
    for noise in (False, True):
        groups = defaultdict[tuple[str, int], list[Row]](list)
        for row in rows:
            if row["noise"] == noise:
                groups[row["actions"], row["chunk"]].append(row)
        base = {_scene(row): row["success"] for row in rows if _is_base(row)}
        lines = [
            f"{'With' if noise else 'Without'} noise:",
            "",
            "| actions | chunk | replays | success, % | 95 % interval | of those joints solve, % |"
            " tool error, median mm | worst mm | median mrad | poses out of reach |",
            "|---|---|---|---|---|---|---|---|---|---|",
        ]
        for (actions, chunk), group in groups.items():
            solved = sum(row["success"] for row in group)
            low, high = wilson(solved, len(group))
            of = [row["success"] for row in group if base.get(_scene(row))]
            metres = np.array([row["metres"] for row in group]) * 1000
            turns = np.array([row["radians"] for row in group]) * 1000
            lines.append(
                f"| `{actions}` | {chunk} | {len(group)} | {100 * solved / len(group):.1f} |"
                f" {100 * low:.1f}-{100 * high:.1f} | {100 * np.mean(of) if of else 0:.1f} |"
                f" {np.median(metres):.2f} | {metres.max():.2f} | {np.median(turns):.2f} |"
                f" {sum(row['unreachable'] for row in group)} |"
            )
        parts.append("\n".join(lines))
    return "\n\n".join(parts)


def _scene(row: Row) -> str:
    return json.dumps(json.loads(row["key"])[:4])


def _is_base(row: Row) -> bool:
    return row["actions"] == "joints" and not row["noise"]


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description="Recorded actions through every representation.")
    parser.add_argument("--tasks", default=",".join(TASKS))
    parser.add_argument("--robots", default="aloha-agilex,franka-panda")
    parser.add_argument("--levels", default="0,3")
    parser.add_argument("--slots", type=int, default=2)
    parser.add_argument("--rows", type=Path, required=True)
    parser.add_argument("--table", action="store_true")
    args = parser.parse_args()
    rows = [json.loads(line) for line in args.rows.open()] if args.rows.exists() else []
    if not args.table:
        done = {row["key"] for row in rows}
        with args.rows.open("a") as file:

            def write(row: Row) -> None:
                rows.append(row)
                file.write(json.dumps(row) + "\n")
                file.flush()

            robots = [canonical_name(name) for name in args.robots.split(",")]
            levels = [int(text) for text in args.levels.split(",")]
            pairs = list(product(args.tasks.split(","), robots))
            for slot, level, (task, robot) in product(range(args.slots), levels, pairs):
                cell = Cell(task, robot, level, ALPHA, "clean")
                try:
                    case = case_of_seed(cell, SEED + slot, BLIND)
                except NoCase as error:
                    print(error, file=sys.stderr)
                    continue
                play_scene(case, done, write)
                print(f"{task} {robot} level {level} slot {slot}", file=sys.stderr)
    print(f"{hardware()}\n\n{tables(rows)}")


if __name__ == "__main__":
    main()
