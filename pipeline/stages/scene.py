"""What follows from a spec before physics starts."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from pipeline.data.cameras import visible
from pipeline.data.episode.events import DrawnEvent, by_role, draw_events, exchanged
from pipeline.data.episode.state_log import StateLog
from pipeline.data.episode.visuals import Visuals
from pipeline.data.setup.rules import STRICT, Rules
from pipeline.data.spec import EpisodeSpec
from pipeline.expert.actor import Actor
from pipeline.motion.scenery import Prop
from pipeline.planning.failure import PlanFailure
from pipeline.poses import Bools, Floats
from pipeline.tasks import TASKS, Draw, Task, lay_out
from pipeline.tasks.contract import TRACKING
from pipeline.tasks.language.sentences import Wording
from pipeline.tasks.layout import others_asked, replacement, suits
from pipeline.tasks.outcome import Outcome, failed
from pipeline.world.cameras import cameras_of
from pipeline.world.physics.body import Body
from pipeline.world.physics.drive import Hold, ImperfectDrives
from pipeline.world.physics.events import SWAPPED, EventScript, in_roles
from pipeline.world.physics.recorder import Recorder
from pipeline.world.physics.simulation import PHYSICS_HZ, Motion, Simulation
from pipeline.world.robots.contract import Embodiment

from .failure import Failure
from .surroundings import clutter, embodiment_of, occluded, stance_of


def held_by(task: Task, embodiment: Embodiment) -> Hold:
    """What holds a task's target: both fingers of a hand, or in a tracking task the body brought to
    it or any link.
    """
    arms = embodiment.arms.items()
    if task.category != TRACKING:
        hands = ([frozenset({f"{s}_{finger}"}) for finger in a.gripper.fingers] for s, a in arms)
        return Hold(tuple(map(tuple, hands)))
    if task.manipulated != task.target:
        return Hold(((frozenset({task.manipulated}),),))
    return Hold(((frozenset(f"{side}_{link.name}" for side, arm in arms for link in arm.links),),))


FRAME_MARGIN = 4.0  # pixels between the target and the border of the head camera's image (D435)


@dataclass(frozen=True, eq=False)
class Scene:
    """A spec with its task, robot, and bodies at their manipulation poses. `clutter` names the last
    bodies; `scenery` is only seen.
    """

    spec: EpisodeSpec
    task: Task
    embodiment: Embodiment
    bodies: dict[str, Body]
    arms: dict[str, str]
    clutter: tuple[str, ...] = ()
    rules: Rules = STRICT
    scenery: tuple[Prop, ...] = ()
    looks: Visuals | None = None
    sentences: Mapping[str, str] = field(default_factory=dict[str, str])

    def furnished(self, motion: Motion) -> "Scene":
        script = self._script(motion)
        return replace(self, scenery=(*motion.scenery(), *(script.props if script else ())))

    @cached_property
    def events(self) -> tuple[DrawnEvent, ...]:
        """The events of the rules, drawn from streams of their own."""
        spec, asked = self.spec, self.rules.events
        return tuple(
            event.model_copy(update={"body": self._taking_over(event)})
            for event in (
                draw_events(asked, spec.rng("events"), spec.slot_rng("events")) if asked else ()
            )
        )

    def _taking_over(self, event: DrawnEvent) -> str:
        """The body that takes the target's role in an event, "" for none."""
        if event.kind == "swap" and SWAPPED in self.bodies:
            return SWAPPED
        if event.kind == "instruction":
            names = others_asked(self.task, self.bodies, self.embodiment.sides)
            return names[int(event.turn / (2 * np.pi) * len(names))] if names else ""
        return ""

    def give_roles(self, roles: Mapping[str, str]) -> "Scene":
        """The scene in which the bodies `roles` have the roles of the keys. What is swapped stands
        where the other did."""
        if not roles:
            return self
        bodies = in_roles(self.bodies, roles)
        return replace(self, bodies=bodies, arms=self.task.arms(bodies), sentences={})

    def by_role(self, log: StateLog) -> tuple["Scene", StateLog]:
        """The scene at the end of a log, and the log, with the names of roles for bodies."""
        target, span = self.task.target, exchanged(self.events, log.events)
        if span is None:
            return self, log
        roles = {target: span.event.body, span.event.body: target}
        return self.give_roles(roles), by_role(log, self.events, target)

    def _script(self, motion: Motion) -> EventScript | None:
        if not self.events:
            return None
        meeting = float(getattr(motion, "duration", np.inf))
        withheld = [self.spec.withholds(number) for number in range(len(self.events))]
        eye = self.embodiment.head_camera
        return EventScript(self.events, eye, meeting, goal=self.goal, withheld=withheld)

    @property
    def goal(self) -> str:
        """The body that an event moves as the goal: neither target, nor handled, nor in another."""
        own = (self.task.target, self.task.manipulated, SWAPPED, *self.clutter)
        bodies = (name for name, body in self.bodies.items() if name not in own)
        return next((name for name in bodies if not self.bodies[name].inside), "")

    def start[A: Actor](self, motion: Motion, fps: int, purpose: str, expert: type[A] = Actor) -> A:
        """A settled simulation with its recorder and expert. Raises Failure("unstable")."""
        contact = self.rules.after_touch(self.task.category)
        after = held_by(self.task, self.embodiment) if contact == "hold" else contact
        imperfect = None
        if self.rules.drive:
            # a plan is played back with other errors of drives than it was made with
            stream = self.spec.rng("drive/dry_run" if purpose == "dry_run" else "drive")
            imperfect = ImperfectDrives(self.rules.drive, self.embodiment, stream)
        simulation = Simulation(
            self.embodiment,
            tuple(self.bodies.values()),
            self.task.target,
            motion,
            after_touch=after,
            clutter=self.clutter,
            imperfect=imperfect,
            script=None if purpose == "dry_run" else self._script(motion),
        )
        if not simulation.settle():
            why = f"a body still moves, or touches {self.task.target}, before the start"
            raise Failure(purpose, "unstable", why)
        return expert(
            simulation,
            Recorder(simulation, fps),
            self.bodies,
            self.arms,
            self.spec.rng(f"planning/{purpose}"),
            self.task.step_limit,
        )

    def sees(self, points: Floats, camera: str = "D435") -> Bools:
        """Which world points (...,3) the head camera sees, with a margin."""
        head = cameras_of(self.embodiment, camera)[0]
        blockers = [self.bodies[name] for name in self.clutter]
        in_view = visible(head.type, head.pose, points, FRAME_MARGIN)
        return in_view & ~occluded(blockers, head.pose, points)

    def outcome(self, log: StateLog) -> Outcome:
        scene, log = self.by_role(log)
        return Outcome(log, scene.bodies, self.embodiment, self.task.target, self.rules)

    def wording(self) -> Wording:
        """What the instructions are made from."""
        own = (name for name in self.bodies if name not in self.clutter)
        words = {name: self.bodies[name].instance.words() for name in own}
        task, moving = self.task, self.spec.moving
        return Wording(task.seen, task.unseen, words, self.arms, moving, self.choices)

    @property
    def choices(self) -> dict[str, str]:
        """The words by slot that name what is asked for in this scene."""
        return self.task.choices(self.bodies)

    def conditions(self, log: StateLog) -> dict[str, bool]:
        """The success conditions at the end of the log, by name."""
        return self.task.conditions(self.outcome(log), self.by_role(log)[0].arms)

    def condition_history(self, log: StateLog) -> dict[str, Bools]:
        """Conditions (T,) by name for the log cut after each frame."""
        outcome, arms = self.outcome(log), self.by_role(log)[0].arms
        rows = [
            self.task.conditions(outcome.until(frames), arms) for frames in range(1, len(log) + 1)
        ]
        return {name: np.array([row[name] for row in rows], bool) for name in rows[-1]}

    def succeeded(self, log: StateLog) -> bool:
        return not failed(self.conditions(log))


def spare(
    spec: EpisodeSpec, task: Task, bodies: Mapping[str, Body], rules: Rules
) -> dict[str, Body]:
    """The body that waits for a swap, if the rules have one. Raises PlanFailure("layout")."""
    if not any("swap" in event.kinds for event in rules.events):
        return {}
    return {SWAPPED: replacement(task, bodies, spec.rng("events/swap"))}


def build_scene(spec: EpisodeSpec, rules: Rules = STRICT) -> Scene:
    """Lay out a spec's scene: a pure function. Raises Failure("layout")."""
    task = TASKS[spec.task]
    embodiment = embodiment_of(spec, rules.layout, stance_of(spec))
    head = cameras_of(embodiment)[0]
    draw = Draw(spec.rng("objects"), spec.rng("placement"), rules.within(spec.task))
    try:
        bodies = lay_out(
            task,
            draw,
            lambda point: bool(visible(head.type, head.pose, point, FRAME_MARGIN)),
            lambda bodies: suits(task, bodies, embodiment.sides),
        )
        bodies |= spare(spec, task, bodies, rules)
    except PlanFailure as failure:
        raise Failure("layout", failure.reason, str(failure)) from failure
    others = clutter(spec, bodies, embodiment, rules)
    return Scene(spec, task, embodiment, bodies | others, task.arms(bodies), tuple(others), rules)


def success_time(scene: Scene, log: StateLog) -> float | None:
    """Time (s) from which all success conditions hold until the end, or None."""
    outcome, arms, since = scene.outcome(log), scene.by_role(log)[0].arms, None
    for frames in range(len(log), 0, -1):
        if failed(scene.task.conditions(outcome.until(frames), arms)):
            break
        since = float(log.times[frames - 1])
    return since


def rest(actor: Actor, task: Task, seconds: float = 0.4) -> None:
    """Hold still after a script, so that bodies come to rest."""
    actor.simulation.release()
    actor.wait(seconds)
    actor.wait((-actor.simulation.steps % (PHYSICS_HZ // actor.recorder.fps)) / PHYSICS_HZ)
