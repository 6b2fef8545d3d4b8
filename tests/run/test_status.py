"""Status counts by columns what a loop over the slots counts one by one."""

import random
from collections import Counter
from dataclasses import replace

import pytest

from pipeline.data.dataset import Dataset
from pipeline.data.keys import Key, file_hash
from pipeline.data.slots.files import write_given_up
from pipeline.data.slots.index import FULL
from pipeline.data.slots.records import FileFacts, SlotRecord
from pipeline.data.slots.reread import IndexWriter
from pipeline.run.identity.slot_keys import RecipeKeys
from pipeline.run.names import recipe_from
from pipeline.run.state import (
    DONE,
    IMAGES,
    OPEN,
    PHYSICS,
    REDO,
    SENTENCES,
    SlotState,
    missing,
    states,
    status,
)
from pipeline.stages.reasons import reasons_in
from tests.recording import record_all

RECIPE = recipe_from(
    {
        "tasks": ["click_bell", "grab_roller"],
        "embodiments": ["aloha", "piper"],
        "levels": [1, 3],
        "alpha": [0.1, 0.2],
        "episodes": 5,
        "visuals": "randomized",
        "variants": 2,
    }
)
FAILURES = [
    ("dry_run", "no_motion", "workspace 7, blocked 3, tail 2"),
    ("replay", "no_success", ""),
    ("replay", "missed", ""),
]


def attempts(slot, accepted, rng):
    rows = []
    for number in range(rng.randint(1, 4)):
        failed = rng.choice(FAILURES)
        row = vars(slot.cell) | {
            "slot": slot.index,
            "attempt": number,
            "seed": number,
            "outcome": "failed",
        }
        row |= dict(zip(("stage", "reason", "detail"), failed, strict=True))
        row["conditions"] = (
            rng.sample(["held", "lifted", "placed"], rng.randint(0, 2))
            if failed[1] == "no_success"
            else []
        )
        rows.append(row)
    if accepted:
        rows[-1] |= {
            "outcome": "accepted",
            "stage": "",
            "reason": "",
            "detail": "",
            "conditions": [],
        }
    return tuple(rows)


def other(keys, kind):
    changed = getattr(keys, kind)
    return replace(keys, **{kind: Key({**changed.parts, "recipe": "another"})})


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """Slots of every state: open, given up, accepted, out of date in each way, with a file that is
    missing."""
    dataset, rng = Dataset(tmp_path_factory.mktemp("status") / "data"), random.Random(0)
    dataset.create(RECIPE)
    entries = []
    for slot in RECIPE.slots():
        case = rng.choice(
            [
                "open",
                "given up",
                "done",
                "done",
                "done",
                "missing",
                "missing",
                PHYSICS,
                "render",
                "language",
            ]
        )
        if case == "open":
            continue
        keys, accepted = RecipeKeys(RECIPE).of(slot), case != "given up"
        keys = other(keys, case) if case in (PHYSICS, "render", "language") else keys
        rows = () if slot.variant and accepted else attempts(slot, accepted, rng)
        path = dataset.episode(slot)
        path.parent.mkdir(parents=True, exist_ok=True)
        if not accepted:
            entries.append((slot, write_given_up(dataset, slot, keys, rows)))
            continue
        path.write_bytes(b"")
        entries.append(
            (slot, SlotRecord(keys, True, file_hash(path), rows, file=FileFacts.of(path.stat())))
        )
        if case == "missing":
            path.unlink()
        elif slot.index == 2:
            path.write_bytes(b"other bytes")
    record_all(dataset, entries)
    return dataset


def test_status_is_the_sum_over_the_slots(dataset):
    found = status(dataset)
    records = dict(dataset.records(RECIPE))
    for cell in RECIPE.cells():
        mine = {slot: record for slot, record in records.items() if slot.cell == cell}
        assert found["cells"][cell.path] == {
            "wanted": 10,
            "accepted": sum(record.accepted for record in mine.values()),
            "given_up": sum(not record.accepted for record in mine.values()),
            "attempts": sum(len(record.attempts) for record in mine.values()),
        }
    assert found["wanted"] == 160 and found["open"] == 160 - len(records)
    rows = [row for record in records.values() for row in record.attempts]
    assert found["reasons"] == dict(Counter(row["reason"] for row in rows if row["reason"]))
    assert {
        (f["stage"], f["reason"]): (f["attempts"], f["conditions"]) for f in found["failures"]
    } == counted(rows)
    solved = sum(record.accepted for slot, record in records.items() if not slot.variant)
    assert found["attempt_success"] == solved / len(rows)
    redo = Counter()
    for slot, state in states(dataset, RECIPE):
        if slot in records and state.todo not in (DONE, OPEN):
            redo[state.todo, state.because] += 1
    assert {(r["what"], tuple(r["because"])): r["slots"] for r in found["redo"]} == redo
    assert {what for what, _ in redo} == {PHYSICS, IMAGES, SENTENCES}


def test_states_of_single_slots(dataset):
    found, records = (
        dict(states(dataset, RECIPE)),
        dict(dataset.ask(lambda index: list(index.records(index.rows(RECIPE, *FULL))))),
    )
    for slot, record in records.items():
        held, wanted, path = (
            record.keys,
            RecipeKeys(RECIPE).of(slot),
            dataset.file(slot, record.accepted),
        )
        changed = [
            name
            for name in ("physics", "render", "language")
            if getattr(held, name) != getattr(wanted, name)
        ]
        if "physics" in changed:
            expected = PHYSICS
        elif not path.exists():
            expected = OPEN
            assert found[slot].because == (REDO,)
        else:
            expected = (
                IMAGES if "render" in changed else SENTENCES if "language" in changed else DONE
            )
        assert found[slot].todo == expected, slot
    with IndexWriter(dataset, RECIPE) as writer:
        todo = missing(dataset, RECIPE, writer)
    for slot, state in found.items():
        damaged = state.accepted and state.todo not in (OPEN, PHYSICS) and slot.index == 2
        if not slot.variant:
            assert todo.get(slot, SlotState(DONE)).todo == (PHYSICS if damaged else state.todo)
    assert not any(slot.variant for slot in todo)


def counted(rows):
    """Attempts, and how many of them did not fulfil each condition, by stage and reason."""
    found = {}
    for row in rows:
        if row["reason"]:
            attempts, conditions = found.get((row["stage"], row["reason"]), (0, Counter()))
            found[row["stage"], row["reason"]] = (
                attempts + 1,
                conditions + Counter(row.get("conditions")),
            )
    return found


def test_reasons_are_counted_over_the_rows(dataset):
    table = dataset.write_attempts(RECIPE)
    rows = table.select(["stage", "reason", "detail", "conditions"]).to_pylist()
    found = reasons_in(tuple(row.values()) for row in rows)
    assert {(r.stage, r.reason): (r.attempts, r.conditions) for r in found} == counted(
        table.to_pylist()
    )
    assert [r.attempts for r in found] == sorted((r.attempts for r in found), reverse=True)
    assert reasons_in(()) == []
