"""The index: what is written comes back, what a file says is what was written, and nothing that
happens to it loses a slot."""

import json
import multiprocessing
import os
import shutil
import signal
import sqlite3
import struct
from dataclasses import replace
from pathlib import Path
from threading import Thread

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.data.atomic import write_atomic
from pipeline.data.dataset import Dataset
from pipeline.data.keys import Key, SlotKeys, file_hash
from pipeline.data.recipe.model import parse_recipe
from pipeline.data.slots.files import write_given_up
from pipeline.data.slots.index import FULL, DamagedIndex, Index
from pipeline.data.slots.records import (
    ATTEMPTS,
    FileFacts,
    SlotRecord,
    pack_keys,
    retimed,
    slot_part,
    unpack_keys,
    untimed,
)
from pipeline.data.slots.reread import IndexWriter
from tests.recording import record_all
from tests.synthetic import make_episode

RECIPE = parse_recipe(
    {
        "tasks": ["click_bell", "grab_roller"],
        "levels": [1, 3],
        "alpha": [0.1, 0.123456789],
        "episodes": 3,
    }
    | {"visuals": "randomized", "variants": 2, "attempts": 4}
)
SLOTS = list(RECIPE.slots())
HASH = st.integers(0, 16**64 - 1).map(lambda n: f"{n:064x}")
NAME = st.integers(0, 16**32 - 1).map(lambda n: f"{n:032x}")
TEXT = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=20)
NUMBER = st.floats(0, 1e6)


def keys_of(slot, core="c"):
    physics = Key({"slot": slot_part(slot), "core": core})
    return SlotKeys(
        physics, Key({"physics": physics.digest, "shaders": "s"}), Key({"physics": physics.digest})
    )


@st.composite
def entries(draw):
    """Slots and records, some given up, some stale."""
    found = []
    for slot in draw(st.lists(st.sampled_from(SLOTS), unique=True, max_size=6)):
        accepted = draw(st.booleans())
        rows = []
        for number in range(0 if slot.variant else draw(st.integers(1, 3))):
            row = {
                "attempt": number,
                "seed": draw(st.integers(0, 2**63 - 1)),
                "outcome": "failed",
                "stage": draw(TEXT),
            }
            row |= {
                "reason": draw(TEXT),
                "detail": draw(TEXT),
                "conditions": draw(st.lists(TEXT, max_size=2)),
            }
            row |= draw(
                st.sampled_from(
                    [{}, {"kept": "ab" * 32}, {"average_speed": 0.25, "displacement": 0.5}]
                )
            )
            rows.append(row | {"sim_steps": draw(st.integers(0, 2**40)), "seconds": draw(NUMBER)})
        if rows and accepted:
            rows[-1]["outcome"] = "accepted"
        rows = [vars(slot.cell) | {"slot": slot.index} | row for row in rows]
        file = FileFacts(
            draw(st.integers(0, 2**50)), draw(st.integers(0, 2**62)), draw(st.integers(0, 9999))
        )
        if accepted:
            file = replace(
                file, physics_id=draw(NAME), assets=tuple(sorted(draw(st.sets(NAME, max_size=3))))
            )
        found.append(
            (
                slot,
                SlotRecord(
                    keys_of(slot, draw(st.sampled_from("cd"))),
                    accepted,
                    draw(HASH),
                    tuple(rows),
                    draw(NUMBER),
                    draw(NUMBER),
                    file,
                ),
            )
        )
    return found


def in_order(found):
    rank = {slot: number for number, slot in enumerate(SLOTS)}
    return sorted(found, key=lambda each: rank[each[0]])


@given(entries(), entries())
def test_what_is_written_comes_back_in_the_order_of_the_recipe_and_the_last_record_of_a_slot_is_the_one(  # noqa: E501
    first, second
):
    with Index(Path(":memory:"), new=True) as index:
        index.add(first)
        for each in second:
            index.add([each])
        found = list(index.records(index.rows(RECIPE, *FULL)))
        assert found == in_order((dict(first) | dict(second)).items())
        assert [index.record(RECIPE, slot) for slot, _ in found] == [record for _, record in found]
        other = RECIPE.model_copy(update={"tasks": ("grab_roller",), "episodes": 2, "variants": 1})
        assert index.rows(other).slots == [slot for slot in other.slots() if slot in dict(found)]


@given(entries())
def test_what_a_file_holds_of_attempts_is_all_but_the_seconds(found):
    for slot, record in found:
        stored = json.loads(json.dumps(untimed(record.attempts)))
        assert "seconds" not in {name for row in stored for name in row}
        assert (
            retimed(slot, stored, {row["attempt"]: row["seconds"] for row in record.attempts})
            == record.attempts
        )


def test_keys_of_a_cell_are_one_text():
    assert len({pack_keys(slot, keys_of(slot)) for slot in SLOTS}) == 1
    odd = SlotKeys(Key({"slot": "mine"}), Key({}), Key({"physics": "other"}))
    assert unpack_keys(SLOTS[0], pack_keys(SLOTS[0], odd)) == odd


@pytest.mark.parametrize(
    "change",
    [
        {"sim_steps": 2**70},
        {"seed": "nine"},
        {"detail": b"x"},
        {"conditions": b"x"},
        {"attempt": None},
    ],
)
def test_values_of_another_kind_are_refused_and_leave_nothing(tmp_path, change):
    row = {"attempt": 0, "seed": 1, "outcome": "accepted"} | change
    record = SlotRecord(keys_of(SLOTS[0]), True, "0" * 64, (row,))
    with Index(tmp_path / "index", new=True) as index:
        with pytest.raises((ValueError, TypeError)):
            index.add([(SLOTS[0], record)])
        assert len(index.rows(RECIPE)) == 0
        index.add([(SLOTS[1], replace(record, attempts=()))])
        assert index.rows(RECIPE).slots == SLOTS[1:2]


# --- from the files
# ------------------------------------------------------------------------------------------


def made(root):
    """A dataset with real files of four slots: accepted, accepted after a failure, one of its
    variants, given up."""
    dataset = Dataset(root)
    dataset.create(RECIPE)
    found = {}
    for number, slot in enumerate((SLOTS[0], SLOTS[2], SLOTS[3], SLOTS[4])):
        place = vars(slot.cell) | {"slot": slot.index}
        rows = [
            {
                "attempt": n,
                "seed": RECIPE.spec(slot, n).seed,
                "outcome": "failed",
                "stage": "replay",
                "reason": "missed",
            }
            | {
                "detail": f"attempt {n}",
                "conditions": ["held"],
                "sim_steps": 80 + n,
                "seconds": 1.5 + n,
            }
            for n in range(0 if slot.variant else number + 1)
        ]
        rows = [place | row for row in rows]
        keys = keys_of(slot)
        if slot == SLOTS[4]:
            record = write_given_up(dataset, slot, keys, rows)
        else:
            if rows:
                rows[-1] |= {
                    "outcome": "accepted",
                    "stage": "",
                    "reason": "",
                    "detail": "",
                    "conditions": [],
                }
            c, seed = slot.cell, RECIPE.spec(slot.physical, max(len(rows) - 1, 0)).seed
            meta = keys.header() | {"variant": slot.variant, "physics_id": f"{number:032x}"}
            path = make_episode(
                dataset.episode(slot), task=c.task, level=c.level, alpha=c.alpha, slot=slot.index, seed=seed,  # noqa: E501
                frames=3, cameras=("head_camera",), meta=meta, attempts=untimed(rows),
            )  # fmt: skip
            record = SlotRecord(
                keys,
                True,
                file_hash(path),
                tuple(rows),
                file=FileFacts.of(path.stat(), 3, f"{number:032x}"),
            )
        found[slot] = record
    record_all(dataset, found.items())
    return dataset, found


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return made(tmp_path_factory.mktemp("index") / "set")


@pytest.fixture
def mine(whole, tmp_path):
    return Dataset(shutil.copytree(whole[0].root, tmp_path / "set", copy_function=shutil.copy2))


def known(dataset):
    return {
        slot: replace(record, seconds=0.0, core_seconds=0.0)
        for slot, record in dataset.records(RECIPE)
    }


def untold(records):
    """Records without what only the clock said."""
    return {
        slot: replace(
            r,
            attempts=tuple({k: v for k, v in row.items() if k != "seconds"} for row in r.attempts),
        )
        for slot, r in records.items()
    }


def test_a_rebuilt_index_says_what_was_recorded(mine, whole):
    _, wanted = whole
    assert known(mine) == wanted
    mine.index.unlink()
    assert known(mine) == untold(wanted)  # no table of attempts was written
    mine.write_attempts(RECIPE)
    record_all(mine, wanted.items())
    mine.write_attempts(RECIPE)
    mine.index.unlink()
    assert known(mine) == wanted
    assert mine.index.exists()


def cut(path):
    os.truncate(path, path.stat().st_size // 2)


def another_version(path):
    with sqlite3.connect(path) as file:
        file.execute("PRAGMA user_version = 99")


def other_tables(path):
    with sqlite3.connect(path) as file:
        file.execute("CREATE TRIGGER mine AFTER INSERT ON slot BEGIN DELETE FROM slot; END")


def flipped(path):
    data = bytearray(path.read_bytes())
    data[4096 * 3 : 4096 * 3 + 2000] = os.urandom(2000)
    path.write_bytes(data)


def names_another(path):
    """A journal to roll back that names a file, which SQLite then deletes
    (sqlite.org/fileformat.html, "The Rollback Journal")."""
    data, name = path.read_bytes(), os.fsencode(path.parents[1] / "elsewhere")
    (size,) = struct.unpack(">H", data[16:18])
    magic, page = bytes.fromhex("d9d505f920a163d7"), data[:size]
    header = magic + struct.pack(">5I", 1, 7, len(data) // size, 512, size)
    checked = 7 + sum(page[at] for at in range(size - 200, 0, -200))
    record = struct.pack(">I", 1) + page + struct.pack(">I", checked)
    end = struct.pack(">I", 2**30 // size + 1) + name + struct.pack(">2I", len(name), sum(name))
    Path(f"{path}-journal").write_bytes(header.ljust(512, b"\0") + record + end + magic)


def writes_ahead(path):
    with sqlite3.connect(path) as file:
        file.execute("PRAGMA journal_mode = WAL")
    file.close()
    os.link(path.parents[1] / "elsewhere", f"{path}-shm")


def hard_linked(path):
    os.link(path, path.parents[1] / "other")


def without_cells(path):
    with sqlite3.connect(path) as file:
        file.execute("DELETE FROM cell")


@pytest.mark.parametrize(
    "damage",
    [
        Path.unlink,
        names_another,
        writes_ahead,
        hard_linked,
        without_cells,
        cut,
        lambda p: p.write_bytes(b""),
        lambda p: p.write_bytes(b"no database" * 999),
        another_version,
        other_tables,
        flipped,
    ],
)
def test_an_index_that_is_none_is_made_again(mine, whole, damage):
    elsewhere = mine.root.parent / "elsewhere"
    elsewhere.write_bytes(b"1" * 40_000)
    damage(mine.index)
    with pytest.raises(DamagedIndex), Index(mine.index) as index:
        index.rows(RECIPE)
    assert untold(known(mine)) == untold(whole[1])
    with Index(mine.index) as index:
        assert len(index.rows(RECIPE)) == 4
    assert elsewhere.read_bytes() == b"1" * 40_000


def test_what_nobody_may_write_is_read_in_memory(mine, whole, monkeypatch):
    mine.index.unlink()

    def refused(_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("pipeline.data.slots.reread.atomic_path", refused)
    assert known(mine) == untold(whole[1])
    assert not mine.index.exists()


def test_a_writer_whose_index_goes_or_breaks_loses_nothing(mine, whole):
    wanted = dict(whole[1])
    slot, record = SLOTS[6], wanted[SLOTS[4]]
    with IndexWriter(mine, RECIPE) as writer:
        for damage in (Path.unlink, lambda path: os.truncate(path, 0)):
            damage(mine.index)
            writer.add(slot, write_given_up(mine, slot, keys_of(slot), record.attempts))
            writer.flush()
            assert set(known(mine)) == {*wanted, slot}


def test_a_disk_that_fails_is_no_empty_index(mine, monkeypatch):
    def failing(*_, **__):
        error = sqlite3.OperationalError("disk I/O error")
        error.sqlite_errorcode = sqlite3.SQLITE_IOERR
        raise error

    monkeypatch.setattr("pipeline.data.slots.index.sqlite3.connect", failing)
    with pytest.raises(OSError, match="Input/output"):
        mine.records(RECIPE)


def write_until_killed(root):
    dataset = Dataset(root)
    with IndexWriter(dataset, RECIPE) as writer:
        for number, slot in enumerate(SLOTS[5:13]):
            writer.add(slot, write_given_up(dataset, slot, keys_of(slot), ()))
            if number == 3:
                writer.flush()
        write_given_up(dataset, SLOTS[-1], keys_of(SLOTS[-1]), ())
        writer.index._file.execute("BEGIN IMMEDIATE")
        writer.index._file.execute("DELETE FROM slot")
        os.kill(os.getpid(), signal.SIGKILL)


def test_a_killed_driver_loses_nothing_that_it_wrote_and_the_next_one_finds_what_it_did_not(
    mine, whole
):
    driver = multiprocessing.get_context("fork").Process(
        target=write_until_killed, args=(mine.root,)
    )
    driver.start()
    driver.join()
    assert driver.exitcode == -signal.SIGKILL
    assert {*whole[1], *SLOTS[5:9]} <= set(known(mine)) <= {*whole[1], *SLOTS[5:13]}
    with IndexWriter(mine, RECIPE) as writer:
        assert writer.catch_up() == set()
    assert set(known(mine)) == {*whole[1], *SLOTS[5:13], SLOTS[-1]}


# --- files that change
# ------------------------------------------------------------------------------------------


def test_a_file_that_was_touched_is_read_once_and_one_with_other_bytes_is_named(mine, monkeypatch):
    os.utime(mine.episode(SLOTS[0]))
    data = bytearray(mine.episode(SLOTS[2]).read_bytes())
    data[-1] ^= 1
    mine.episode(SLOTS[2]).write_bytes(data)
    reads = []
    monkeypatch.setattr(
        "pipeline.data.keys.file_hash", lambda path: reads.append(path) or file_hash(path)
    )
    for _ in range(2):
        with IndexWriter(mine, RECIPE) as writer:
            assert writer.catch_up() == {SLOTS[2]}
    assert sorted(reads) == sorted(
        [mine.episode(SLOTS[0]), mine.episode(SLOTS[2]), mine.episode(SLOTS[2])]
    )


def test_a_file_without_a_row_counts_if_it_is_whole_and_of_its_slot(mine, whole):
    _, wanted = whole
    with IndexWriter(mine, RECIPE) as writer, writer.index._file as file:
        file.execute("DELETE FROM slot")
        file.execute("DELETE FROM attempt")
    assert known(mine) == {}
    mine.episode(SLOTS[6]).parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(mine.episode(SLOTS[0]), mine.episode(SLOTS[6]))  # of another slot
    write_atomic(
        mine.file(SLOTS[8], False), b'{"slot": "' + SLOTS[4].path.encode() + b'", "attempts": []}'
    )
    write_atomic(mine.file(SLOTS[10], False), b"[1, 2")
    with mine.episode(SLOTS[2]).open("r+b") as file:
        file.seek(-40, 2)
        file.write(b"\1" * 40)
    # older than the episode
    write_atomic(mine.file(SLOTS[0], False), mine.file(SLOTS[4], False).read_bytes())
    with IndexWriter(mine, RECIPE) as writer:
        writer.catch_up()
    assert known(mine) == untold(
        {slot: record for slot, record in wanted.items() if slot != SLOTS[2]}
    )


def test_episodes_of_version_0_1_have_their_attempts_from_its_table(tmp_path):
    """The slots that it gave up are tried again."""
    dataset = Dataset(tmp_path / "old")
    dataset.create(RECIPE)
    first, second, third = SLOTS[0], SLOTS[2], SLOTS[16]  # the first and the third are of one cell
    rows = []
    for slot, outcomes in ((first, ("failed", "accepted")), (third, ("failed", "failed"))):
        for n, outcome in enumerate(outcomes):
            place = vars(slot.cell) | {
                "slot": slot.index,
                "attempt": n,
                "seed": RECIPE.spec(slot, n).seed,
            }
            rows.append(
                place
                | {
                    "outcome": outcome,
                    "stage": "",
                    "reason": "",
                    "detail": "",
                    "conditions": [],
                    "seconds": 1.0,
                }
            )
    assert first.cell == third.cell
    pq.write_table(pa.Table.from_pylist(rows, ATTEMPTS), dataset.attempts)
    for slot in (first, second):
        c = slot.cell
        seed = RECIPE.spec(slot, 1).seed
        meta = keys_of(slot).header() | {"average_speed": 0.5, "maximum_speed": 0.75}
        make_episode(
            dataset.episode(slot), task=c.task, level=c.level, alpha=c.alpha, slot=slot.index, seed=seed, frames=2,  # noqa: E501
            cameras=("head_camera",), meta=meta,
        )  # fmt: skip
    found = known(dataset)
    assert [row["outcome"] for row in found[first].attempts] == ["failed", "accepted"]
    assert [row["outcome"] for row in found[second].attempts] == ["accepted"]
    assert third not in found


def test_rows_are_read_while_a_build_adds_cells(tmp_path):
    file = FileFacts(1, 1, 1)

    def add_all() -> None:
        for slot in SLOTS:
            record = SlotRecord(keys_of(slot, str(slot)), False, "0" * 64, (), file=file)
            writer.add([(slot, record)])

    path = tmp_path / "index.sqlite"
    with Index(path, new=True) as writer, Index(path) as reader:
        build = Thread(target=add_all)
        build.start()
        sizes = []
        while build.is_alive():
            sizes.append(len(reader.rows(RECIPE)))
        build.join()
        sizes.append(len(reader.rows(RECIPE)))
    assert sizes == sorted(sizes) and sizes[-1] == len(SLOTS)


def test_many_rows_are_read_without_a_loop_over_them():
    """Columns are arrays, and bytes keep their zeros at the end."""
    with Index(Path(":memory:"), new=True) as index:
        index.add((slot, SlotRecord(keys_of(slot), True, "ab" + "00" * 31, ())) for slot in SLOTS)
        rows = index.rows(RECIPE, "sha256", "size")
        assert rows.ids.dtype == rows.ranks.dtype == rows.more["size"].dtype == np.int64
        assert {sha256.hex() for sha256 in rows.more["sha256"]} == {"ab" + "00" * 31}
