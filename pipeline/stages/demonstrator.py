"""A demonstrator does the third stage of an attempt, once a motion of the target is found that fits
the dry run."""

from dataclasses import dataclass
from typing import Any, Protocol

from pipeline.data.rules import Sight
from pipeline.data.setup import Setup
from pipeline.motion.contract import TargetMotion
from pipeline.stages.dry_run import DryRun
from pipeline.stages.react import react
from pipeline.stages.replay import Replay, replay
from pipeline.stages.scene import Scene


class Demonstrator(Protocol):
    """Does the third stage of an attempt."""

    def describe(self) -> dict[str, Any]:
        """The names that an episode has of it: `expert` and `corrects` of EpisodeMeta."""
        ...

    def check(self) -> None:
        """Raise PolicyError if it cannot act, before anything is written."""

    def show(self, scene: Scene, dry: DryRun, motion: TargetMotion, fps: int) -> Replay:
        """The rollout of a scene whose target moves so. Raises Failure."""
        ...


@dataclass(frozen=True)
class Planned:
    """The planned expert, which knows where and when it meets the target."""

    def describe(self) -> dict[str, Any]:
        """An expert alone."""
        return {"expert": "planned"}

    def check(self) -> None:
        """It can always act."""

    def show(self, scene: Scene, dry: DryRun, motion: TargetMotion, fps: int) -> Replay:
        """As stages/replay.py."""
        return replay(scene, dry, motion, fps)


@dataclass(frozen=True)
class Reactive:
    """The reactive expert, which sees the past of the target through its `sight`."""

    sight: Sight

    def describe(self) -> dict[str, Any]:
        """An expert alone."""
        return {"expert": "reactive"}

    def check(self) -> None:
        """It can always act."""

    def show(self, scene: Scene, dry: DryRun, motion: TargetMotion, fps: int) -> Replay:
        """As stages/react.py."""
        return react(scene, motion, self.sight, fps)


def expert_of(setup: Setup) -> Demonstrator:
    """The expert that a setup names, whatever policy it corrects."""
    return Planned() if setup.reactive is None else Reactive(setup.reactive)
