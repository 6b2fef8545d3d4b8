"""What the networks learn from: state logs of accepted episodes, of a dataset or made for this
without images."""

import io
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from pipeline.data.atomic import write_atomic
from pipeline.data.dataset import Dataset
from pipeline.data.episode.file import EpisodeError, open_episode
from pipeline.data.episode.state_log import StateLog
from pipeline.data.recipe.model import Cell, Recipe, Slot
from pipeline.evaluate.correct import Correction
from pipeline.evaluate.scenes.manifests import Runner
from pipeline.poses import Floats
from pipeline.stages.attempt import attempt
from pipeline.stages.failure import Failure
from pipeline.stages.replay import Demonstrator
from pipeline.world.objects import FAMILIES, Family
from training.ladder.features import State, target_first

AFTER_SUCCESS = 0.0
"""Seconds after the success with which demonstrations end for LeRobot: after it the hand returns on
the way on which it came."""


@dataclass(frozen=True, eq=False)
class Demonstration:
    """T frames of an accepted episode at the control rate.

    Joints and actions (T,A), tool poses (T,2,7), poses (T,B,7) of the bodies, the target first,
    their named points (T,P,3) in the world, and the target's velocity (T,3). Also the number of
    frames before the robot touches the target, and before the expert that corrects a policy acts,
    and until the success (0 if it is not known).
    """

    cell: Cell
    bodies: tuple[str, ...]
    untouched: int
    joints: Floats
    actions: Floats
    tools: Floats
    poses: Floats
    points: Floats
    velocity: Floats
    corrected: int = 0
    solved: int = 0

    @classmethod
    def of(
        cls, cell: Cell, log: StateLog, bodies: Mapping[str, Family], target: str
    ) -> "Demonstration":
        """The demonstration that a state log holds; `bodies` has the family of each body."""
        names = target_first(bodies, target)
        state = State.of(log, {name: bodies[name] for name in names})
        touched = log.time_of("release")
        untouched = len(log) if touched is None else int(np.searchsorted(log.times, touched))
        arrays = (state.joints, log.action, state.tools, state.poses, state.points, state.velocity)
        corrected = 0 if log.intervention is None else int(np.argmax(log.intervention))
        return cls(
            cell,
            tuple(names),
            untouched,
            *arrays,
            corrected,
            log.frames_until("success", AFTER_SUCCESS),
        )

    @property
    def state(self) -> State:
        """What networks may see of it."""
        return State(self.joints, self.tools, self.poses, self.points, self.velocity)

    def to_bytes(self) -> bytes:
        """A NumPy archive without pickles."""
        out = io.BytesIO()
        arrays = {name: getattr(self, name) for name in ARRAYS}
        head = json.dumps(
            {"cell": asdict(self.cell)} | {name: getattr(self, name) for name in HEAD}
        )
        np.savez_compressed(out, head=np.array(head), **arrays)
        return out.getvalue()

    @classmethod
    def read(cls, path: Path) -> "Demonstration":
        """Inverse of `to_bytes`."""
        with np.load(path, allow_pickle=False) as file:
            head = json.loads(str(file["head"]))
            arrays = {name: file[name] for name in ARRAYS}
            return cls(
                **arrays, **head | {"cell": Cell(**head["cell"]), "bodies": tuple(head["bodies"])}
            )


HEAD = ("bodies", "untouched", "corrected", "solved")
ARRAYS = ("joints", "actions", "tools", "poses", "points", "velocity")


@dataclass(frozen=True)
class DemonstrationJob:
    """A slot of a recipe to be filled without images."""

    recipe: Recipe
    slot: Slot


def fill(job: DemonstrationJob, demonstrator: Demonstrator | None = None) -> Demonstration | None:
    """The episode that a build of this recipe accepts for the slot, without images; None if it
    gives the slot up. Another `demonstrator` than the recipe's may show the task."""
    if demonstrator is None and job.recipe.corrections:
        demonstrator = Correction(job.recipe)
    for number in range(job.recipe.attempts):
        try:
            rollout = attempt(job.recipe.spec(job.slot, number), job.recipe, demonstrator)
        except Failure:
            continue
        scene = rollout.scene
        bodies = {
            name: body.instance for name, body in scene.bodies.items() if name not in scene.clutter
        }
        return Demonstration.of(job.slot.cell, rollout.replay.log, bodies, scene.task.target)
    return None


def make_demonstrations(recipe: Recipe, where: Path, run: Runner) -> Iterator[Demonstration]:
    """Demonstrations of every slot of the recipe in the order of slots; what is not below `where`
    yet is made and kept there."""
    slots = list(recipe.physical_slots())
    missing = [DemonstrationJob(recipe, slot) for slot in slots if not _path(where, slot).exists()]
    for job, found in run(fill, missing) if missing else ():
        write_atomic(_path(where, job.slot), b"" if found is None else found.to_bytes())
    for slot in slots:
        if _path(where, slot).stat().st_size:
            yield Demonstration.read(_path(where, slot))


def read_demonstrations(root: Path, cells: Sequence[Cell]) -> Iterator[Demonstration]:
    """Demonstrations of a dataset's episodes of these cells, in the order of its slots. Raises
    DatasetError, EpisodeError."""
    dataset = Dataset(root)
    for path in dataset.accepted(dataset.recipe()):
        with open_episode(path) as file:
            spec, meta = file.spec, file.meta
            cell = Cell.of(spec)
            if cell in cells:
                try:
                    bodies = {
                        n: FAMILIES[o.family](**o.parameters)
                        for n, o in meta.objects.items()
                        if n not in meta.clutter
                    }
                except (KeyError, TypeError) as error:
                    raise EpisodeError(
                        f"{path}: its objects are of another version ({error}): build the dataset"
                        " again"
                    ) from error
                yield Demonstration.of(cell, file.read().log, bodies, meta.target)


def _path(where: Path, slot: Slot) -> Path:
    return where / f"{slot.path}.npz"
