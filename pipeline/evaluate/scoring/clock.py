"""The world's time during an inference (docs/evaluation.md)."""

from collections.abc import Callable, Mapping
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
    "sim (or paused), step-locked, late:MS, latency:MS (or MS), latency:normal:MEAN:SD,"
    " latency:uniform:LOW:HIGH, latency:measured, or async: in place of latency:, also with :blend"
    " or :rtc at the end"
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
    """How time passes during an inference. `values` are the numbers of the `kind` in ms; `join`
    joins overlapping chunks."""

    name: str
    kind: str
    values: tuple[float, ...] = ()
    join: Join | None = None

    def motion(self, motion: Motion) -> Motion:
        if self.kind == "late":
            return Retimed(motion, late=self.values[0] / 1000)
        return Retimed(motion, STEP_LOCKED_RATE) if self.kind == "step-locked" else motion

    def delay(self, measured: float, rng: np.random.Generator) -> float:
        v = self.values
        match self.kind:
            case "fixed":
                return v[0] / 1000
            case "normal":
                return max(0.0, float(rng.normal(v[0], v[1]))) / 1000
            case "uniform":
                return float(rng.uniform(v[0], v[1])) / 1000
            case _:
                return measured if self.kind == "measured" else 0.0


def parse_clock(text: str) -> Clock:
    kind, *rest = text.split(":")
    if kind in ("sim", "sim-clock", "paused") and not rest:
        return Clock("sim", "sim")
    if len(_milliseconds([text])) == 1:
        kind, rest = "latency", [text]
    if text == "step-locked":
        return Clock(text, text)
    if kind == "late" and len(numbers := _milliseconds(rest)) == 1:
        return Clock(text, "late", numbers)
    if kind in ("latency", "async") and rest and (clock := _parse_delay(kind, rest)):
        return clock
    raise ClockError(f"--clock {text!r} is unknown: give {HELP} (times in ms)")


def _parse_delay(kind: str, rest: list[str]) -> Clock | None:
    join: Join | None = None
    if kind == "async":
        join = cast(Join, rest.pop()) if rest[-1] in ("blend", "rtc") else "switch"
    suffix = f":{join}" if join in ("blend", "rtc") else ""
    name = f"{':'.join([kind, *rest])}{suffix}"
    if rest == ["measured"]:
        return Clock(name, "measured", (), join)
    counts = {"normal": 2, "uniform": 2}
    drawn = rest.pop(0) if rest and rest[0] in counts else "fixed"
    numbers = _milliseconds(rest)
    if len(numbers) != counts.get(drawn, 1) or (drawn == "uniform" and numbers[0] > numbers[1]):
        return None
    return Clock(name, drawn, numbers, join)


def _milliseconds(words: list[str]) -> tuple[float, ...]:
    try:
        return tuple(real(word, 0, 60_000) for word in words)
    except ParseError:
        return ()


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
