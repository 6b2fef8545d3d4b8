"""The world's time during an inference (docs/evaluation.md)."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from math import ceil
from typing import Literal, cast

import numpy as np
from numpy.typing import ArrayLike

from pipeline.data.clock import PHYSICS_HZ
from pipeline.data.errors import DominoError
from pipeline.data.parsing import ParseError, real
from pipeline.evaluate.scenes.trial import Trial
from pipeline.motion.scenery import Prop
from pipeline.motion.wrapped import others_of
from pipeline.poses import Floats
from pipeline.world.physics.simulation import Motion

STEP_LOCKED_RATE = 0.1 / 0.06  # of target motion to robot motion in the original's evaluation

Join = Literal["switch", "blend", "rtc"]

HELP = (
    "sim (or paused), step-locked, late:MS, latency:MS (or MS), latency:measured, or async: in"
    " place of latency:, also with :blend or :rtc at the end"
)


class ClockError(DominoError): ...


@dataclass(frozen=True)
class Retimed:
    """A target motion that runs `rate` times as fast and `late` seconds later than `motion`."""

    motion: Motion
    rate: float = 1.0
    late: float = 0.0

    def pose(self, t: ArrayLike) -> Floats:
        return self.motion.pose(self._then(t))

    def twist(self, t: ArrayLike) -> Floats:
        return self.rate * self.motion.twist(self._then(t))

    def scenery(self) -> tuple[Prop, ...]:
        def later(prop: Prop, t: ArrayLike) -> Floats:
            return prop.pose(self._then(t))

        return tuple(replace(p, pose=partial(later, p)) for p in self.motion.scenery())

    @property
    def others(self) -> Mapping[str, Motion]:
        return {name: replace(self, motion=m) for name, m in others_of(self.motion).items()}

    def _then(self, t: ArrayLike) -> Floats:
        return self.rate * (np.asarray(t, float) - self.late)


@dataclass(frozen=True)
class Clock:
    """How time passes during an inference. `ms` is the delay of the `kind` fixed, or how late a
    target begins; `join` joins overlapping chunks."""

    name: str
    kind: str
    ms: float = 0.0
    join: Join | None = None

    def motion(self, motion: Motion) -> Motion:
        if self.kind == "late":
            return Retimed(motion, late=self.ms / 1000)
        return Retimed(motion, STEP_LOCKED_RATE) if self.kind == "step-locked" else motion

    def delay(self, measured: float) -> float:
        """Seconds of an inference that took `measured` s on the wall clock."""
        if self.kind == "measured":
            return measured
        return self.ms / 1000 if self.kind == "fixed" else 0.0


def parse_clock(text: str) -> Clock:
    if text in ("sim", "sim-clock", "paused"):
        return Clock("sim", "sim")
    if text == "step-locked":
        return Clock(text, text)
    name = text if ":" in text else f"latency:{text}"
    kind, *rest = name.split(":")
    join: Join | None = None
    if kind == "async":
        join = cast(Join, rest.pop()) if rest[-1] in ("blend", "rtc") else "switch"
    if kind in ("late", "latency", "async") and len(rest) == 1:
        if rest[0] == "measured" and kind != "late":
            return Clock(name, "measured", join=join)
        with suppress(ParseError):
            ms = real(rest[0], 0, 60_000)
            return Clock(name, "late" if kind == "late" else "fixed", ms, join)
    raise ClockError(f"--clock {text!r} is unknown: give {HELP} (times in ms)")


Question = Callable[[Floats], tuple[Floats, float]]
"""From the actions (N,A) executed meanwhile, a chunk (H,A) and its time (s)."""


def in_turn(trial: Trial, ask: Question) -> None:
    while not trial.ending:
        chunk, delay = ask(np.empty((0, trial.length)))
        trial.hold(round(delay * PHYSICS_HZ))
        for action in chunk:
            if trial.ending:
                return
            trial.advance(action)


def drive_overlapped(trial: Trial, ask: Question, join: Join) -> None:
    """Ask for the next chunk once half of one is done. Delays are rounded up to whole periods;
    the last action stays in force until the next one arrives."""
    chunk, delay = ask(np.empty((0, trial.length)))
    wait = _periods(delay, trial.fps)
    trial.hold(wait * trial.per_period)
    # `done` counts from the moment at which the chunk's question was asked; `left` are its actions
    # from now on
    length, done = len(chunk), wait
    left = join_chunks(np.empty((0, trial.length)), chunk, wait, join)
    while not trial.ending:
        if done < min(length, max(1, length // 2)):
            left, done = _advance(trial, left), done + 1
            continue
        chunk, delay = ask(left[:wait].copy())  # a policy may change what it is given
        wait = _periods(delay, trial.fps)
        for _ in range(wait):
            if trial.ending:
                return
            left = _advance(trial, left)
        length, done, left = len(chunk), wait, join_chunks(left, chunk, wait, join)
        if wait == 0 or done >= length:
            left, done = _advance(trial, left), done + 1


def _periods(delay: float, fps: int) -> int:
    return ceil(delay * fps - 1e-9)


def _advance(trial: Trial, left: Floats) -> Floats:
    trial.advance(left[0])
    return left[1:] if len(left) > 1 else left


def join_chunks(old: Floats, new: Floats, wait: int, join: Join) -> Floats:
    """The actions (N,A) to execute when `new` (H,A) arrives `wait` periods after its question;
    `old` (M,A) is left.

    `rtc` has the weights of real-time chunking (Black et al. 2025, arXiv 2506.07339). A chunk no
    longer than the wait leaves its last action."""
    fresh = new[min(wait, len(new) - 1) :].copy()
    both = min(len(old), len(fresh))
    if join == "switch" or not both:
        return fresh
    share = (both - np.arange(both)) / (both + 1)
    if join == "rtc":
        share = share * np.expm1(share) / np.expm1(1)
    fresh[:both] += share[:, None] * (old[:both] - fresh[:both])
    return fresh
