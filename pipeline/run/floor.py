"""A recipe's floor: a cell of whose first slots too small a share of the attempts was accepted is stopped.

The judgement is a function of the ledger entries of a cell's first slots, and no later slot of a cell starts before it. So which
slots are tried depends neither on the number of workers nor on the order in which they end.
"""

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from pipeline.data.dataset import Dataset
from pipeline.data.recipe.model import Cell, Floor, Recipe, Slot

if TYPE_CHECKING:  # it imports the simulator, and status needs none
    from pipeline.run.slot.fill import SlotJob

type Rows = Sequence[Mapping[str, Any]]  # rows of attempts.parquet


@dataclass(frozen=True)
class Stop:
    """A cell that is stopped: attempts at its first slots, how many were accepted, the floor, and how many slots are not tried."""

    cell: Cell
    attempts: int
    accepted: int
    floor: Floor
    slots: int

    @property
    def because(self) -> str:
        """The reason in words."""
        return (
            f"{self.accepted} of {self.attempts} attempts at its first {self.floor.slots} slots were accepted, "
            f"fewer than the floor of {100 * self.floor.share:g} %"
        )

    def describe(self) -> str:
        """One line."""
        return f"{self.cell.path} is stopped, {self.slots} slots are not tried: {self.because}"


def judge(cell: Cell, wanted: int, floor: Floor, first: Sequence[Rows]) -> Stop | None:
    """Whether a cell with so many wanted slots stops, by the attempts at its first ones. Attempts that lost their worker do not
    count: they say nothing of the cell."""
    rows = [row for rows in first for row in rows if row["stage"] != "worker"]
    accepted = sum(row["outcome"] == "accepted" for row in rows)
    if wanted <= floor.slots or accepted >= floor.share * len(rows):
        return None
    return Stop(cell, len(rows), accepted, floor, wanted - floor.slots)


def stops_in(dataset: Dataset, recipe: Recipe) -> Iterator[Stop]:
    """The stopped cells of a dataset, by its ledger."""
    if (floor := recipe.floor) is None:
        return
    tried = _read_attempts(dataset, recipe, floor)
    for cell, wanted in recipe.counts().items():
        rows = [tried[slot] for index in range(floor.slots) if (slot := Slot(cell, index)) in tried]
        if len(rows) == floor.slots and (stop := judge(cell, wanted, floor, rows)):
            yield stop


def _read_attempts(dataset: Dataset, recipe: Recipe, floor: Floor) -> dict[Slot, Rows]:
    """The attempts at the first slots of every cell, by the ledger."""
    entries = dataset.entries(recipe, ("attempts",))
    first = entries.where([not slot.variant and slot.index < floor.slots for slot in entries.slots])
    return dict(zip(first.slots, first.table["attempts"].to_pylist(), strict=True))


class Probation:
    """Which jobs may start: those at the first slots of every cell, and a cell's others once it is judged and not stopped.

    `stops` are the cells that are stopped, `untried` the slots whose jobs were not started for it.
    """

    def __init__(self, dataset: Dataset, recipe: Recipe, jobs: "deque[SlotJob]") -> None:
        """Takes from `jobs` those that have to wait."""
        self._recipe = recipe
        self.stops: list[Stop] = []
        self.untried = set[Slot]()
        self._held: dict[Cell, list[SlotJob]] = {}
        self._first: dict[Cell, dict[int, Rows]] = {}
        if (floor := recipe.floor) is None:
            return
        ready = [job for job in jobs if job.slot.index < floor.slots]
        for job in jobs:
            if job.slot.index >= floor.slots:
                self._held.setdefault(job.slot.cell, []).append(job)
        jobs.clear()
        jobs.extend(ready)
        pending, tried = {job.slot for job in ready}, _read_attempts(dataset, recipe, floor)
        for cell in list(self._held):
            first = [slot for index in range(floor.slots) if (slot := Slot(cell, index)) in tried and slot not in pending]
            self._first[cell] = {slot.index: tried[slot] for slot in first}
            jobs.extend(self._make_jobs(cell, floor))

    def finish(self, slot: Slot, attempts: Rows) -> "list[SlotJob]":
        """Note a slot that ended, and return the jobs that may start now."""
        if self._recipe.floor is None or slot.cell not in self._held:
            return []
        self._first[slot.cell][slot.index] = attempts
        return self._make_jobs(slot.cell, self._recipe.floor)

    def _make_jobs(self, cell: Cell, floor: Floor) -> "list[SlotJob]":
        rows = list(self._first[cell].values())
        if len(rows) < floor.slots:
            return []
        held = self._held.pop(cell)
        if stop := judge(cell, self._recipe.wanted(cell), floor, rows):
            self.stops.append(stop)
            self.untried.update(job.slot for job in held)
            return []
        return held
