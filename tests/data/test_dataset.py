"""A dataset directory: its recipe, its index, its attempts."""

import errno
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pipeline.data.atomic import write_atomic
from pipeline.data.dataset import Dataset, DatasetError
from pipeline.data.intact import intact_episodes
from pipeline.data.keys import Key, SlotKeys
from pipeline.data.parsing import parse_json
from pipeline.data.recipe.model import parse_recipe
from pipeline.data.slots.records import ATTEMPTS, MOST_ATTEMPTS
from tests import recording

RECIPE = parse_recipe({"tasks": "click_bell", "levels": [1, 3], "episodes": 2})
SLOT = next(iter(RECIPE.slots()))
ROOT = Path(__file__).parents[2]
KEYS = SlotKeys(Key({"code": "1"}), Key({"code": "2"}), Key({"code": "3"}))


def attempt_row(number, outcome="accepted"):
    cell = {
        "task": "click_bell",
        "embodiment": "aloha-agilex",
        "level": 1,
        "alpha": 0.1,
        "domain": "clean",
    }
    reason = (
        {"stage": "", "reason": ""}
        if outcome == "accepted"
        else {"stage": "replay", "reason": "missed"}
    )
    return (
        cell
        | reason
        | {
            "slot": 0,
            "attempt": number,
            "seed": 9,
            "outcome": outcome,
            "sim_steps": 800,
            "seconds": 1.5,
        }
    )


def finish(dataset, slot, accepted=True):
    rows = [attempt_row(0, "failed"), attempt_row(1)] if accepted else [attempt_row(0, "failed")]
    recording.finish(dataset, slot, KEYS, rows)


def everything(root):
    return sorted(p.relative_to(root).as_posix() for p in root.rglob("*") if p.is_file())


# --- the directory
# ------------------------------------------------------------------------------------------


def test_a_directory_keeps_its_recipe_and_refuses_another(tmp_path):
    dataset = Dataset(tmp_path / "out")
    dataset.create(RECIPE)
    dataset.create(RECIPE)
    assert dataset.recipe() == RECIPE
    with pytest.raises(DatasetError, match="another recipe"):
        dataset.create(RECIPE.model_copy(update={"seed": 1}))
    assert dataset.recipe() == RECIPE


GROWN = (
    {"episodes": 5},
    {"episodes": {"clean": 2}},
    {"levels": (3, 2, 1)},
    {"tasks": ("beat_block_hammer", "click_bell")},
    {"embodiments": ("aloha-agilex", "piper")},
    {"domains": ("randomized", "clean"), "episodes": {"clean": 2, "randomized": 1}},
    {"alpha": (0.05, 0.1)},
    {"name": "bells"},
)


@pytest.mark.parametrize("more", GROWN)
def test_a_directory_grows_to_any_recipe_that_holds_its_slots(tmp_path, more):
    dataset, larger = Dataset(tmp_path), RECIPE.model_copy(update=more)
    assert set(RECIPE.slots()) <= set(larger.slots())
    dataset.create(RECIPE)
    for slot in RECIPE.slots():
        finish(dataset, slot)
    dataset.create(larger)
    assert dataset.recipe() == parse_recipe(larger.model_dump())
    assert {slot for slot, _ in dataset.records(dataset.recipe())} == set(RECIPE.slots())
    if set(RECIPE.slots()) < set(larger.slots()):
        with pytest.raises(DatasetError, match=r"another recipe, with more: .* name all of it"):
            dataset.create(RECIPE)


def test_a_manifest_of_robots_that_wore_vendor_meshes_is_read(tmp_path):
    dataset = Dataset(tmp_path)
    dataset.create(RECIPE)
    with open(dataset.manifest, "a") as file:
        file.write("robot_meshes: {aloha-agilex: abcd}\n")
    assert dataset.recipe() == RECIPE


@pytest.mark.parametrize(
    ("other", "said"),
    [
        ({"levels": (1, 2)}, "levels 3"),
        ({"tasks": ("shake_bottle",)}, "tasks click_bell"),
        ({"episodes": 1}, "2 episodes a cell"),
        ({"alpha": (0.2,)}, "alpha 0.1"),
        ({"episodes": {"randomized": 2}}, "2 episodes a cell"),
        ({"seed": 3}, "seed is 0 there, not 3"),
        ({"fps": 30, "levels": (0, 1, 3)}, "fps is 15 there, not 30"),
        ({"contact": "continue"}, r"contact is what the rules say \(stop\) there, not 'continue'"),
        (
            {"rules": "domino", "contact": "stop"},
            (
                r"rules is 'strict' there, not 'domino'; contact is what the rules say \(stop\)"
                r" there, not 'stop'"
            ),
        ),
    ],
)
def test_a_recipe_that_leaves_out_or_changes_what_is_held_is_refused(tmp_path, other, said):
    dataset = Dataset(tmp_path)
    dataset.create(RECIPE)
    with pytest.raises(DatasetError, match=said) as error:
        dataset.create(RECIPE.model_copy(update=other))
    assert "\n" not in str(error.value)
    assert dataset.recipe() == RECIPE


def test_a_contact_that_the_rules_imply_is_named_where_it_is_refused(tmp_path):
    dataset = Dataset(tmp_path)
    domino = RECIPE.model_copy(update={"rules": "domino"})
    dataset.create(domino)
    with pytest.raises(
        DatasetError, match=r"contact is what the rules say \(continue\) there, not 'continue'"
    ):
        dataset.create(domino.model_copy(update={"contact": "continue"}))
    dataset.create(domino)


def test_a_directory_grows_by_variants(tmp_path):
    dataset = Dataset(tmp_path / "out")
    two, three = (
        RECIPE.model_copy(update={"visuals": "randomized", "variants": n}) for n in (2, 3)
    )
    dataset.create(two)
    dataset.create(three)
    assert dataset.recipe() == three
    for other in (two, three.model_copy(update={"variants": 4, "visual_seed": 1}), RECIPE):
        with pytest.raises(DatasetError, match="another recipe"):
            dataset.create(other)
    assert dataset.recipe() == three


def test_a_manifest_of_a_version_with_fewer_keys_is_the_same_recipe(tmp_path):
    dataset = Dataset(tmp_path / "out")
    old = "".join(
        line
        for line in RECIPE.to_yaml().splitlines(True)
        if not line.startswith(("variants", "visual"))
    )
    write_atomic(dataset.manifest, old.encode())
    dataset.create(RECIPE)
    assert dataset.manifest.read_text() == old


def test_a_directory_that_holds_something_else_is_left_alone(tmp_path):
    (tmp_path / "thesis.txt").write_text("precious")
    with pytest.raises(DatasetError, match="no dataset"):
        Dataset(tmp_path).create(RECIPE)
    assert everything(tmp_path) == ["thesis.txt"]
    with pytest.raises(DatasetError, match=r"manifest\.yaml"):
        Dataset(tmp_path).recipe()


def test_a_damaged_manifest_is_one_clear_line(tmp_path):
    dataset = Dataset(tmp_path)
    dataset.create(RECIPE)
    for text in ("levels: [9]\n", "a: [", "- 1\n"):
        dataset.manifest.write_text(text)
        with pytest.raises(DatasetError, match=r"manifest\.yaml") as error:
            dataset.recipe()
        assert "\n" not in str(error.value)


def test_attempts_are_gathered_in_the_order_of_the_recipe(tmp_path):
    dataset = Dataset(tmp_path)
    dataset.create(RECIPE)
    slots = list(RECIPE.slots())
    for slot in reversed(slots[1:]):
        finish(dataset, slot, accepted=slot is not slots[-1])
    table = dataset.write_attempts(RECIPE)
    assert table.schema == ATTEMPTS
    assert table.column("outcome").to_pylist() == [
        "failed",
        "accepted",
        "failed",
        "accepted",
        "failed",
    ]
    assert not [p for p in everything(tmp_path) if p.endswith(".tmp")]
    record = dataset.record(RECIPE, slots[1])
    assert record is not None and record.seconds == 1.0


# --- what stands in its place
# ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "said"), [("[" * 20_000 + "]" * 20_000, "deeply"), ("{", "property name")]
)
def test_json_that_is_refused(text, said):
    with pytest.raises(ValueError, match=said):
        parse_json(text)


@pytest.mark.parametrize("name", ["annotations", "assets", "episodes", "exports", "report"])
def test_a_file_where_a_directory_belongs_is_named(tmp_path, name):
    dataset = Dataset(tmp_path)
    dataset.create(RECIPE)
    (tmp_path / name).write_text("")
    for use in (dataset.recipe, lambda: dataset.create(RECIPE)):
        with pytest.raises(DatasetError, match=f"{name} is a file, not a directory; remove it"):
            use()


def test_a_dataset_that_is_a_file(tmp_path):
    (tmp_path / "out").write_text("")
    with pytest.raises(DatasetError, match="is a file"):
        Dataset(tmp_path / "out").recipe()


def test_what_may_not_be_read_is_neither_absent_nor_damaged(tmp_path, monkeypatch):
    dataset = Dataset(tmp_path)
    dataset.create(RECIPE)
    finish(dataset, SLOT)

    def refuse(path):
        raise PermissionError(errno.EACCES, "Permission denied", str(path))

    with monkeypatch.context() as patch:
        patch.setattr("pipeline.data.keys.open_regular", refuse)
        with pytest.raises(DatasetError, match=r"hdf5: cannot be read \(Permission denied\)"):
            intact_episodes(dataset, RECIPE)


def test_finished_episodes_that_are_missing_are_counted_and_the_first_is_named(tmp_path):
    dataset = Dataset(tmp_path)
    dataset.create(RECIPE)
    slots = list(RECIPE.slots())
    for slot, accepted in zip(slots, (True, True, True, False), strict=True):
        finish(dataset, slot, accepted)
    assert dataset.missing(RECIPE) == [] and len(intact_episodes(dataset, RECIPE)) == 3
    dataset.episode(slots[2]).unlink()
    with pytest.raises(
        DatasetError,
        match=(
            rf"^1 episode is missing that .*, first {dataset.episode(slots[2])}; rerun the build"
            r" command"
        ),
    ):
        intact_episodes(dataset, RECIPE)
    dataset.episode(slots[0]).unlink()
    with pytest.raises(
        DatasetError, match=rf"^2 episodes are missing that .*, first {dataset.episode(slots[0])};"
    ):
        intact_episodes(dataset, RECIPE)
    assert dataset.missing(RECIPE) == [dataset.episode(slots[0]), dataset.episode(slots[2])]


@pytest.mark.parametrize(
    "table",
    [
        pa.table({"a": [1]}),
        pa.table({name: [[1]] for name in ("task", "embodiment", "outcome")}),
        pa.table({"task": pa.nulls(MOST_ATTEMPTS + 1, pa.string())}),
    ],
)
def test_a_table_of_attempts_that_is_none_is_named(tmp_path, table):
    dataset = Dataset(tmp_path)
    pq.write_table(table, dataset.attempts)
    with pytest.raises(DatasetError, match=r"attempts\.parquet: cannot be read"):
        dataset.attempt_rows("task", "embodiment", "outcome")
