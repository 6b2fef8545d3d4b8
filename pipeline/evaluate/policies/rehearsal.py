"""A script tried in a still copy of a scene, also with like bodies in each other's roles."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from pipeline.data.clock import PHYSICS_HZ
from pipeline.data.setup.rules import Rules
from pipeline.data.spec import EpisodeSpec
from pipeline.evaluate.scenes.trial import Trial
from pipeline.expert.actor import Actor, Skill
from pipeline.motion.planar import PlanarMotion
from pipeline.motion.wrapped import others_of
from pipeline.planning.failure import PlanFailure
from pipeline.poses import Floats, Pose, compose, inverse
from pipeline.stages.failure import Failure
from pipeline.stages.scene import Scene
from pipeline.world.objects.contract import Family
from pipeline.world.physics.events import SWAPPED


@dataclass(frozen=True, eq=False)
class Rehearsal:
    """The first half of a script for a target at `aim` (7,). `actions` (T,A) are one a control
    period; `meeting` (s) is the first touch, or the end; `held` what was in which hand then."""

    aim: Pose
    actions: Floats
    last_skill: int
    meeting: float
    held: dict[str, str]


def rehearse(scene: Scene, aim: Pose, fps: int) -> Rehearsal | None:
    """Plan and run `meet` with the target at `aim` (7,); None without a plan."""
    places = tuple(map(float, np.concatenate([body.pose for body in scene.bodies.values()])))
    instances = tuple(body.instance for body in scene.bodies.values())
    key = _SceneKey(scene.spec, scene.rules, places, instances, scene)
    return _rehearse(key, tuple(map(float, aim)), fps)


@dataclass(frozen=True)
class _SceneKey:
    spec: EpisodeSpec
    rules: Rules
    places: tuple[float, ...]
    instances: tuple[Family, ...]
    scene: Scene = field(compare=False)


@lru_cache(maxsize=32)
def _rehearse(key: _SceneKey, at: tuple[float, ...], fps: int) -> Rehearsal | None:
    scene, aim, task = key.scene, np.array(at), key.scene.task
    try:
        # the expert's own stream: with the target at the manipulation pose this is its plan
        actor = with_target_at(scene, aim).start(PlanarMotion.still(aim, 1.0), fps, "dry_run")
        began = 0
        for skill in task.meet(actor):
            began = actor.simulation.steps
            actor.perform(skill)
    except (Failure, PlanFailure):
        return None
    actions = at_control_rate(np.array(actor.stream.commands), PHYSICS_HZ // fps)
    actions.setflags(write=False)
    met = (e.time for e in actor.simulation.events if e.name == "meeting")
    meeting = next(met, actor.simulation.time)
    return Rehearsal(aim, actions, began // (PHYSICS_HZ // fps), meeting, dict(actor.held))


def with_target_at(scene: Scene, aim: Pose) -> Scene:
    """The target, and what lies in it, moved to `aim` (7,)."""
    target, bodies = scene.task.target, dict(scene.bodies)
    moved = compose(aim, inverse(bodies[target].pose))
    for name, body in scene.bodies.items():
        if target in (name, body.inside):
            bodies[name] = replace(body, pose=compose(moved, body.pose))
    return replace(scene, bodies=bodies)


def live(actor: Actor, skills: Iterator[Skill], fps: int) -> Iterator[Floats]:
    """Motions, actions (N,A). Ask for the next only after the last was executed."""
    try:
        for skill in skills:
            for step in skill(actor):
                yield at_control_rate(actor.commands(step)[0], PHYSICS_HZ // fps)
    except PlanFailure:
        return


def at_control_rate(commands: Floats, every: int) -> Floats:
    """The last of every `every` rows (N,A)."""
    index = np.minimum(np.arange(every, len(commands) + every, every), len(commands)) - 1
    return commands[index]


FIRST_GUESSES = (2.0, 1.0, 3.0)
"""s; when the robot may meet the target: its place then may be out of reach."""


def meeting_plan(scene: Scene, fps: int, ahead: Callable[[float], Pose]) -> Rehearsal | None:
    """The rehearsal, within 2 mm, for a target at `ahead(seconds)` (7,) from now, or None."""
    tried = (rehearse(scene, ahead(guess), fps) for guess in FIRST_GUESSES)
    plan = next((rehearsal for rehearsal in tried if rehearsal), None)
    for _ in range(5):
        if plan is None or np.linalg.norm(ahead(plan.meeting)[:3] - plan.aim[:3]) < 0.002:
            break
        plan = rehearse(scene, ahead(plan.meeting), fps) or plan
    return plan


def alike(scene: Scene) -> list[str]:
    for name in (scene.task.target, scene.task.manipulated):
        family = scene.bodies[name].family
        aside = {SWAPPED, *scene.clutter}
        own = (n for n in scene.bodies if n not in aside and not scene.bodies[n].fixed)
        if len(names := [n for n in own if scene.bodies[n].family == family]) > 1:
            return names
    return []


def guess_roles(scene: Scene, seed: int) -> tuple[Scene, str]:
    """The scene with like bodies in guessed roles, and its target; the scene itself if right."""
    names, task = alike(scene), scene.task
    order = np.random.default_rng([seed, 3]).permutation(len(names))
    takes = {name: names[i] for name, i in zip(names, order, strict=True)}
    roles = {name: replace(scene.bodies[other], name=name) for name, other in takes.items()}
    asked, bodies = takes.get(task.target, task.target), scene.bodies | roles
    if asked == task.target and task.choices(bodies) == scene.choices:
        return scene, asked
    return replace(scene, bodies=bodies, arms=task.arms(bodies)), asked


def sight_of(trial: Trial, name: str) -> tuple[Pose, Floats]:
    """Pose (7,) and velocity (3,) of the target or what moves beside it."""
    simulation = trial.simulation
    others = others_of(simulation.motion)
    twist = others[name].twist(trial.time) if name in others else simulation.target_twist()
    return simulation.pose(name), np.array(twist[:3], float)
