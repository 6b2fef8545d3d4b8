"""The `domino-data` command with stages that only sleep: python -m benchmarks.chaos.command build
...

CHAOS_STORED names a dataset. Nothing is planned or drawn: every slot gets the first episode of that
dataset under its own spec, after a moment's sleep, some after failed attempts. Keys, logs, files,
index, crew and command are the real ones.
"""

import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pipeline.run.build as building
import pipeline.stages.attempt as stages
from pipeline import cli
from pipeline.crew.contract import Crew, Steps
from pipeline.data.dataset import Dataset
from pipeline.data.episode.file import Episode, EpisodeError, EpisodeFile
from pipeline.data.episode.meta import Drawing
from pipeline.data.episode.state_log import StateLog, physics_id
from pipeline.data.keys import SlotKeys
from pipeline.data.recipe.model import Recipe
from pipeline.data.slots.assets import AssetStore
from pipeline.data.slots.records import SlotRecord
from pipeline.data.spec import EpisodeSpec
from pipeline.motion.contract import TargetMotion
from pipeline.motion.models import motion_from_json
from pipeline.run.slot import fill as filling
from pipeline.run.slot.fill import FillJob, fill_in_steps
from pipeline.run.slot.make import Images, stored_images
from pipeline.stages.failure import Failure
from pipeline.stages.replay import Demonstrator

STORED = "CHAOS_STORED"
LONGEST, FAILING = 0.1, 0.25
"""Seconds that a stored attempt takes at most, and the share of attempts that fail."""


@dataclass(frozen=True)
class _Scene:
    spec: EpisodeSpec


@dataclass(frozen=True)
class _Replay:
    log: StateLog


@dataclass(frozen=True)
class _Rollout:
    scene: _Scene
    replay: _Replay
    motion: TargetMotion
    steps: int


class Stored:
    """The stages of a slot without physics and images."""

    def __init__(self, source: Dataset) -> None:
        self._store = AssetStore(source.bodies)
        with EpisodeFile(source.accepted(source.recipe())[0]) as file:
            self._episode, self._images = file.read(), stored_images(file)

    def functions(self) -> Mapping[str, Callable[..., Any]]:
        """What stands in place of the functions of pipeline.run.slot.fill."""
        return {
            "attempt": self.attempt,
            "draw": self.draw,
            "episode_of": self.episode_of,
            "renew": self.renew,
        }

    def attempt(self, spec: EpisodeSpec, recipe: Recipe, demonstrator: Demonstrator) -> _Rollout:
        """A rollout, or a Failure, as the spec's own random numbers will have it."""
        chance = spec.rng("chaos")
        time.sleep(LONGEST * chance.random() / 2)
        if chance.random() < FAILING:
            raise Failure("dry_run", "no_path", "drawn by lot")
        return _Rollout(
            _Scene(spec), _Replay(self._episode.log), motion_from_json(self._episode.motion), 900
        )

    def draw(self, dataset: Dataset, scene: _Scene, log: StateLog, recipe: Recipe) -> Images:
        """The stored images, with an asset more that no other slot has."""
        time.sleep(LONGEST * scene.spec.rng("chaos/images").random() / 2)
        store, drawing = AssetStore(dataset.bodies), self._images.drawing
        for key in drawing.assets.values():
            store.copy(key, self._store)
        own = store.put({"numbers": scene.spec.rng("chaos/asset").random(1000)}, {})
        return replace(
            self._images,
            drawing=drawing.model_copy(update={"assets": drawing.assets | {"chaos": own}}),
        )

    def renew(self, *_: Any) -> SlotRecord:
        """The scene of a slot would not have the assets of the stored episode: its slot is made
        from nothing instead."""
        raise EpisodeError("is not drawn again")

    def episode_of(
        self, rollout: _Rollout, recipe: Recipe, drawing: Drawing, keys: SlotKeys
    ) -> Episode:
        """The stored episode under another spec."""
        spec = rollout.scene.spec
        changed: dict[str, Any] = {
            "drawing": drawing,
            "physics_id": physics_id(spec, self._episode.log),
            **keys.header(),
        }
        return replace(self._episode, spec=spec, meta=self._episode.meta.model_copy(update=changed))


def fill_stored(job: FillJob) -> Steps[SlotRecord]:
    """The work of a build, with stages of a stored episode."""
    if filling.attempt is stages.attempt:  # at the first job of this process
        for name, function in Stored(Dataset(Path(os.environ[STORED]))).functions().items():
            setattr(filling, name, function)
    return fill_in_steps(job)


def build_here(root: Path, recipe: Recipe, stored: Path) -> None:
    """Build in this process, without the report."""
    os.environ[STORED] = str(stored)
    building.fill_in_steps = fill_stored
    building.build(root, recipe, Crew(), shown="none")


def main() -> None:
    """Run the command."""
    building.fill_in_steps = fill_stored
    cli.main()


if __name__ == "__main__":
    main()
