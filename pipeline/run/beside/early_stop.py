"""Early stop: a cell whose first slots are accepted too seldom is stopped (`floor` of a recipe).

It is judged by the attempts at its first slots, before which no other starts: the number of workers
changes nothing."""

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from pipeline.data.dataset import Dataset
from pipeline.data.recipe.model import Cell, Floor, Recipe, Slot

if TYPE_CHECKING:  # it imports the simulator, and status needs none
    from pipeline.run.slot.fill import FillJob

type Rows = Sequence[Mapping[str, Any]]  # rows of attempts.parquet


@dataclass(frozen=True)
class StoppedCell:
    """A stopped cell: attempts at its first slots, how many were accepted, and slots not tried."""

    cell: Cell
    attempts: int
    accepted: int
    floor: Floor
    slots: int

    @property
    def because(self) -> str:
        """The reason in words."""
        return (
            f"{self.accepted} of {self.attempts} attempts at its first {self.floor.slots} slots "
            f"were accepted, fewer than the floor of {100 * self.floor.share:g} %"
        )

    def describe(self) -> str:
        """One line."""
        return f"{self.cell.path} is stopped, {self.slots} slots are not tried: {self.because}"


def judge(cell: Cell, wanted: int, floor: Floor, first: Sequence[Rows]) -> StoppedCell | None:
    """Whether a cell with so many wanted slots stops, by the attempts at its first ones; those that
    lost their worker do not count."""
    rows = [row for rows in first for row in rows if row["stage"] != "worker"]
    accepted = sum(row["outcome"] == "accepted" for row in rows)
    if wanted <= floor.slots or accepted >= floor.share * len(rows):
        return None
    return StoppedCell(cell, len(rows), accepted, floor, wanted - floor.slots)


def stopped_cells(dataset: Dataset, recipe: Recipe) -> Iterator[StoppedCell]:
    """The stopped cells of a dataset."""
    if (floor := recipe.floor) is None:
        return
    tried = _first_attempts(dataset, recipe, floor)
    for cell, wanted in recipe.counts().items():
        rows = [tried[slot] for index in range(floor.slots) if (slot := Slot(cell, index)) in tried]
        if len(rows) == floor.slots and (stop := judge(cell, wanted, floor, rows)):
            yield stop


def _first_attempts(dataset: Dataset, recipe: Recipe, floor: Floor) -> dict[Slot, Rows]:
    """The attempts at those of the first slots of every cell that are finished."""
    rows = dataset.rows(recipe)
    first = rows.where((rows.variants == 0) & (rows.index < floor.slots))
    of, tried = dataset.ask(lambda index: index.attempts(first, "stage", "outcome"))
    found: dict[Slot, list[Mapping[str, Any]]] = {slot: [] for slot in first.slots}
    for row, (stage, outcome) in zip(of.tolist(), tried, strict=True):
        found[first.slots[row]].append({"stage": stage, "outcome": outcome})
    return dict(found)


class EarlyStop:
    """Which jobs may start: those at the first slots of every cell, and a cell's others once it is
    judged and not stopped. `untried` are the slots of `stops`."""

    def __init__(self, dataset: Dataset, recipe: Recipe, jobs: "deque[FillJob]") -> None:
        """Takes from `jobs` those that have to wait."""
        self._recipe, self._floor = recipe, recipe.floor
        self.stops: list[StoppedCell] = []
        self.untried = set[Slot]()
        self._held: dict[Cell, list[FillJob]] = {}
        self._first: dict[Cell, list[Rows]] = {}
        if (floor := recipe.floor) is None:
            return
        ready: list[FillJob] = []
        for job in jobs:
            late = job.slot.index >= floor.slots
            (self._held.setdefault(job.slot.cell, []) if late else ready).append(job)
        jobs.clear()
        jobs.extend(ready)
        pending = {job.slot for job in ready}
        for slot, rows in _first_attempts(dataset, recipe, floor).items():
            if slot not in pending:
                self._first.setdefault(slot.cell, []).append(rows)
        for cell in list(self._held):
            jobs.extend(self._release(cell, floor))

    def finish(self, slot: Slot, attempts: Rows) -> "list[FillJob]":
        """Note a slot that ended, and return the jobs that may start now."""
        if self._floor is None or slot.cell not in self._held:
            return []
        self._first.setdefault(slot.cell, []).append(attempts)
        return self._release(slot.cell, self._floor)

    def _release(self, cell: Cell, floor: Floor) -> "list[FillJob]":
        rows = self._first.get(cell, [])
        if len(rows) < floor.slots:
            return []
        held = self._held.pop(cell)
        if stop := judge(cell, self._recipe.wanted(cell), floor, rows):
            self.stops.append(stop)
            self.untried.update(job.slot for job in held)
            return []
        return held
