"""Cells that are stopped: by which rule, and the same ones whatever the order in which slots
end."""

from collections import deque
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.data.dataset import Dataset
from pipeline.data.recipe.growth import differences, left_out
from pipeline.data.recipe.model import Cell, Floor, RecipeError, Slot, parse_recipe
from pipeline.run.beside.early_stop import EarlyStop, judge, stopped_cells
from pipeline.run.slot.fill import FillJob
from tests.data.test_dataset import KEYS, attempt_row
from tests.recording import finish

CELL = Cell("click_bell", "aloha-agilex", 1, 0.1, "clean")
RECIPE = parse_recipe(
    {
        "tasks": ["click_bell", "stamp_seal"],
        "levels": [1, 2, 3],
        "episodes": 5,
        "floor": {"share": 0.3, "slots": 2},
    }
)


def tried(failed, accepted=True):
    """Rows of a slot: so many failures, and the accepted attempt."""
    rows = [attempt_row(number, "failed") for number in range(failed)]
    return [*rows, attempt_row(failed)] if accepted else rows


def outcome(slot):
    """What a slot of level 3 gives is hopeless; of the others, the first fails a little."""
    return (
        tried(6, accepted=slot.index == 0)
        if slot.cell.level == 3
        else tried(2 if slot.index == 0 else 0)
    )


def jobs_of(slots):
    return deque(FillJob("nowhere", RECIPE, slot, "") for slot in slots)


def test_a_cell_stops_where_its_first_attempts_are_accepted_too_seldom():
    floor = Floor(share=0.25, slots=2)
    assert judge(CELL, 9, floor, [tried(3), tried(3)]) is None
    stop = judge(CELL, 9, floor, [tried(3), tried(4)])
    assert stop and (stop.attempts, stop.accepted, stop.slots) == (9, 2, 7)
    assert (
        "2 of 9 attempts at its first 2 slots were accepted, fewer than the floor of 25 %"
        in stop.describe()
    )
    # nothing is left to stop, and lost workers say nothing of the cell
    assert judge(CELL, 2, floor, [tried(9), tried(9)]) is None
    lost = attempt_row(0, "failed") | {"stage": "worker"}
    assert judge(CELL, 9, floor, [[lost] * 50, tried(0)]) is None


@given(st.integers(1, 7), st.integers(0, 2**32))
def test_the_same_slots_are_tried_whatever_the_order_in_which_they_end(
    tmp_path_factory, workers, seed
):
    dataset, chance = Dataset(tmp_path_factory.getbasetemp() / "nothing"), Random(seed)
    dataset.create(RECIPE)
    jobs = jobs_of(RECIPE.physical_slots())
    early_stop, running, made = EarlyStop(dataset, RECIPE, jobs), list[FillJob](), list[Slot]()
    while jobs or running:
        while jobs and len(running) < workers:
            running.append(jobs.popleft())
        slot = running.pop(chance.randrange(len(running))).slot
        made.append(slot)
        jobs.extend(early_stop.finish(slot, outcome(slot)))
    wanted = {slot for slot in RECIPE.physical_slots() if slot.cell.level < 3 or slot.index < 2}
    assert len(made) == len(set(made)) and set(made) == wanted
    assert {(stop.cell.level, stop.slots) for stop in early_stop.stops} == {(3, 3)}
    assert early_stop.untried == {*RECIPE.physical_slots()} - wanted


def test_a_build_goes_on_with_what_its_index_holds(tmp_path):
    dataset = Dataset(tmp_path)
    dataset.create(RECIPE)
    slots = list(RECIPE.physical_slots())
    done = [slot for slot in slots if slot.index < 2 and slot.cell.task == "click_bell"]
    for slot in done:
        rows = tuple(
            row | {"task": slot.cell.task, "level": slot.cell.level} for row in outcome(slot)
        )
        finish(dataset, slot, KEYS, rows)
    jobs = jobs_of(slot for slot in slots if slot not in done)
    early_stop = EarlyStop(dataset, RECIPE, jobs)
    ready = {job.slot for job in jobs}
    assert ready == {
        s
        for s in slots
        if (s.cell.task == "stamp_seal" and s.index < 2) or (s.index >= 2 and s.cell.level < 3)
    } - {s for s in slots if s.cell.task == "stamp_seal" and s.index >= 2}
    assert [stop.cell.path for stop in early_stop.stops] == ["click_bell/aloha-agilex/L3/clean"]
    assert list(stopped_cells(dataset, RECIPE)) == early_stop.stops


def test_without_a_floor_everything_starts_at_once(tmp_path):
    recipe = RECIPE.model_copy(update={"floor": None})
    jobs = jobs_of(recipe.physical_slots())
    assert (
        len(jobs) == 30
        and EarlyStop(Dataset(tmp_path), recipe, jobs).finish(jobs[0].slot, tried(9)) == []
    )
    assert len(jobs) == 30
    assert not differences(recipe, RECIPE) and not left_out(recipe, RECIPE)


@pytest.mark.parametrize(
    "wrong", [0, 1.5, {"share": 0.1, "slots": 0}, {"slots": 3}, "low", {"share": 0.1, "tries": 3}]
)
def test_a_wrong_floor_is_refused(wrong):
    with pytest.raises(RecipeError, match="floor"):
        parse_recipe({"floor": wrong})
    assert parse_recipe({"floor": 0.1}).floor == Floor(share=0.1, slots=3)
