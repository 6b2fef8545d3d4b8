"""A scene that the expert solves, with its target's motion."""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.data.dataset import Dataset
from pipeline.data.episode.state_log import StateLog
from pipeline.data.errors import DominoError
from pipeline.data.recipe.model import Cell
from pipeline.data.setup import DEFAULT, Setup
from pipeline.data.spec import EpisodeSpec, condition_arms
from pipeline.motion.contract import TargetMotion
from pipeline.motion.models import motion_from_json
from pipeline.poses import Floats
from pipeline.stages.attempt import Rollout, attempt
from pipeline.stages.scene import Scene, build_scene
from pipeline.world.physics.events import PROP
from pipeline.world.physics.simulation import Simulation

from .frozen import FrozenScene

UNSEEN = Setup(textures="unseen")  # the robot's cameras, and textures that training never shows


def setup_of(source: Setup | Mapping[str, Any] | str | Path) -> Setup:
    """A setup, UNSEEN with changed keys, or a dataset's. Raises RecipeError, DatasetError."""
    if isinstance(source, Setup):
        return source.setup
    if isinstance(source, Mapping):
        return UNSEEN.override(source, "setup")
    return Dataset(Path(source)).setup().override({"textures": "unseen"})


def blind(setup: Setup) -> Setup:
    off = dict.fromkeys(("depth", "segmentation", "pointcloud"), False)
    return setup.setup.override({"cameras": [], "textures": "unseen", **off})


BLIND = blind(UNSEEN)


class BenchmarkError(DominoError): ...


@dataclass(frozen=True)
class Case:
    """A spec that the expert solved, under the physics of `setup`. `meeting` is the first touch
    (s) in the dry run, `frames` the expert's length; `start` and `end` hash the first frame
    and the state log."""

    spec: EpisodeSpec
    motion: str
    meeting: float
    frames: int
    start: str
    end: str
    setup: Setup = DEFAULT
    state: FrozenScene | None = None

    @property
    def target_motion(self) -> TargetMotion:
        return motion_from_json(self.motion)

    @property
    def digest(self) -> str:
        return hashlib.sha256(f"{self.motion}{self.start}".encode()).hexdigest()[:12]

    def arms(self, events: int) -> Iterator["Case"]:
        """The same case in every arm of so many conditions."""
        for arm in condition_arms(events):
            yield replace(self, spec=replace(self.spec, arm=arm))

    def scene(self, setup: Setup | None = None) -> Scene:
        """The scene under the rules of a setup. Raises Failure("layout"), BenchmarkError."""
        rules = (setup or self.setup).ruling()
        if self.state is None:
            return build_scene(self.spec, rules).furnished(self.target_motion)
        try:
            return self.state.scene(self.spec, rules).furnished(self.target_motion)
        except ValueError as error:
            at = f"{self.spec.task}, level {self.spec.level}, seed {self.spec.seed}"
            raise BenchmarkError(f"the benchmark's scene of {at}: {error}") from error

    def to_dict(self) -> dict[str, Any]:
        values = asdict(replace(self, state=None)) | {"spec": self.spec.values()}
        del values["state"]
        return values | {"motion": json.loads(self.motion), "setup": self.setup.given()}

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> "Case":
        """What `to_dict` gave. Raises ValueError, TypeError, KeyError or AttributeError."""
        numbers, texts = (values["meeting"], values["frames"]), (values["start"], values["end"])
        whole = all(type(n) in (int, float) and 0 <= n < 1e6 for n in numbers)
        if not whole or not all(isinstance(t, str) for t in texts):
            raise ValueError("a case has no meeting, frames, start or end")
        motion = motion_from_json(json.dumps(values["motion"])).to_json()
        spec, setup = EpisodeSpec(**values["spec"]), Setup.model_validate(values["setup"]).physics
        return cls(**(values | {"spec": spec, "motion": motion, "setup": setup}))


def start_of_trial(simulation: Simulation) -> str:
    """Hash of the first frame, without event scenery."""
    own = [not name.startswith(PROP) for name in simulation.names]
    return start_hash(simulation.poses()[own], simulation.qpos()[0])


def start_hash(poses: Floats, qpos: Floats) -> str:
    """Hash of one frame: poses (B,7) of all bodies and joint positions (J,)."""
    return _digest([poses, qpos])


def log_hash(log: StateLog) -> str:
    return _digest([log.poses, log.qpos, log.qvel, log.action])


def _digest(arrays: Sequence[Floats]) -> str:
    digest = hashlib.sha256()
    for values in arrays:
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()[:32]


def expert(spec: EpisodeSpec, setup: Setup = DEFAULT) -> Rollout:
    """The latest ones are remembered. Raises Failure."""
    return _expert(spec, setup.physics)


@lru_cache(maxsize=8)
def _expert(spec: EpisodeSpec, setup: Setup) -> Rollout:
    return attempt(spec, setup)


def admit(spec: EpisodeSpec, setup: Setup = DEFAULT) -> Case:
    rollout = expert(spec, setup)
    log, motion = rollout.replay.log, rollout.motion.to_json()
    hashes = start_hash(log.poses[0], log.qpos[0]), log_hash(log)
    return Case(spec, motion, rollout.meeting, len(log), *hashes, setup.physics)


def expert_actions(case: Case) -> Floats:
    """The expert's actions (T,A), one a control period. Raises Failure."""
    if case.state is None:
        return expert(case.spec, case.setup).replay.log.action[:-1]
    done = attempt(case.spec, case.setup, frozen=case.scene())
    return done.replay.log.action[:-1]


def in_every_arm(admitted: Mapping[Cell, Sequence[Case]], events: int) -> dict[Cell, list[Case]]:
    return {
        cell: [a for case in cases for a in case.arms(events)] for cell, cases in admitted.items()
    }
