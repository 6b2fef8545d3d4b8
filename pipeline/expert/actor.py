"""The expert in one simulation: measurements, and plans as physics."""

import inspect
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import wraps
from typing import Concatenate

import numpy as np

from pipeline.data.cameras import visible
from pipeline.data.clock import DEFAULT_FPS, PHYSICS_HZ
from pipeline.data.episode.state_log import SkillRun, StateLog
from pipeline.planning.collision import ArmState, Carried, Obstacle, PlanningScene
from pipeline.planning.failure import PlanFailure
from pipeline.planning.planner import ArmPlanner, Planner, planner_of
from pipeline.planning.trajectory import ArmTrajectory, smoothed
from pipeline.poses import Bools, Floats, Pose, compose, inverse
from pipeline.world.cameras import cameras_of
from pipeline.world.objects.contract import NamedFrames
from pipeline.world.physics.body import Body
from pipeline.world.physics.recorder import Recorder
from pipeline.world.physics.simulation import Simulation
from pipeline.world.shapes import Collider

MotionStep = dict[str, ArmTrajectory]
"""By side: trajectories that start together, the shorter holds its end."""

Steps = Iterator[MotionStep]
Skill = Callable[["Actor"], Steps]
"""Plans each motion step from the state that the last one led to. Raises PlanFailure."""

Skills = Iterator[Skill]  # half of a script


def skill[**P](
    *, arms: Sequence[str] = ("side",), body: str = "", part: str = ""
) -> Callable[[Callable[Concatenate["Actor", P], Steps]], Callable[P, Skill]]:
    """Decorator of a skill's steps: makes the skill from all arguments but the actor, and notes
    each run. `arms`, `body` and `part` name the parameters that have these."""

    def decorate(steps: Callable[Concatenate["Actor", P], Steps]) -> Callable[P, Skill]:
        name, signature = steps.__name__.rstrip("_"), inspect.signature(steps)

        @wraps(steps)
        def made(*args: P.args, **kwargs: P.kwargs) -> Skill:
            bound = signature.bind(None, *args, **kwargs)
            bound.apply_defaults()
            sides = tuple(bound.arguments[arm] for arm in arms)
            of = bound.arguments[body] if body else ""
            detail = bound.arguments[part] if part else None
            words = detail if isinstance(detail, str) else "/".join(detail or ())

            def note_run(a: "Actor") -> Steps:
                with a.noting(name, sides, of, words):
                    yield from steps(a, *args, **kwargs)

            return note_run

        return made

    return decorate


SWEEP_EVERY = 4  # physics steps between two poses of the sweep
SWEEP_HZ = PHYSICS_HZ / SWEEP_EVERY


@dataclass(eq=False)
class Stream:
    """Executed rows (A,) of drive targets and velocities, one a physics step."""

    commands: list[Floats] = field(default_factory=list)
    velocities: list[Floats] = field(default_factory=list)


class Actor:
    """One expert in one simulation. By role `arms` are sides; by side `held` is what it carries,
    `expected` its joints while the other arm is planned; by body `approaches` are the directions
    (3,) of its last grasp and `avoid` those of last resort."""

    def __init__(
        self,
        simulation: Simulation,
        recorder: Recorder,
        bodies: dict[str, Body],
        arms: dict[str, str],
        rng: np.random.Generator,
        step_limit: int,
    ) -> None:
        self.simulation, self.recorder, self.bodies, self.arms = simulation, recorder, bodies, arms
        self.planner: Planner = planner_of(simulation.embodiment)
        self.rng, self.max_steps = rng, step_limit * (PHYSICS_HZ // DEFAULT_FPS)
        self.held: dict[str, str] = {}
        self.expected: dict[str, Floats] = {}
        self.approaches: dict[str, Floats] = {}
        self.avoid: dict[str, list[Floats]] = {}
        self.stream = Stream()
        self.sweep: list[Floats] = [simulation.poses()]
        self.sweeping = False
        self.half, self._runs = "meet", list[SkillRun]()
        self._frames: dict[str, NamedFrames] = {}

    @property
    def steps(self) -> int:
        """Physics steps taken, settling included."""
        return self.simulation.steps + self.simulation.settle_steps

    def pose(self, name: str) -> Pose:
        return self.simulation.pose(name)

    def frames(self, name: str) -> NamedFrames:
        """Frames in the body's own coordinates."""
        if name not in self._frames:
            self._frames[name] = self.bodies[name].instance.frames()
        return self._frames[name]

    def frame(self, name: str, point: str) -> Pose:
        """Measured world pose (7,) of a named frame of a body."""
        return compose(self.pose(name), self.frames(name)[point])

    def tcp(self, side: str) -> Pose:
        """Commanded tcp pose (7,) of an arm."""
        return self.planner.fk(side, self.q(side))

    def q(self, side: str) -> Floats:
        """Commanded arm joints of a side."""
        return self.planner.split(self.simulation.command)[side][0]

    def gripper(self, side: str) -> float:
        """Commanded gripper value of a side, 0 closed to 1 open."""
        return self.planner.split(self.simulation.command)[side][1]

    def in_hand(self, side: str) -> Pose:
        """Measured pose (7,) in the tcp frame. Raises PlanFailure("empty_hand")."""
        if side not in self.held:
            raise PlanFailure("empty_hand", f"the {side} arm holds nothing")
        return compose(inverse(self.simulation.tcp(side)), self.pose(self.held[side]))

    def planning_scene(self) -> PlanningScene:
        """Arms as commanded and expected, bodies as measured but for those in another."""
        now = self.planner.split(self.simulation.command)
        expected = {s: np.array(self.expected.get(s, q)) for s, (q, _) in now.items()}
        arms = {s: ArmState(q.copy(), value, expected[s]) for s, (q, value) in now.items()}
        carried = {
            name: Carried(side, self.collision(name), self.in_hand(side))
            for side, name in self.held.items()
        }
        obstacles = {
            name: Obstacle(self.collision(name), self.pose(name))
            for name, body in self.bodies.items()
            if not body.rides and name not in carried
        }
        return PlanningScene(arms, obstacles, carried, self._sees)

    def _sees(self, points: Floats) -> Bools:
        """Which world points (N,3) the head camera, a D435, has in its image."""
        head = cameras_of(self.planner.embodiment)[0]
        return visible(head.type, head.pose, points)

    def arm_planner(self, side: str) -> ArmPlanner:
        return ArmPlanner(self.planner, side, self.planning_scene(), self.rng)

    def collision(self, name: str) -> tuple[Collider, ...]:
        """Collision pieces of a body in its own frame."""
        return self.bodies[name].instance.shape().collision

    @contextmanager
    def noting(self, skill: str, arms: tuple[str, ...], body: str, part: str) -> Iterator[None]:
        body = body or next((self.held[side] for side in arms if side in self.held), "")
        run = SkillRun(skill, arms, body, part, self.half, self.simulation.steps, -1)
        place = len(self._runs)  # runs within this one come after it
        self._runs.append(run)
        try:
            yield
        except PlanFailure as failure:
            context = ", ".join(filter(None, (*arms, body, part)))
            failure.skill = failure.skill or f"{self.half}: {skill} ({context})"
            raise
        finally:
            self._runs[place] = replace(run, end=self.simulation.steps)

    @property
    def skills(self) -> list[SkillRun]:
        """The runs of skills that executed a step, in order of their begin."""
        now = self.simulation.steps
        ended = [replace(run, end=now) if run.end < 0 else run for run in self._runs]
        return [run for run in ended if run.start < run.end]

    def log(self) -> StateLog:
        return replace(self.recorder.log(), skills=self.skills)

    def play(
        self,
        commands: Floats,
        velocities: Floats,
        skills: Sequence[SkillRun],
        until: Callable[[int], bool] = lambda row: False,
    ) -> bool:
        """Execute recorded rows (N,A) up to one for which `until` holds; whether there was one."""
        for row, (command, velocity) in enumerate(zip(commands, velocities, strict=True)):
            if until(row):
                self._runs += [
                    replace(run, end=min(run.end, row)) for run in skills if run.start < row
                ]
                return True
            self.advance(command, velocity)
        self._runs += skills
        return False

    def perform(self, skill: Skill) -> None:
        """Plan and execute a skill to its end. Raises PlanFailure."""
        for step in skill(self):
            self.execute(step)

    def execute(self, step: MotionStep) -> None:
        """Run trajectories together. Raises PlanFailure: step_limit, excess_force."""
        for command, velocity in zip(*self.commands(step), strict=True):
            self.advance(command, velocity)

    def commands(self, step: MotionStep) -> tuple[Floats, Floats]:
        """Drive targets and velocities (N,A) of a motion step, jerk limited."""
        length = max(len(trajectory.q) for trajectory in step.values())
        now = self.planner.split(self.simulation.command)
        columns, speeds = list[Floats](), list[Floats]()
        for side, (q, value) in now.items():
            own = step.get(side) or ArmTrajectory(q[None], np.zeros((1, len(q))), np.array([value]))
            pad = length - len(own.q)
            columns += [
                np.pad(own.q, ((0, pad), (0, 0)), mode="edge"),
                np.pad(own.gripper, (0, pad), mode="edge")[:, None],
            ]
            jaw = np.diff(own.gripper, prepend=value) * PHYSICS_HZ
            speeds += [np.pad(own.qd, ((0, pad), (0, 0))), np.pad(jaw, (0, pad))[:, None]]
        still = np.zeros(len(self.simulation.command))
        rows = smoothed(
            np.hstack([*columns, *speeds]), np.concatenate([self.simulation.command, still])
        )
        return rows[:, : len(still)], rows[:, len(still) :]

    def advance(self, command: Floats, velocity: Floats) -> None:
        """One physics step, recorded. Raises PlanFailure: step_limit, excess_force."""
        if self.simulation.steps >= self.max_steps:
            raise PlanFailure("step_limit", f"{self.max_steps} physics steps were not enough")
        self.simulation.step(command, velocity)
        self.recorder.after_step()
        self.stream.commands.append(command)
        self.stream.velocities.append(velocity)
        for one, other, force in self.simulation.overloads():
            why = f"{one} and {other} press on each other with {force:.0f} N"
            raise PlanFailure("excess_force", why)
        if self.sweeping and self.simulation.steps % SWEEP_EVERY == 0:
            self.sweep.append(self.simulation.poses())

    def wait(self, seconds: float) -> None:
        command = self.simulation.command
        for _ in range(round(seconds * PHYSICS_HZ)):
            self.advance(command, np.zeros(len(command)))
