"""The events of a running simulation, which act on the target's motion, the commands or the
scenery."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from pipeline.data.clock import PHYSICS_HZ
from pipeline.data.episode.events import (
    CHANGES,
    ENDED,
    EXCHANGES,
    FIRED,
    NEAR,
    WITHHELD,
    DrawnEvent,
    Phase,
)
from pipeline.data.episode.state_log import Event
from pipeline.motion.contract import Motion
from pipeline.motion.scenery import AWAY, Piece, Prop, hood
from pipeline.motion.wrapped import Change
from pipeline.poses import IDENTITY, Floats, Pose, compose, frame, inverse, pose, quat_rotate
from pipeline.world.robots.contract import Embodiment

from .body import TABLE_TOP, Body

PROP = "event_"
"""What the names of such scenery, and of a body that waits for its event, begin with."""

SWAPPED = f"{PROP}swap"
"""The body that takes the target's place, and waits below the floor until then."""

BOARD = (0.35, 0.25, 0.5)
"""An occluder: its place on the way from the camera to the target (share), the time (s) in which it
slides into it, and from how far (m)."""

WOOD = (0.45, 0.33, 0.22)

TUNNEL = (0.08, 0.22)
"""m; half width and height of a tunnel inside."""

SECOND, PLASTIC = 0.025, (0.15, 0.35, 0.6)
"""Half extent (m) and colour of a box that enters."""

LANE = (0.45, 0.13)
"""m; a second mover enters at this distance from the middle of the table, and passes the meeting so
far beyond it."""

MOVED = 0.3
"""Seconds in which the goal moves."""


class EventfulWorld(Protocol):
    """What events see and change of a simulation."""

    embodiment: Embodiment
    events: list[Event]
    target: str
    motion: Motion
    touched_by: str
    touched_at: int
    released: bool

    @property
    def time(self) -> float: ...
    def pose(self, name: str) -> Pose: ...
    def tcp(self, side: str) -> Pose: ...
    def change(self, change: Change) -> None: ...
    def can_take(self, name: str) -> bool: ...
    def exchange(self, name: str) -> None: ...
    def shift(self, name: str, velocity: Floats) -> None: ...


@dataclass(eq=False)
class RunningEvent:
    """When an event fired and ended (s, inf if not yet), and in which phase. A `withheld` one notes
    when it would have happened, and changes nothing."""

    drawn: DrawnEvent
    withheld: bool = False
    fired: float = np.inf
    ended: float = np.inf
    phase: Phase | None = None
    place: Pose = field(default_factory=lambda: AWAY)

    def is_active(self, time: float) -> bool:
        return not self.withheld and self.fired <= time < self.ended

    def at(self, t: ArrayLike) -> Floats:
        """The pose (...,7) of this event's scenery."""
        return self._box(t) if self.drawn.kind == "second" else self.board(t)

    def _box(self, t: ArrayLike) -> Floats:
        """The pose (...,7) of a box that crosses the table."""
        t = np.asarray(t, float)[..., None]
        gone = self.drawn.amount * (np.clip(t, None, self.ended) - self.fired)
        away = -np.sign(self.place[0])
        there = self.place + np.nan_to_num(gone) * np.array([away, 0, 0, 0, 0, 0, 0])
        return np.where((t > self.fired) & (gone < 2 * LANE[0]), there, AWAY)

    def board(self, t: ArrayLike) -> Floats:
        """The pose (...,7) of what slides in and leaves sideways."""
        t, (_, slide, far) = np.asarray(t, float)[..., None], BOARD
        out = np.maximum(1.0 - (t - self.fired) / slide, (t - self.ended) / slide)
        side = (0.0, far if np.cos(self.drawn.turn) > 0 else -far, 0.0)
        aside = quat_rotate(self.place[3:], side)
        there = self.place + np.clip(out, 0.0, 1.0) * np.concatenate([aside, np.zeros(4)])
        return np.where((t > self.fired) & (t < self.ended + slide), there, AWAY)


class EventScript:
    """The events of one simulation. `eye` (7,) is the pose of the camera that an occluder stands
    before, `meeting` the planned time (s), `goal` the body that is moved as the goal, `withheld`
    whether each event is."""

    def __init__(
        self,
        events: Sequence[DrawnEvent],
        eye: Pose,
        meeting: float,
        *,
        goal: str = "",
        withheld: Sequence[bool],
    ) -> None:
        self.events = tuple(map(RunningEvent, events, withheld))
        self._eye, self._meeting, self._goal = eye, meeting, goal

    @property
    def props(self) -> tuple[Prop, ...]:
        """The events' scenery, unseen until they fire."""
        return tuple(
            Prop(f"{PROP}{drawn.name}", pieces, event.at, solid=drawn.kind == "second")
            for event in self.events
            for drawn in [event.drawn]
            if (pieces := _pieces(drawn))
        )

    @property
    def first(self) -> RunningEvent | None:
        """The first event that fired, or would have."""
        fired = [event for event in self.events if np.isfinite(event.fired)]
        return min(fired, key=lambda event: event.fired, default=None)

    def hides(self, point: Floats, time: float) -> bool:
        """Whether an occluder or a tunnel hides a world point (3,)."""
        for event in self.events:
            if event.withheld or event.drawn.kind not in ("occluder", "tunnel"):
                continue
            board = event.board(time)
            if event.drawn.kind == "tunnel":
                inside = np.abs(quat_rotate(inverse(board)[3:], point - board[:3]))
                if (inside <= (event.drawn.amount / 2, *TUNNEL)).all():
                    return True
                continue
            away = compose(inverse(board), self._eye)[:3]
            there = quat_rotate(inverse(board)[3:], point - board[:3])
            if away[0] * there[0] < 0:  # on both sides of the board
                hit = away + (there - away) * away[0] / (away[0] - there[0])
                if np.abs(hit[1:]).max() <= BOARD[0] * event.drawn.amount:
                    return True
        return False

    def before_step(self, simulation: EventfulWorld) -> None:
        """Fire what is due; end what has lasted."""
        before = -np.inf
        for event in self.events:
            if event.fired == np.inf and self._is_due(event.drawn, before, simulation):
                self._fire(event, simulation)
            elif event.ended == np.inf and simulation.time >= event.fired + (
                np.inf if event.drawn.lasts is None else event.drawn.lasts
            ):
                event.ended = simulation.time
                if not event.withheld:
                    simulation.events.append(Event(ENDED, event.ended, event.drawn.name))
                    self._change(event.drawn, simulation)
            before = event.fired
            if event.drawn.kind == "goal" and event.is_active(simulation.time):
                self._move_goal(event, simulation)

    def _move_goal(self, event: RunningEvent, s: EventfulWorld) -> None:
        if self._goal and s.time < event.fired + MOVED:
            way = np.array([np.cos(event.drawn.turn), np.sin(event.drawn.turn), 0.0])
            s.shift(self._goal, event.drawn.amount / MOVED * way)

    def commanded(self, command: Floats, time: float, grippers: Sequence[int]) -> Floats:
        """The drives' commands: a gripper that slips opens whatever is commanded."""
        if not any(event.drawn.kind == "slip" and event.is_active(time) for event in self.events):
            return command
        slipped = command.copy()
        slipped[list(grippers)] = 1.0
        return slipped

    def active(self, kind: str, time: float) -> float:
        """The sum of a kind's active amounts."""
        return sum(
            event.drawn.amount
            for event in self.events
            if event.drawn.kind == kind and event.is_active(time)
        )

    def _is_due(self, event: DrawnEvent, before: float, s: EventfulWorld) -> bool:
        if event.kind in EXCHANGES and not s.can_take(event.body):
            return False
        value, met = event.value, s.touched_at / PHYSICS_HZ if s.touched_at >= 0 else np.inf
        if isinstance(value, str):
            return _ORDER[phase_of(s)] >= _ORDER[value]
        starts: Mapping[str, float] = {
            "time": value,
            "share": value * self._meeting,
            "meeting": met + value,
            "after": (before if np.isfinite(before) else np.inf) + value,
        }
        if event.trigger in starts:
            return s.time >= starts[event.trigger] - 1e-9
        return distance(s) <= value

    def _fire(self, event: RunningEvent, s: EventfulWorld) -> None:
        drawn = event.drawn
        event.fired, event.phase = s.time, phase_of(s)
        s.events.append(Event(WITHHELD if event.withheld else FIRED, s.time, drawn.name))
        if event.withheld:
            return
        if drawn.kind == "occluder":
            event.place = self._place(s)
        elif drawn.kind == "tunnel":
            event.place = self._ahead(s)
        elif drawn.kind == "second":
            x = LANE[0] if np.cos(drawn.turn) > 0 else -LANE[0]
            y = float(np.asarray(s.motion.pose(min(self._meeting, s.time + 1.0)))[1]) + LANE[1]
            event.place = pose((x, y, TABLE_TOP + SECOND))
        elif drawn.kind in EXCHANGES:
            s.exchange(drawn.body)
        self._change(drawn, s, push=drawn.kind == "push")

    def _change(self, drawn: DrawnEvent, s: EventfulWorld, *, push: bool = False) -> None:
        """Set the motion's speed from its active events, and push to the side of the meeting."""
        if drawn.kind not in CHANGES or s.released:
            return
        rates = {"stop": lambda _: 0.0, "reverse": lambda _: -1.0, "speed": lambda amount: amount}
        now = [event.drawn for event in self.events if event.is_active(s.time)]
        rate = float(np.prod([rates[d.kind](d.amount) for d in now if d.kind in rates]))
        speed = np.zeros(2)
        if push:
            speed = drawn.amount * np.array([np.cos(drawn.turn), np.sin(drawn.turn)])
            at, later = (np.asarray(s.motion.pose(t))[:2] for t in (s.time, s.time + 1.0))
            speed = -speed if (later - at) @ speed < 0 else speed
        s.change(Change(s.time, rate, *speed.tolist()))

    def _place(self, s: EventfulWorld) -> Pose:
        now, then = s.pose(s.target)[:3], np.asarray(s.motion.pose(self._meeting))[:3]
        far = 0.5 * np.linalg.norm(then - now) if np.isfinite(self._meeting) else 0.0
        middle = 0.5 * (now + then) if far else now
        forward = middle - self._eye[:3]
        left = quat_rotate(self._eye[3:], (0.0, 1.0, 0.0))
        return frame(self._eye[:3] + BOARD[0] * forward, forward, left)

    def _ahead(self, s: EventfulWorld) -> Pose:
        """On the table half way on the target's path to the meeting, along it."""
        last = self._meeting if np.isfinite(self._meeting) else s.time
        times = s.time + (max(last, s.time) - s.time) * np.array([0.4, 0.5, 0.6])
        before, at, after = np.asarray(s.motion.pose(times))[:, :3]
        x, y, _ = after - before if np.linalg.norm(after - before) > 1e-3 else (1.0, 0.0, 0.0)
        return frame((at[0], at[1], TABLE_TOP), (x, y, 0.0), (-y, x, 0.0))


_ORDER = {"approach": 0, "near": 1, "after": 2}


def distance(s: EventfulWorld) -> float:
    """Least distance (m) of a tool from the target."""
    at = s.pose(s.target)[:3]
    return min(float(np.linalg.norm(s.tcp(side)[:3] - at)) for side in s.embodiment.sides)


def phase_of(s: EventfulWorld) -> Phase:
    """Whether the target was met, a tool is NEAR, or neither."""
    if s.touched_by:
        return "after"
    return "near" if distance(s) <= NEAR else "approach"


def _pieces(event: DrawnEvent) -> tuple[Piece, ...]:
    if event.kind == "second":
        return (Piece("box", (SECOND,) * 3, IDENTITY, PLASTIC),)
    if event.kind == "tunnel":
        return hood(event.amount / 2, *TUNNEL)
    if event.kind != "occluder":
        return ()
    half = BOARD[0] * event.amount
    return (Piece("box", (0.002, half, half), IDENTITY, WOOD),)


def in_roles(bodies: Mapping[str, Body], roles: Mapping[str, str]) -> dict[str, Body]:
    """Every body under the name of its role, `roles` where they differ. What is swapped stands
    where the other did."""

    def taking(name: str) -> Body:
        other = bodies[roles.get(name, name)]
        at = bodies[name] if SWAPPED in (name, other.name) else other
        return replace(other, name=name, pose=at.pose)

    return {name: taking(name) for name in bodies}
