"""One closed-loop episode, driven one control period at a time."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.data.cameras import visible
from pipeline.data.clock import DEFAULT_FPS, PHYSICS_HZ, at_rate
from pipeline.data.episode.events import spans
from pipeline.data.episode.state_log import CONTACT_DTYPE, StateLog
from pipeline.data.names import HEAD
from pipeline.data.setup import DEFAULT, Setup
from pipeline.evaluate.actions import check_action, interpolate_targets, joint_limits
from pipeline.expert.actor import Actor
from pipeline.poses import Floats, Floats32, Pixels, inverse, transform
from pipeline.stages.drawing.exposure import Lapses, photograph
from pipeline.stages.drawing.render import appearance_of, renderer
from pipeline.stages.scene import Scene
from pipeline.tasks import middle
from pipeline.tasks.language.sentences import instructions
from pipeline.tasks.outcome import Outcome, failed
from pipeline.world.cameras import cameras_of, check_links
from pipeline.world.drawing.sensing import point_clouds
from pipeline.world.physics.recorder import Recorder
from pipeline.world.physics.simulation import Motion, Simulation

SUCCESS, OUT_OF_VIEW, TIME_LIMIT = "success", "out_of_view", "time_limit"

INVALID_ACTION, NO_ANSWER = "invalid_action", "no_answer"
FAULTS = (INVALID_ACTION, NO_ANSWER)
"""Endings by a fault of the policy: its answer is no action, or there is none."""

HOLD_FRAMES = 3
"""Control periods of DEFAULT_FPS for which all conditions hold, at every physics step."""


class Trial:
    """A settled simulation under a policy. `ending` is "" while it runs.

    Success: all conditions hold for HOLD_FRAMES after the first touch, at every physics step
    (under domino rules at one frame). Failure: a target that moves by itself leaves the head
    camera's image, or the step limit. Raises Failure("unstable") without an `actor`."""

    def __init__(
        self, scene: Scene, motion: Motion, setup: Setup = DEFAULT, actor: Actor | None = None
    ) -> None:
        fps = setup.fps
        self.scene, self.motion, self.fps = scene, motion, fps
        self.actor = actor or scene.start(motion, fps, "evaluate")
        self.simulation, self.recorder = self.actor.simulation, self.actor.recorder
        self.watch = StepConditions(scene, self.simulation, self.recorder)
        self.limits = joint_limits(scene.embodiment)
        self.per_period = PHYSICS_HZ // fps
        self.max_steps = scene.task.step_limit * (PHYSICS_HZ // DEFAULT_FPS)
        self.ending, self.left_workspace = "", False
        self._commands, self._waited = list[Floats](), 0
        self._known: tuple[int, dict[str, bool]] = (-1, {})
        self._held = 0
        self._enough = 1 if scene.rules.name == "domino" else at_rate(HOLD_FRAMES, fps)
        body = scene.bodies[scene.task.target]
        self._head = cameras_of(scene.embodiment, setup.camera)[0]
        self._middle = transform(inverse(body.pose), middle(body.pose, body.instance))

    @property
    def time(self) -> float:
        return self.simulation.time

    @property
    def length(self) -> int:
        return len(self.limits.names)

    def advance(self, action: Floats) -> None:
        """One control period: drive targets go linearly to `action` (A,), clipped to the limits.
        Raises ActionError."""
        action = check_action(action, self.length)
        self._commands.append(np.array([self._waited, *action]))
        self._waited = 0
        rows, velocity = self.targets(action)
        for row in rows:
            if self.ending:
                return
            self._step(row, velocity)

    def targets(self, action: Floats) -> tuple[Floats, Floats]:
        """Drive targets (steps,A) of a control period, and their velocity (A,)."""
        before, seconds = self.simulation.command, self.per_period / PHYSICS_HZ
        target = self.limits.clipped(action, before, seconds)
        return interpolate_targets(before, target, self.per_period, seconds)

    def hold(self, steps: int) -> None:
        """Advance by physics steps while the robot keeps its last command."""
        still = np.zeros(self.length)
        self._waited += steps
        for _ in range(steps):
            if self.ending:
                return
            self._step(self.simulation.command, still)

    def end(self, fault: str) -> None:
        self.ending = fault

    @property
    def commanded(self) -> Floats:
        """Commands (T,1+A): physics steps held, then an action; perhaps a last row of NaN."""
        last = [np.array([self._waited, *[np.nan] * self.length])] if self._waited else []
        return np.array([*self._commands, *last]).reshape(-1, 1 + self.length)

    def repeat(self, commands: Floats) -> None:
        for held, *action in commands:
            self.hold(int(held))
            if not self.ending and np.isfinite(action).all():
                self.advance(np.array(action))

    def log(self) -> StateLog:
        return self.recorder.log()

    def conditions(self) -> dict[str, bool]:
        if self._known[0] != self.simulation.steps:
            self._known = (self.simulation.steps, self.watch.conditions())
        return self._known[1]

    def _step(self, command: Floats, velocity: Floats) -> None:
        self.simulation.step(command, velocity)
        self.recorder.after_step()
        self.watch.after_step()
        if self.simulation.steps % self.per_period == 0:
            self._judge()
        elif self._held and failed(self.conditions()):
            self._held = 0

    def _judge(self) -> None:
        simulation, task = self.simulation, self.scene.task
        if simulation.touched_by:
            self._held = self._held + 1 if not failed(self.conditions()) else 0
        if not simulation.released:
            at = simulation.pose(task.target)
            self.left_workspace |= not bool(task.workspace.contains(at[:3]))
            if not visible(self._head.type, self._head.pose, transform(at, self._middle)):
                self.ending = OUT_OF_VIEW
                return
        if self._held >= self._enough:
            self.ending = SUCCESS
        elif simulation.steps >= self.max_steps:
            self.ending = TIME_LIMIT


class Watched(Outcome):
    """The highest rises of every step; `peaks` (m) are heights of origins by body."""

    def __init__(self, scene: Scene, log: StateLog, peaks: Mapping[str, float]) -> None:
        super().__init__(log, scene.bodies, scene.embodiment, scene.task.target, scene.rules)
        self.peaks = peaks

    def highest_rise(self, name: str) -> float:
        recorded = super().highest_rise(name)
        return max(recorded, self.peaks.get(name, -np.inf) - float(self.pose(name, 0)[2]))


class StepConditions:
    def __init__(self, scene: Scene, simulation: Simulation, recorder: Recorder) -> None:
        self._scene, self._simulation, self._recorder = scene, simulation, recorder
        # only the condition `was_lifted` asks for heights between frames
        lifted = [scene.task.manipulated] if "lift" in scene.task.limits else []
        self._peaks = dict.fromkeys(lifted, -np.inf)

    def after_step(self) -> None:
        for name, peak in self._peaks.items():
            self._peaks[name] = max(peak, float(self._simulation.pose(name)[2]))

    def conditions(self) -> dict[str, bool]:
        """The conditions now: on the recorded frames and the state of this step."""
        log, simulation = self._recorder.log(), self._simulation
        if simulation.time > log.times[-1] + 1e-9:
            log = with_frame(log, simulation)
        scene, log = self._scene.by_role(log)
        return scene.task.conditions(Watched(scene, log, self._peaks), scene.arms)


def with_frame(log: StateLog, simulation: Simulation) -> StateLog:
    qpos, qvel = simulation.qpos()
    twist = simulation.target_twist()
    spin = log.target_angular_velocity
    spin = None if spin is None else _and(spin, twist[3:])
    touching = [(len(log), *contact) for contact in simulation.contacts()]
    return replace(
        log,
        times=np.append(log.times, simulation.time),
        poses=_and(log.poses, simulation.poses()),
        qpos=_and(log.qpos, qpos),
        qvel=_and(log.qvel, qvel),
        state=_and(log.state, simulation.state_vector(qpos)),
        action=np.concatenate([log.action[:-1], [simulation.command] * 2]),
        tcp=_and(log.tcp, np.stack([simulation.tcp(side) for side in log.sides])),
        target_velocity=_and(log.target_velocity, twist[:3]),
        target_angular_velocity=spin,
        contacts=np.concatenate([log.contacts, np.array(touching, dtype=CONTACT_DTYPE)]),
    )


def _and(rows: Floats, row: Floats) -> Floats:
    return np.concatenate([rows, row[None]])


@dataclass(eq=False)
class CameraViews:
    images: dict[str, Pixels] = field(default_factory=dict[str, Pixels])
    depth: dict[str, NDArray[np.uint16]] = field(default_factory=dict[str, NDArray[np.uint16]])
    segmentation: dict[str, Pixels] = field(default_factory=dict[str, Pixels])
    pointcloud: Floats32 | None = None


class Eyes:
    def __init__(self, scene: Scene, setup: Setup) -> None:
        appearance = appearance_of(scene, setup)
        check_links(appearance.cameras, [*appearance.bodies, "table"])
        self._renderer, self._setup, self._sensing = renderer(appearance), setup, appearance.sensing
        self._events = appearance.events

    def look(self, recorder: Recorder) -> CameraViews:
        setup, past = self._setup, recorder.past
        poses = {name: past[:, i] for i, name in enumerate(recorder.simulation.names)}
        sensors = {"depth": setup.depth or setup.pointcloud, "segmentation": setup.segmentation}
        lapses = Lapses(spans(self._events, recorder.simulation.events), setup.fps)
        views = photograph(self._renderer, poses, [len(past) - 1], self._sensing, lapses, **sensors)
        seen = CameraViews({view.camera.name: view.rgb[0] for view in views})
        for view in views:
            if setup.depth and view.depth is not None:
                seen.depth[view.camera.name] = view.depth[0]
            if view.segmentation is not None:
                seen.segmentation[view.camera.name] = view.segmentation[0]
            if setup.pointcloud and view.camera.name == HEAD:
                seen.pointcloud = point_clouds(view)[0]
        return seen

    def close(self) -> None:
        self._renderer.close()


def instruction_now(trial: Trial, split: str, words: str) -> str:
    """The instruction of an episode that began with `words`, or what an event made of it."""
    roles = trial.simulation.roles
    return instruction_of(trial.scene.give_roles(roles), split) if roles else words


def instruction_of(scene: Scene, split: str = "unseen") -> str:
    if scene.sentences:
        return scene.sentences[split]
    return instructions(scene.wording(), scene.spec.rng("language"), 1)[split][0]
