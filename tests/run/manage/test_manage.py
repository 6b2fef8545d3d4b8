"""diff, merge and gc on synthetic datasets, one episode made again on a built one."""

import json
import shutil
from dataclasses import replace

import h5py
import pytest

from pipeline.data.atomic import exclusive
from pipeline.data.dataset import Dataset, DatasetError
from pipeline.data.intact import intact_failures, named_slot
from pipeline.data.keys import Key, SlotKeys, file_hash
from pipeline.data.recipe.model import parse_recipe
from pipeline.run.manage.diff import diff
from pipeline.run.manage.gc import collect
from pipeline.run.manage.merge import merge
from tests.recording import record_file
from tests.run.command import inside
from tests.synthetic import make_episode

RECIPE = parse_recipe({"tasks": "click_bell", "levels": [1], "episodes": 3})
KEYS = SlotKeys(Key({"core": "1"}), Key({"renderer": "2"}), Key({"phrases": "3"}))
ASSET = "ab" + "0" * 30


def record(dataset, slot, keys=KEYS, *failed):
    seed = dataset.recipe().spec(slot, 0).seed
    row = {
        "attempt": len(failed),
        "seed": seed,
        "outcome": "accepted",
        "seconds": 1.0,
        "sim_steps": 8,
        "stage": "",
        "reason": "",
    }
    return record_file(dataset, slot, keys, [*failed, row], assets=(ASSET,))


def made(root, numbers, recipe=RECIPE):
    """A dataset with some of the episodes of its recipe, by their place in it."""
    dataset = Dataset(root)
    dataset.create(recipe)
    for number, slot in enumerate(recipe.slots()):
        if number in numbers:
            cell = slot.cell
            make_episode(
                dataset.episode(slot),
                task=cell.task,
                level=cell.level,
                slot=slot.index,
                seed=number,
                frames=3,
            )
            record(dataset, slot)
    asset = dataset.bodies / ASSET[:2] / f"{ASSET}.npz"
    asset.parent.mkdir(parents=True)
    asset.write_bytes(b"asset")
    return dataset


def everything(root):
    return {p.relative_to(root).as_posix() for p in root.rglob("*") if p.is_file()}


# --- diff
# ------------------------------------------------------------------------------------------


def test_a_dataset_does_not_differ_from_its_copy(tmp_path):
    a = made(tmp_path / "a", {0, 1, 2})
    shutil.copytree(a.root, tmp_path / "b")
    assert diff(a, Dataset(tmp_path / "b")) == {"same": 3, "differ": [], "why": {}, "recipes": []}
    code, out, err = inside("diff", a.root, tmp_path / "b")
    assert (code, out.strip(), err) == (0, "3 slots are the same, 0 differ", "")


def test_what_differs_is_named_with_its_reason(tmp_path):
    a, b = made(tmp_path / "a", {0, 1, 2}), made(tmp_path / "b", {0, 1})
    first, second, third = RECIPE.slots()
    other = replace(KEYS, physics=Key({"core": "9"}), render=Key({"renderer": "2", "shaders": "x"}))
    record(b, first, other)
    with h5py.File(b.episode(second), "r+") as file:
        file.attrs["touched"] = 1
    record(b, second)
    found = diff(a, b)
    assert (found["same"], [d["slot"] for d in found["differ"]]) == (
        0,
        [first.path, second.path, third.path],
    )
    assert found["differ"][0]["parts"] == ("physics.core", "render.shaders")
    assert found["why"] == {
        "other physics.core, render.shaders": 1,
        "other bytes, same keys": 1,
        "is there in A, is not finished in B": 1,
    }
    a.episode(third).unlink()
    assert len(diff(a, b)["differ"]) == 2
    code, out, _ = inside("diff", a.root, b.root, "--json")
    assert (code, len(json.loads(out)["differ"])) == (1, 2)


def test_what_a_recipe_does_not_have_is_no_damage(tmp_path):
    fewer = parse_recipe({"tasks": "click_bell", "levels": [1], "episodes": 2})
    a, b = made(tmp_path / "a", {0, 1, 2}), made(tmp_path / "b", {0}, fewer)
    first, second, third = RECIPE.slots()
    assert diff(a, b)["why"] == {
        "is there in A, is not finished in B": 1,
        "not wanted by B, is there in A": 1,
    }
    code, out, _ = inside("diff", b.root, a.root)
    assert code == 1 and f"{third.path}: not wanted by A, is there in B\n" in out
    assert f"{second.path}: is not finished in A, is there in B\n" in out and first.path not in out
    other = parse_recipe({"tasks": "click_bell", "levels": [1], "episodes": 3, "seed": 3})
    assert diff(a, made(tmp_path / "c", {0}, other))["recipes"] == ["seed is 0 in A, 3 in B"]


# --- merge
# ------------------------------------------------------------------------------------------


def test_a_dataset_is_not_merged_with_itself(tmp_path):
    a = made(tmp_path / "a", {0})
    (tmp_path / "link").symlink_to(a.root)
    for again in (a.root, tmp_path / "link"):
        code, out, err = inside("merge", a.root, again, "--out", tmp_path / "c")
        assert (code, out, err.count("\n")) == (2, "", 1) and "named twice" in err
    assert not (tmp_path / "c").exists()


def test_parts_of_one_recipe_are_joined_by_hard_links(tmp_path):
    a, b, out = made(tmp_path / "a", {0}), made(tmp_path / "b", {1, 2}), Dataset(tmp_path / "c")
    note = b.root / "annotations" / "flow@12345678" / f"{list(RECIPE.slots())[1].path}.h5"
    note.parent.mkdir(parents=True)
    note.write_bytes(b"flow")
    for _ in range(2):  # again, it changes nothing
        merged = merge([a, b], out)
        assert (merged.slots, merged.accepted, merged.given_up, merged.taken) == (3, 3, 0, (1, 2))
        for number, slot in enumerate(RECIPE.slots()):
            source = b if number else a
            assert out.episode(slot).stat().st_ino == source.episode(slot).stat().st_ino
            assert out.record(RECIPE, slot) == source.record(RECIPE, slot)
    assert {ASSET} == {p.stem for p in out.bodies.glob("*/*.npz")}
    assert (out.root / note.relative_to(b.root)).read_bytes() == b"flow"
    assert diff(out, a)["same"] == 1 and out.report.exists() and len(out.accepted(RECIPE)) == 3


def test_kept_failures_come_along(tmp_path):
    a, b, out = made(tmp_path / "a", {0}), made(tmp_path / "b", {1}), Dataset(tmp_path / "c")
    slot = list(RECIPE.slots())[1]
    b.failure(slot, 0).parent.mkdir(parents=True)
    b.failure(slot, 0).write_bytes(b"failed")
    failed = {
        "attempt": 0,
        "seed": 1,
        "outcome": "failed",
        "stage": "replay",
        "reason": "no_success",
    }
    record(b, slot, KEYS, failed | {"kept": file_hash(b.failure(slot, 0))})
    merge([a, b], out)
    assert intact_failures(out, RECIPE) == [out.failure(slot, 0)]


def test_other_levels_of_a_recipe_are_joined_into_one_that_wants_both(tmp_path):
    high = RECIPE.model_copy(update={"levels": (2,), "episodes": 2})
    out = Dataset(tmp_path / "c")
    merged = merge([made(tmp_path / "a", {0, 1, 2}), made(tmp_path / "b", {0, 1}, high)], out)
    assert (merged.slots, merged.accepted, merged.taken) == (6, 5, (3, 2))
    assert (out.recipe().levels, out.recipe().episodes) == ((1, 2), 3)


@pytest.mark.parametrize("fault", ["recipe", "size", "code", "bytes", "damaged"])
def test_what_cannot_be_joined_is_one_line_and_makes_nothing(tmp_path, fault):
    other = RECIPE.model_copy(
        update={"recipe": {"seed": 3}, "size": {"size": (96, 64)}}.get(fault, {})
    )
    a, b = made(tmp_path / "a", {0, 1}), made(tmp_path / "b", {1, 2}, other)
    _, second, third = RECIPE.slots()
    if fault == "code":
        record(b, third, replace(KEYS, physics=Key({"core": "9"})))
    if fault in ("bytes", "damaged"):
        with h5py.File(b.episode(third if fault == "damaged" else second), "r+") as file:
            file.attrs["touched"] = 1
    if fault == "bytes":
        record(b, second)
    code, out, err = inside("merge", a.root, b.root, "--out", tmp_path / "c")
    said = {
        "recipe": "seed is 0 in the first, 3 in the second",
        "code": "physics: core",
        "bytes": "with other bytes",
        "damaged": "bytes differ",
    }
    said["size"] = "size is"
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert said[fault] in err
    assert not list((tmp_path / "c").glob("report/*"))


# --- gc
# ------------------------------------------------------------------------------------------


def test_orphans_are_listed_then_removed_and_nothing_else(tmp_path):
    dataset = made(tmp_path / "out", {0, 1})
    before = everything(dataset.root)
    first = next(RECIPE.slots())
    orphans = {
        f"episodes/{first.cell.path}/episode_0000007.hdf5": "episode of no slot",
        "episodes/gone_task/aloha-agilex/L1/clean/episode_0000000.hdf5": "episode of no slot",
        f"annotations/flow@12345678/{first.cell.path}/episode_0000002.h5": (
            "annotation of no episode"
        ),
        f"assets/bodies/cd/{'cd' * 16}.npz": "asset of no episode",
    }
    mine = {
        "episodes/notes.txt",
        f"annotations/flow@12345678/{first.path}.h5",
        "annotations/flow@12345678/stage.json",
    }
    for name in (*orphans, *mine):
        (dataset.root / name).parent.mkdir(parents=True, exist_ok=True)
        (dataset.root / name).write_bytes(b"x")
    code, out, _ = inside("gc", dataset.root, "--dry-run", "--json")
    assert code == 0 and {f["path"]: f["why"] for f in json.loads(out)["files"]} == orphans
    assert everything(dataset.root) == before | mine | set(orphans)
    assert {o.path for o in collect(dataset)} == set(orphans)
    assert everything(dataset.root) == before | mine
    assert collect(dataset) == []


def stray(dataset, count=1):
    """Whole episodes of no slot, each with an asset of its own."""
    paths = []
    for number in range(count):
        path = dataset.episodes / f"gone_task/aloha-agilex/L1/clean/episode_{number:07d}.hdf5"
        make_episode(path, task="gone_task", slot=number, frames=3)
        paths.append(path)
    return paths


def test_a_whole_episode_of_no_slot_is_set_aside_and_what_is_there_stays(tmp_path):
    dataset = made(tmp_path / "out", {0, 1, 2})
    for number in range(2):
        (path,) = stray(dataset)
        data = path.read_bytes()
        code, out, _ = inside("gc", dataset.root)
        assert (
            code == 0 and "1 whole episodes of no slot were moved to" in out and not path.exists()
        )
        name = path.name if not number else f"{path.stem}.1.hdf5"
        assert (
            dataset.orphans / "episodes/gone_task/aloha-agilex/L1/clean" / name
        ).read_bytes() == data
    assert collect(dataset) == []


def test_more_than_a_quarter_of_the_episodes_is_not_touched(tmp_path):
    dataset = made(tmp_path / "out", {0, 1, 2})
    stray(dataset, 2)
    before = everything(dataset.root)
    with pytest.raises(
        DatasetError,
        match=r"2 of 5 whole episodes belong to no slot of manifest.yaml, more than 25 %",
    ):
        collect(dataset)
    assert everything(dataset.root) == before


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("alpha:\n- 0.1\n", "alpha:\n- 0.9\n"),
        ("levels:\n- 1\n", "levels:\n- 3\n"),
        ("\nepisodes: 3\n", "\nepisodes: 1\n"),
        ("\nattempts: 30\n", "\nattempts: 31\n"),
        ("\ninstructions: 100\n", "\ninstructions: 99\n"),
        ("\nvisual_seed: 0\n", "\nvisual_seed: 1\n"),
        ("keep_failures: none", "keep_failures: all"),
        ("expert: planned", "expert: reactive"),
        ("lead: 0.0", "lead: 0.5"),
        ("textures: seen", "textures: unseen"),
    ],
)
def test_an_edited_manifest_is_named_and_costs_nothing(tmp_path, old, new):
    dataset = made(tmp_path / "out", {0, 1, 2})
    text = dataset.manifest.read_text()
    assert old in text
    dataset.manifest.write_text(text.replace(old, new))
    before = everything(dataset.root)
    said = f"{dataset.manifest}: was edited"
    for words in (
        ("gc", dataset.root),
        (
            "build",
            "--tasks",
            "click_bell",
            "--levels",
            "1",
            "--episodes",
            "3",
            "--out",
            dataset.root,
        ),
        ("merge", dataset.root, tmp_path / "b", "--out", tmp_path / "c"),
        ("render", dataset.root, "--out", tmp_path / "c"),
    ):
        code, out, err = inside(*words)
        assert (code, out) == (2, "") and said in err and err.count("\n") == 1
    code, out, _ = inside("status", dataset.root)
    assert code == 0 and out.startswith(said)
    assert everything(dataset.root) == before


def test_a_dataset_that_grows_is_sealed_again_and_one_of_before_has_no_seal(tmp_path):
    dataset = made(tmp_path / "out", {0, 1, 2})
    dataset.create(RECIPE.model_copy(update={"episodes": 4}))
    assert not dataset.is_edited() and dataset.recipe().episodes == 4
    lines = dataset.manifest.read_text().splitlines(keepends=True)
    dataset.manifest.write_text("".join(lines[:-1]).replace("episodes: 4", "episodes: 5"))
    assert not dataset.is_edited() and dataset.recipe().episodes == 5


def test_an_asset_that_only_a_kept_failure_names_stays(tmp_path):
    dataset = made(tmp_path / "out", {0})
    failure = dataset.failure(next(RECIPE.slots()), 0)
    make_episode(failure, frames=3)
    name = "cd" * 16
    with h5py.File(failure, "r+") as file:
        meta = json.loads(str(file.attrs["meta"]))
        meta["drawing"]["assets"] = {"bell": name}
        file.attrs["meta"] = json.dumps(meta)
    asset = dataset.bodies / name[:2] / f"{name}.npz"
    asset.parent.mkdir(parents=True, exist_ok=True)
    asset.write_bytes(b"asset")
    assert collect(dataset) == []
    failure.unlink()
    assert [orphan.why for orphan in collect(dataset)] == ["asset of no episode"]


def test_a_dataset_that_another_command_writes_is_left_alone(tmp_path):
    a, b, out = made(tmp_path / "a", {0}), made(tmp_path / "b", {1}), made(tmp_path / "out", {2})
    before = everything(out.root)
    with exclusive(out.root):
        for words in (
            (
                "build",
                "--tasks",
                "click_bell",
                "--levels",
                "1",
                "--episodes",
                "3",
                "--out",
                out.root,
                "--quiet",
            ),
            ("render", a.root, "--out", out.root, "--quiet"),
            ("merge", a.root, b.root, "--out", out.root),
            ("gc", out.root),
        ):
            code, text, err = inside(*words)
            assert (
                (code, text) == (2, "")
                and err.count("\n") == 1
                and f"{out.root}: another command is writing it" in err
            ), words
    assert everything(out.root) == before


# --- one episode made again


def test_an_episode_is_made_again_to_the_same_bytes_and_a_change_is_found(built, tmp_path):
    mine = shutil.copytree(built, tmp_path / "mine")
    name = "click_bell/aloha-agilex/L1/clean/episode_0000000"
    code, out, err = inside("verify", built, "--episode", name, "--quiet")
    assert (code, err) == (0, "") and "state bytes equal, images equal" in out
    with h5py.File(mine / "episodes" / f"{name}.hdf5", "r+") as file:
        vector = file["joint_action/vector"]
        assert isinstance(vector, h5py.Dataset)
        vector[0, 0] += 1e-3
    code, out, _ = inside("verify", mine, "--episode", f"episodes/{name}.hdf5", "--json")
    assert code == 1 and "it differs in joint_action/vector" in json.loads(out)["problems"][-1]


def test_an_episode_is_found_by_its_path_however_written(tmp_path):
    dataset = made(tmp_path / "out", {0})
    slot = next(RECIPE.slots())
    for text in (
        slot.path,
        f"episodes/{slot.path}.hdf5",
        str(dataset.episode(slot)),
        str(dataset.episode(slot).resolve()),
    ):
        assert named_slot(dataset, RECIPE, text) == slot
    for text in ("3", "../x", f"{slot.path}_v1"):
        with pytest.raises(DatasetError, match="has no such slot; write it as"):
            named_slot(dataset, RECIPE, text)
