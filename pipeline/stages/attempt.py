"""One attempt at one spec: the three stages in a row. What an attempt costs is measured by phase."""

import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from pipeline.data.recipe import Recipe
from pipeline.data.spec import EpisodeSpec
from pipeline.motion.target_motion import TargetMotion
from pipeline.stages.back_calculate import back_calculate
from pipeline.stages.dry_run import dry_run
from pipeline.stages.failure import Failure
from pipeline.stages.replay import Replay, replay
from pipeline.stages.scene import Scene, build_scene


class Phases:
    """Seconds spent per phase, of wall time and of this process's processor time."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self.cpu: dict[str, float] = defaultdict(float)

    @contextmanager
    def __call__(self, name: str) -> Iterator[None]:
        began, worked = time.perf_counter(), time.process_time()
        try:
            yield
        finally:
            self.seconds[name] += time.perf_counter() - began
            self.cpu[name] += time.process_time() - worked

    def record(self) -> dict[str, float]:
        """For the ledger: wall seconds by phase, processor seconds under the same names with ".cpu"."""
        return dict(self.seconds) | {f"{name}.cpu": seconds for name, seconds in self.cpu.items()}


@dataclass(eq=False)
class Rollout:
    """An accepted attempt before it has images."""

    scene: Scene
    motion: TargetMotion
    meeting: float
    replay: Replay
    steps: int


def attempt(spec: EpisodeSpec, recipe: Recipe, phases: Phases) -> Rollout:
    """The three stages for one spec. Raises Failure, with `steps` set to the physics steps spent and `drawn` to what was drawn."""
    steps, drawn = 0, None
    try:
        with phases("scene"):
            scene = build_scene(spec, recipe.ruling())
        with phases("dry_run"):
            dry = dry_run(scene, recipe.fps)
        steps = dry.steps
        with phases("back_calculate"):
            motion = back_calculate(scene, dry, camera=recipe.camera, lead=recipe.lead, speed_bound=recipe.speed_bound)
        drawn = motion.features()
        with phases("replay"):
            done = replay(scene, dry, motion, recipe.fps)
    except Failure as failure:
        failure.steps += steps
        failure.drawn = failure.drawn or drawn
        raise
    return Rollout(scene, motion, dry.meeting, done, steps + done.steps)
