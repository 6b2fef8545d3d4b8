"""The task's script as a source of actions at the control rate: rehearsed, or planned live in a
trial."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from pipeline.data.clock import PHYSICS_HZ
from pipeline.data.setup.rules import Rules
from pipeline.data.spec import EpisodeSpec
from pipeline.expert.actor import Actor, Skill
from pipeline.motion.planar import PlanarMotion
from pipeline.planning.failure import PlanFailure
from pipeline.poses import Floats, Pose, compose, inverse
from pipeline.stages.failure import Failure
from pipeline.stages.scene import Scene


@dataclass(frozen=True, eq=False)
class Rehearsal:
    """The first half of a script (`meet`) for a target that stands at `aim` (7,).

    `actions` (T,A), one a control period; `last_skill` is the period in which the skill begins that
    meets the target; `meeting` (s) the first touch, or the end without one; `held` what was in
    which hand then.
    """

    aim: Pose
    actions: Floats
    last_skill: int
    meeting: float
    held: dict[str, str]


def rehearse(scene: Scene, aim: Pose, fps: int) -> Rehearsal | None:
    """Plan and run `meet` in a copy of the scene whose target stands at `aim` (7,); None without a
    plan. The latest results are cached."""
    return _rehearse(_SceneKey(scene.spec, scene.rules, scene), tuple(map(float, aim)), fps)


@dataclass(frozen=True)
class _SceneKey:
    """The spec and the rules decide the scene."""

    spec: EpisodeSpec
    rules: Rules
    scene: Scene = field(compare=False)


@lru_cache(maxsize=32)
def _rehearse(key: _SceneKey, at: tuple[float, ...], fps: int) -> Rehearsal | None:
    scene, aim, task = key.scene, np.array(at), key.scene.task
    # the expert's own stream: with the target at the manipulation pose this is the expert's plan
    actor_rng = "dry_run"
    try:
        actor = with_target_at(scene, aim).start(PlanarMotion.still(aim, 1.0), fps, actor_rng)
        began = 0
        for skill in task.meet(actor):
            began = actor.simulation.steps
            actor.perform(skill)
    except (Failure, PlanFailure):
        return None
    actions = at_control_rate(np.array(actor.stream.commands), PHYSICS_HZ // fps)
    actions.setflags(write=False)
    meeting = next(
        (e.time for e in actor.simulation.events if e.name == "meeting"), actor.simulation.time
    )
    return Rehearsal(aim, actions, began // (PHYSICS_HZ // fps), meeting, dict(actor.held))


def with_target_at(scene: Scene, aim: Pose) -> Scene:
    """The scene with its target, and what lies in it, moved so that the target stands at `aim`
    (7,)."""
    target, bodies = scene.task.target, dict(scene.bodies)
    moved = compose(aim, inverse(bodies[target].pose))
    for name, body in scene.bodies.items():
        if target in (name, body.inside):
            bodies[name] = replace(body, pose=compose(moved, body.pose))
    return replace(scene, bodies=bodies)


def live(actor: Actor, skills: Iterator[Skill], fps: int) -> Iterator[Floats]:
    """Motions, actions (N,A), of skills planned one after another from the state the simulation has
    then, until a plan fails. Ask for the next motion only after the last one was executed."""
    try:
        for skill in skills:
            for step in skill(actor):
                yield at_control_rate(actor.commands(step)[0], PHYSICS_HZ // fps)
    except PlanFailure:
        return


def at_control_rate(commands: Floats, every: int) -> Floats:
    """The last of every `every` rows (N,A), the last row standing for a period that has begun."""
    index = np.minimum(np.arange(every, len(commands) + every, every), len(commands)) - 1
    return commands[index]
