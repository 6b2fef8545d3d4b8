"""Which episodes the study runs: reference policies, timing tolerance and latency, on one list of
cells."""

from collections.abc import Iterator
from dataclasses import dataclass

from pipeline.data.recipe.model import Cell
from pipeline.data.setup import DEFAULT, Setup
from pipeline.tasks import TASKS

TEN = (
    *("adjust_bottle", "grab_roller", "move_can_pot", "shake_bottle", "place_a2b_left"),
    *(
        "click_bell",
        "press_stapler",
        "beat_block_hammer",
        "place_container_plate",
        "place_mouse_pad",
    ),
)
"""Five interception and five tracking tasks."""

ALPHAS = (0.05, 0.1, 0.2)
POLICIES = ("replay", "static", "chaser", "interceptor", "random")
LATE = (0, 100, 200, 400, 800)
"""ms by which the target is late."""
LATENCY = (0, 50, 100, 200, 400)
"""ms that the world goes on for before every answer."""
CHUNKS = (1, 15)
"""Actions an answer holds, in the runs with latency."""

GOES_ON = Setup(contact="continue")
"""Our rules, but the target of a tracking task keeps moving after the first touch."""


@dataclass(frozen=True)
class StudyGroup:
    """Cells under one setup, and what is tried on the scenes of each: names of policies and of
    clocks."""

    cell: Cell
    tries: tuple[tuple[str, str], ...]
    setup: Setup = DEFAULT


def cells(task: str) -> Iterator[Cell]:
    """Level 0 once, since a target that stands still knows no alpha; the others at three alphas."""
    for level in (0, 1, 2, 3):
        for alpha in ALPHAS if level else (0.1,):
            yield Cell(task, "aloha-agilex", level, alpha, "clean")


def groups(task: str) -> Iterator[StudyGroup]:
    """What is run for one task. Contact rules differ in tracking tasks only: a gripper always stops
    what it holds."""
    for cell in cells(task):
        tries = [
            (policy, "sim")
            for policy in POLICIES
            if policy != "random" or (cell.level < 2 and cell.alpha == 0.1)
        ]
        if cell.level == 1:
            tries += [("replay", late(ms)) for ms in LATE[1:]]
        if cell.level == 1 and cell.alpha == 0.1:
            tries += [(interceptor(chunk), latency(ms)) for chunk in CHUNKS for ms in LATENCY[1:]]
        yield StudyGroup(cell, tuple(tries))
        if cell.level == 1 and TASKS[task].category == "tracking":
            yield StudyGroup(cell, tuple(("replay", late(ms)) for ms in LATE), GOES_ON)


def late(ms: int) -> str:
    """The clock on which the target is late by this much."""
    return f"late:{ms}" if ms else "sim"


def latency(ms: int) -> str:
    """The clock on which every answer takes this long."""
    return f"latency:{ms}" if ms else "sim"


def interceptor(chunk: int) -> str:
    """The interceptor that answers with so many actions."""
    return "interceptor" if chunk == 1 else f"interceptor:chunk={chunk}"
