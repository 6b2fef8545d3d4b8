"""A script planned in a still copy of what is seen."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple, cast

import numpy as np

from pipeline.data.clock import PHYSICS_HZ
from pipeline.data.episode.state_log import SkillRun
from pipeline.data.names import SIDES
from pipeline.expert.actor import Actor, MotionStep, Skill
from pipeline.planning.planner import Planner
from pipeline.poses import Floats, Pose, compose, inverse
from pipeline.world.physics.contacts import Overload
from pipeline.world.physics.recorder import Recorder
from pipeline.world.physics.simulation import Simulation

Script = Callable[[Actor], Iterator[Skill]]

PACE = 0.8
"""Share of the plan's speed in its last skill: the limiter has 36 % of the acceleration to catch
up. At full pace hands overshot by 15 mm."""

STIRS = 1e-3  # rad or m; an arm whose joints all move less is still


@dataclass(frozen=True, eq=False)
class MeetingPlan:
    """Commands (N,A) at the physics rate, and their velocities, that meet a target at `aim` (7,).
    The turn of a round one about its axis is no matter.

    The last skill begins in row `last`; its first motion ends in `near`, its last in `met`. `sides`
    move in it, `holding` is what each hand holds at its start. `runs` are on the clock of the rows.
    """

    aim: Pose
    is_round: bool
    commands: Floats
    velocities: Floats
    last: int
    near: int
    met: int
    sides: tuple[str, ...]
    runs: tuple[SkillRun, ...]
    held: Mapping[str, str]
    approaches: Mapping[str, Floats]
    holding: Mapping[str, str]

    @property
    def seconds(self) -> float:
        """Duration (s) of the last skill until the hand is at the target."""
        return (self.met - self.last) / (PACE * PHYSICS_HZ)


class _Still:
    """A simulation's stand-in that reaches commands at once."""

    def __init__(self, actor: Actor, planner: Planner) -> None:
        real = actor.simulation
        self.embodiment, self.target, self.command = real.embodiment, real.target, real.command
        self.steps, self.settle_steps = 0, 0
        self._planner, self._poses = planner, {name: actor.pose(name) for name in actor.bodies}
        self._measured = real.qpos()
        self.state_vector = real.state_vector
        self.held = dict(actor.held)
        self._carried = {name: (side, actor.in_hand(side)) for side, name in actor.held.items()}

    def step(self, command: Floats, velocity: Floats) -> None:
        for name, (side, in_hand) in list(self._carried.items()):
            if self.held.get(side) != name:
                self._poses[name] = compose(self.tcp(side), in_hand)
                del self._carried[name]
        for side, name in self.held.items():
            if name not in self._carried or self._carried[name][0] != side:
                self._carried[name] = side, compose(inverse(self.tcp(side)), self.pose(name))
        self.command = command
        self.steps += 1

    def pose(self, name: str) -> Pose:
        if name in self._carried:
            side, in_hand = self._carried[name]
            return compose(self.tcp(side), in_hand)
        return self._poses[name].copy()

    def tcp(self, side: str) -> Pose:
        return self._planner.fk(side, self._planner.split(self.command)[side][0])

    def qpos(self) -> tuple[Floats, Floats]:
        return self._measured

    def poses(self) -> Floats:
        return np.empty((0, 7))

    def overloads(self) -> list[Overload]:
        return []


@dataclass
class _Silent:
    fps: int

    def after_step(self) -> None:
        """Record nothing."""


class _Move(NamedTuple):
    start: int
    end: int
    sides: tuple[str, ...]
    held: dict[str, str]


class _Imagined(Actor):
    def __init__(self, actor: Actor) -> None:
        still = _Still(actor, actor.planner)
        stand_in = cast(Simulation, still)  # what skills and planning ask of a simulation
        recorder = cast(Recorder, _Silent(actor.recorder.fps))
        super().__init__(stand_in, recorder, actor.bodies, actor.arms, actor.rng, 0)
        self.max_steps, self.held = 10 * actor.max_steps, still.held
        self.approaches = dict(actor.approaches)
        self.moves = list[_Move]()

    def execute(self, step: MotionStep) -> None:
        began, held = len(self.stream.commands), dict(self.held)
        super().execute(step)
        self.moves.append(_Move(began, len(self.stream.commands), self._moving(began), held))

    def _moving(self, began: int) -> tuple[str, ...]:
        rows = [self.planner.split(row) for row in self.stream.commands[began:]]
        sides = self.planner.embodiment.sides if rows else ()
        return tuple(
            side for side in sides if np.ptp([row[side][0] for row in rows], axis=0).max() > STIRS
        )


def imagine(actor: Actor, script: Script, aim: Pose, *, rest: bool = False) -> MeetingPlan:
    """Plan a script that meets a target at `aim` (7,); with `rest`, its last skill. Raises
    PlanFailure.
    """
    mind = _Imagined(actor)
    if rest:
        *_, meeting = script(mind)
        mind.perform(meeting)
    else:
        for skill in script(mind):
            mind.perform(skill)
    runs, stream = tuple(mind.skills), mind.stream
    rows, speeds = np.array(stream.commands), np.array(stream.velocities)
    moving = [move for move in mind.moves if move.sides]
    stirring = (r.start for r in runs if any(r.start <= move.start < r.end for move in moving))
    last = max(stirring, default=0)
    after = [move for move in moving if move.start >= last]
    near, met = (after[0].end, after[-1].end) if after else (len(rows), len(rows))
    sides = tuple(side for side in SIDES if any(side in move.sides for move in after))
    holding = next(move.held for move in mind.moves if move.end > last)
    known = dict(mind.held), dict(mind.approaches), holding
    is_round = actor.bodies[actor.simulation.target].instance.shape().is_round
    return MeetingPlan(aim, is_round, rows, speeds, last, near, met, sides, runs, *known)
