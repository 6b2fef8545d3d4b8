"""Events of an episode: what happens, when, and what a file states of it."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any, Literal, NamedTuple, Self, get_args

import numpy as np
from pydantic import AfterValidator, BeforeValidator, field_validator, model_validator

from pipeline.data.names import CAMERAS
from pipeline.data.parsing import Strict, unless
from pipeline.poses import Bools, Floats

from .state_log import Event, StateLog

EventKind = Literal[
    "stop",
    "reverse",
    "speed",
    "push",
    "second",
    "goal",
    "occluder",
    "tunnel",
    "light",
    "freeze",
    "slip",
    "instruction",
    "swap",
    "latency",
]
Phase = Literal["approach", "near", "after"]
Trigger = Literal["time", "share", "distance", "phase", "meeting", "after"]

NEAR = 0.15  # m of a tool from the target at which the phase `near` begins

FIRED, ENDED, WITHHELD = "event", "event_end", "event_withheld"  # in a state log, `by` the event

AMOUNTS = {
    "speed": 2.0,
    "push": 0.3,
    "second": 0.15,
    "goal": 0.06,
    "occluder": 0.12,
    "tunnel": 0.12,
    "light": 0.15,
    "latency": 0.3,
}
"""Defaults: factor; m/s; m/s; m; m covered around the target; m of length; share of the light
that stays; s."""

LASTING = {"slip": 0.2}  # default seconds of a kind that ends by itself
CHANGES = ("stop", "reverse", "speed", "push")  # kinds that change the target's motion
EXCHANGES = {"instruction", "swap"}  # kinds that give the target's role to another body, for good
OF_CAMERAS = {"light", "freeze"}  # kinds that change images of single cameras

TRIGGERS = {
    "time": (0, 60),
    "share": (0, 1),
    "distance": (0.01, 2),
    "meeting": (0, 60),
    "after": (0, 60),
}
"""Least and most number of each trigger but `phase`."""


def _within(low: float, high: float) -> BeforeValidator:
    """A check for a number or pair within [`low`, `high`]."""

    def check(value: Any) -> Any:
        ends = value if isinstance(value, list | tuple) else (value, value)
        if len(ends) != 2 or not all(type(end) in (int, float) for end in ends):
            raise ValueError("must be a number, or two such as [0.5, 1.0]")
        if not all(low <= end <= high for end in ends):
            raise ValueError(f"must be {low:g} to {high:g}")
        if ends[0] > ends[1]:
            raise ValueError("must be a range such as [0.5, 1.0]")
        return ends if isinstance(value, list | tuple) else value

    return BeforeValidator(check)


def _known(value: Any) -> Any:
    """Raise ValueError unless a kind or a list of kinds."""
    kinds = value if isinstance(value, list | tuple) and value else [value]
    if any(kind not in get_args(EventKind) for kind in kinds):
        raise ValueError(f"must be one of {', '.join(get_args(EventKind))}")
    return value


_Number = float | tuple[float, float]


class When(Strict):
    """When an event happens: at a `time` (s) or a `share` of the time until the planned meeting. Or
    at a `distance` (m) of a tool from the target or the begin of a `phase`. Or so many s after the
    `meeting`, or `after` the event before. A pair of numbers is a range to draw from."""

    time: Annotated[_Number, _within(*TRIGGERS["time"])] | None = None
    share: Annotated[_Number, _within(*TRIGGERS["share"])] | None = None
    distance: Annotated[_Number, _within(*TRIGGERS["distance"])] | None = None
    phase: Phase | None = None
    meeting: Annotated[_Number, _within(*TRIGGERS["meeting"])] | None = None
    after: Annotated[_Number, _within(*TRIGGERS["after"])] | None = None

    @model_validator(mode="before")
    @classmethod
    def _word(cls, value: Any) -> Any:
        """ "meeting" is {meeting: 0}."""
        return {"meeting": 0.0} if value == "meeting" else value

    @model_validator(mode="after")
    def _one(self) -> Self:
        if sum(value is not None for _, value in self) != 1:
            raise ValueError(f"must be one of {', '.join(When.model_fields)}")
        return self

    @property
    def trigger(self) -> Trigger:
        return next(name for name, value in self if value is not None)  # pyright: ignore[reportReturnType]


class EventSpec(Strict):
    """An event of a recipe or an evaluation; of several kinds one is drawn. It ends after `lasts`
    (s), if given; `amount` is in the unit of its kind (AMOUNTS); `cameras` freeze or darken, by
    default all."""

    kind: Annotated[EventKind | tuple[EventKind, ...], BeforeValidator(_known)]
    when: When = When(share=0.6)
    lasts: Annotated[_Number, _within(0.01, 60)] | None = None
    amount: Annotated[_Number, _within(0, 100)] | None = None
    cameras: tuple[str, ...] = ()

    @model_validator(mode="before")
    @classmethod
    def _short(cls, value: Any) -> Any:
        """ "stop@0.8", "stop@share=0.6", "stop@meeting" and "stop@near"."""
        if not isinstance(value, str):
            return value
        kind, timed, when = value.partition("@")
        _known(kind)
        trigger, named, number = when.partition("=")
        if not timed or when == "meeting":
            return {"kind": kind} | ({"when": when} if timed else {})
        if when in get_args(Phase):
            return {"kind": kind, "when": {"phase": when}}
        if named and trigger not in TRIGGERS:
            raise ValueError(f"has an unknown trigger; a number has {', '.join(TRIGGERS)}")
        try:
            at = float(number if named else when)
        except ValueError:
            form = "KIND@WHEN, such as stop@0.8, stop@near or stop@share=0.6"
            raise ValueError(f"is not written as {form}") from None
        return {"kind": kind, "when": {trigger if named else "time": at}}

    @property
    def kinds(self) -> set[str]:
        return {self.kind} if isinstance(self.kind, str) else {*self.kind}

    @model_validator(mode="after")
    def _apply(self) -> Self:
        """Every key says something about a kind."""
        kinds = self.kinds
        which = ", ".join(sorted(kinds))
        if self.amount is not None and not kinds & AMOUNTS.keys():
            raise ValueError(f"gives an amount, which {which} does not have")
        if self.cameras and not kinds & OF_CAMERAS:
            raise ValueError(f"names cameras, which {which} does not change")
        late = self.when.meeting is not None or self.when.phase == "after"
        if kinds & EXCHANGES and (late or self.lasts is not None):
            does = "comes after the meeting" if late else "lasts"
            raise ValueError(f"{does}, which {which} cannot")
        most = self.amount[1] if isinstance(self.amount, tuple) else self.amount
        if "light" in kinds and (most or 0) > 1:
            raise ValueError("gives an amount above 1: light keeps a share of the light, 0 to 1")
        return self

    @field_validator("cameras")
    @classmethod
    def _full_names(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(CAMERAS.get(name, name) for name in value)

    @property
    def label(self) -> str:
        """A word for tables and paths."""
        value = getattr(self.when, self.when.trigger)
        number = "-".join(f"{v:g}" for v in value) if isinstance(value, tuple) else value
        kind = self.kind if isinstance(self.kind, str) else "-".join(self.kind)
        return f"{kind}@{self.when.trigger}{number}"


def _listed(value: Any) -> Any:
    events = [value] if isinstance(value, str | Mapping) else value
    return [] if isinstance(events, list | tuple) and [*events] == ["none"] else events


def _in_turn(events: tuple[EventSpec, ...]) -> tuple[EventSpec, ...]:
    if events and events[0].when.after is not None:
        raise ValueError("begins with an event `after` the one before it, and there is none")
    kinds = [event.kinds for event in events]
    for n, own in enumerate(kinds):
        others = set[str]().union(*kinds[:n], *kinds[n + 1 :])
        if own & EXCHANGES and (both := others & {*EXCHANGES, *CHANGES}):
            exchange, other = sorted(own & EXCHANGES)[0], sorted(both)[0]
            raise ValueError(f"have {exchange} and {other}: give an episode one of the two")
    return events


Events = Annotated[tuple[EventSpec, ...], BeforeValidator(_listed), AfterValidator(_in_turn)]
"""Events of a setup, or one; "none" for no event."""


class DrawnEvent(Strict):
    """An event with all numbers drawn; it happens when `trigger` reaches `value`; `lasts` is in
    s, `turn` in rad. `body` is what takes the target's role, "" for none.
    """

    name: str
    kind: EventKind
    trigger: Trigger
    value: float | str
    lasts: float | None = None
    amount: float = 0.0
    turn: float = 0.0
    cameras: tuple[str, ...] = ()
    body: Annotated[str, unless("")] = ""

    def shows(self, camera: str) -> bool:
        """Whether it changes the images of a camera of this name in a file."""
        return not self.cameras or camera in self.cameras


def draw_events(
    specs: Sequence[EventSpec], rng: np.random.Generator, kinds: np.random.Generator
) -> tuple[DrawnEvent, ...]:
    """The events of an episode. Every event takes as many draws, whatever its kind."""
    seen, drawn = Counter[str](), list[DrawnEvent]()
    for spec in specs:
        choice = (spec.kind,) if isinstance(spec.kind, str) else spec.kind
        kind = choice[int(kinds.random() * len(choice))]
        seen[kind] += 1
        numbers = rng.random(4)
        name = kind if seen[kind] == 1 else f"{kind}{seen[kind]}"
        value = getattr(spec.when, spec.when.trigger)
        lasts = LASTING.get(kind) if spec.lasts is None else _number(spec.lasts, numbers[1])
        amount = AMOUNTS.get(kind, 0.0) if spec.amount is None else spec.amount
        drawn.append(
            DrawnEvent(
                name=name,
                kind=kind,
                trigger=spec.when.trigger,
                value=value if isinstance(value, str) else _number(value, numbers[0]),
                lasts=lasts,
                amount=_number(amount, numbers[2]),
                turn=float(2 * np.pi * numbers[3]),
                cameras=spec.cameras,
            )
        )
    return tuple(drawn)


def _number(value: float | tuple[float, float], share: float) -> float:
    low, high = value if isinstance(value, tuple) else (value, value)
    return float(low + share * (high - low))


class Span(NamedTuple):
    """An event that happened, from `start` to `end` (s), inf for none."""

    event: DrawnEvent
    start: float
    end: float

    def holds(self, times: Floats) -> Bools:
        """When (T,) it has happened and not ended; a frame at its start is before."""
        return (times > self.start + 1e-9) & (times <= self.end + 1e-9)


def spans(drawn: Sequence[DrawnEvent], log: Sequence[Event]) -> list[Span]:
    """The events of `drawn` that a log says happened."""
    starts = {event.by: event.time for event in log if event.name == FIRED}
    ends = {event.by: event.time for event in log if event.name == ENDED}
    return [
        Span(event, starts[event.name], ends.get(event.name, np.inf))
        for event in drawn
        if event.name in starts
    ]


def exchanged(drawn: Sequence[DrawnEvent], log: Sequence[Event]) -> Span | None:
    """The event that gave the target's role to another body, if it happened."""
    return next((span for span in spans(drawn, log) if span.event.body), None)


def by_role(log: StateLog, drawn: Sequence[DrawnEvent], target: str) -> StateLog:
    """The log in which, from an exchange on, the names of the target and of the body that took its
    role stand for each other: `target` is what was asked for at each frame."""
    span = exchanged(drawn, log.events)
    if span is None:
        return log
    i, j = log.bodies.index(target), log.bodies.index(span.event.body)
    late, contacts, poses = span.holds(log.times), log.contacts.copy(), log.poses.copy()
    takes = np.arange(len(log.bodies))
    takes[[i, j]] = j, i
    poses[late] = poses[late][:, takes]
    rows = late[np.minimum(contacts["frame"], len(log) - 1)]
    pairs = np.sort(takes[np.stack([contacts["a"], contacts["b"]])], axis=0)
    contacts["a"][rows], contacts["b"][rows] = pairs[:, rows]
    return replace(log, poses=poses, contacts=contacts)
