"""The arms of the study of states and the contrasts of its pre-registration
(docs/science/preregistration.md)."""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

TASKS, SIZES, MORE_SIZES, ARMS, SEEDS, LEVELS = (
    ("click_bell", "grab_roller"),
    (50, 150),
    (25, 300),
    ("planned", "reactive", "takeovers"),
    3,
    (1, 3),
)
LARGEST = 600
"""The N of the fourth addendum."""
WIDENED = (
    ("press_stapler", 150, ("planned", "reactive"), "velocity"),
    ("beat_block_hammer", 150, ("planned", "reactive"), "velocity"),
    ("click_bell", 150, ("half", "static"), "velocity"),
    ("grab_roller", 150, ("planned", "reactive"), "velocity"),
    ("click_bell", 150, ("planned", "reactive"), "position"),
    ("click_bell", 150, ("planned", "reactive"), "two_frames"),
    ("place_mouse_pad", 100, ("planned", "reactive"), "velocity"),
    ("click_bell", 300, ("planned", "reactive"), "velocity"),
)
"""The units of the second addendum, in their order: task, N, arms, inputs."""
HOLDING = "two_frames, holding"
"""What a network sees that holds still until it has seen two frames."""
SHOWN = (*ARMS, "foresighted", "half", "static", "new scenes")


@dataclass(frozen=True)
class Side:
    """An arm with `n` episodes a level, and what its networks see."""

    arm: str
    n: int
    inputs: str = "velocity"


@dataclass(frozen=True)
class Contrast:
    """The difference between two sides on the scenes of a task and level."""

    task: str
    level: int
    first: Side
    second: Side

    def __str__(self) -> str:
        one, other = (
            self._distinguish(self.first, self.second),
            self._distinguish(self.second, self.first),
        )
        same = [] if self.first.n != self.second.n else [f"N = {self.first.n}"]
        if self.first.arm == self.second.arm:
            same.append(self.first.arm)
        if self.first.inputs == self.second.inputs != "velocity":
            same.append(self.first.inputs)
        return f"{', '.join([self.task, f'level {self.level}', *same])}: {one} - {other}"

    def _distinguish(self, side: Side, other: Side) -> str:
        """What distinguishes a side from the other."""
        if side.arm == other.arm:
            return f"N = {side.n}" if side.n != other.n else side.inputs
        return side.arm if side.n == other.n else f"{side.arm} (N = {side.n})"


def first_primary() -> Iterator[Contrast]:
    """The primary contrasts of the pre-registration."""
    for first, level in itertools.product(("reactive", "takeovers"), LEVELS):
        yield Contrast(TASKS[0], level, Side(first, max(SIZES)), Side("planned", max(SIZES)))


def first_secondary() -> Iterator[Contrast]:
    """Its secondary contrasts, without those that are primary in the second addendum."""
    told = {*first_primary(), *primary()}
    for task, n, level in itertools.product(TASKS, SIZES, LEVELS):
        for first in ("reactive", "takeovers"):
            if (contrast := Contrast(task, level, Side(first, n), Side("planned", n))) not in told:
                yield contrast
    for task, level in itertools.product(TASKS, LEVELS):
        yield Contrast(task, level, Side("reactive", min(SIZES)), Side("planned", max(SIZES)))


def unregistered() -> Iterator[Contrast]:
    """Contrasts of its arms that it does not name."""
    for task, n, level in itertools.product(TASKS, SIZES, LEVELS):
        yield Contrast(task, level, Side("reactive", n), Side("takeovers", n))


def exploratory() -> Iterator[Contrast]:
    """The contrasts of the first, third and fourth addendum."""
    for n, level in itertools.product(SIZES, LEVELS):
        yield Contrast(TASKS[0], level, Side("foresighted", n), Side("planned", n))
        yield Contrast(TASKS[0], level, Side("reactive", n), Side("foresighted", n))
    for level in LEVELS:
        yield Contrast(
            TASKS[0], level, Side("reactive", min(MORE_SIZES)), Side("planned", min(MORE_SIZES))
        )
    n, holding = max(SIZES), Side("reactive", max(SIZES), HOLDING)
    pairs = (
        (holding, Side("planned", n, HOLDING)),
        (holding, Side("reactive", n, "two_frames")),
        (Side("reactive", n), holding),
    )
    for (first, second), level in itertools.product(pairs, LEVELS):
        yield Contrast(TASKS[0], level, first, second)
    most = Side("reactive", LARGEST)
    pairs = (
        (most, Side("planned", LARGEST)),
        *((Side(arm, LARGEST), Side(arm, n)) for arm in ("reactive", "planned")),
    )
    for (first, second), level in itertools.product(pairs, LEVELS):
        yield Contrast(TASKS[0], level, first, second)
    new = Side("new scenes", max(SIZES))
    for other, level in itertools.product(("takeovers", "planned"), LEVELS):
        yield Contrast(TASKS[0], level, new, Side(other, max(SIZES)))


def primary() -> Iterator[Contrast]:
    """The primary contrasts of the second addendum."""
    for (task, n, _, _), level in itertools.product(WIDENED, LEVELS):
        if task != TASKS[0]:
            yield Contrast(task, level, Side("reactive", n), Side("planned", n))


def secondary() -> Iterator[Contrast]:
    """Its secondary contrasts, on the first task."""
    n, most = max(SIZES), max(MORE_SIZES)
    planned, reactive, half = Side("planned", n), Side("reactive", n), Side("half", n)
    pairs = [(half, planned), (reactive, half), (Side("static", n), planned)]
    for inputs in ("position", "two_frames"):
        pairs += [
            (Side("reactive", n, inputs), Side("planned", n, inputs)),
            (reactive, Side("reactive", n, inputs)),
        ]
    pairs += [
        (Side("reactive", most), Side("planned", most)),
        (Side("reactive", most), reactive),
        (Side("planned", most), planned),
    ]
    for (first, second), level in itertools.product(pairs, LEVELS):
        yield Contrast(TASKS[0], level, first, second)
