"""What `verify` finds: every kind of damage in the file that has it, and an episode that cannot be
made again."""

import json
import os
import shutil
from pathlib import Path

import h5py
import pytest

from pipeline.crew.contract import Crew
from pipeline.data.dataset import Dataset
from pipeline.data.episode.hdf5 import content_hashes
from pipeline.data.keys import canonical
from pipeline.run.annotate import annotate
from pipeline.run.build import build
from pipeline.run.checks.verify import verify
from pipeline.run.identity import core
from pipeline.run.identity import slot_keys as code
from tests.run.command import inside
from tests.synthetic import make_episode

pytestmark = pytest.mark.usefixtures("without_report")
FIRST, SECOND = (
    f"episodes/click_bell/aloha-agilex/L{level}/clean/episode_0000000.hdf5" for level in (1, 2)
)


@pytest.fixture(scope="module")
def whole(built, tmp_path_factory):
    """A finished dataset with flow maps and an export; nobody writes to it."""
    root = Path(shutil.copytree(built, tmp_path_factory.mktemp("verify") / "whole"))
    annotate(root, ("flow",))
    assert inside("export", root, "--format", "parquet", "--quiet")[0] == 0
    return root


@pytest.fixture
def mine(whole, tmp_path):
    """A copy to write to."""
    return Path(shutil.copytree(whole, tmp_path / "mine"))


def cut(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def flip(path):
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 255
    path.write_bytes(data)


def append(path):
    path.write_bytes(path.read_bytes() + bytes(64))


def garble(path):
    path.write_text("once upon a time")


def empty_list(path):
    path.write_text("[]")


def make_directory(path):
    path.unlink()
    path.mkdir()


def change(**attributes):
    """Change attributes of an episode, and write the hashes of its content anew."""

    def damage(path):
        with h5py.File(path, "r+") as file:
            meta = json.loads(file.attrs["meta"])
            file.attrs["meta"] = json.dumps(
                meta | {key: of(meta[key]) for key, of in attributes.items()}
            )
            file.attrs["hashes"] = canonical(
                content_hashes(file, lambda dataset: dataset[()])
            ).decode()

    return damage


def put(name, of):
    """Replace a dataset of an episode, and write the hashes of its content anew."""

    def damage(path):
        with h5py.File(path, "r+") as file:
            values = of(file[name][()])
            del file[name]
            file[name] = values
            file.attrs["hashes"] = canonical(
                content_hashes(file, lambda dataset: dataset[()])
            ).decode()

    return damage


def of_another_recipe(keys):
    return keys | {"physics": keys["physics"] | {"recipe": "0" * 32}}


def without_index(root):
    """Without the cache that knows the hashes of the files, which must then be found by what the
    files say themselves."""
    (root / "index.sqlite").unlink()


DAMAGES = {
    "cut": cut,
    "a flipped byte": flip,
    "bytes appended": append,
    "text": garble,
    "missing": Path.unlink,
    "a directory": make_directory,
}
OF_CONTENT = {
    "wrong key": change(physics_key=lambda _: "0" * 32),
    "key of another recipe": change(keys=of_another_recipe),
    "a short array": put("joint_action/vector", lambda v: v[:-1]),
    "an array of another type": put("state/qpos", lambda v: v.astype("f4")),
    "a NaN": put("target/pose", lambda v: v * float("nan")),
    "an image that does not decode": put("observation/head_camera/rgb", lambda v: v.astype("S99")),
}


def problems(root, **options):
    found = verify(Dataset(root), **options)
    assert found["ok"] == (not found["problems"])
    assert all(len(problem.splitlines()) == 1 for problem in found["problems"])
    return found["problems"]


def blamed(root):
    """The files that problems name."""
    return {problem.partition(": ")[0] for problem in problems(root)}


def test_a_whole_dataset_is_sound(whole):
    status, out, err = inside("verify", whole, "--quiet")
    assert (status, err) == (0, "") and out.startswith("sound: ") and "3 sound episodes" in out


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_damage_is_found_in_its_file_alone(damage, mine):
    damage(mine / FIRST)
    assert blamed(mine) == {FIRST}


def test_a_build_puts_right_what_is_damaged_and_what_is_missing(mine, built):
    cut(mine / FIRST)
    (mine / SECOND).unlink()
    garble(mine / "provenance.json")
    build(mine, Dataset(mine).recipe(), Crew(), shown="none")
    assert (
        all((mine / path).read_bytes() == (built / path).read_bytes() for path in (FIRST, SECOND))
        and problems(mine) == []
    )


def test_damage_that_leaves_length_and_time_is_found_and_put_right(mine, built):
    before = (mine / FIRST).stat()
    flip(mine / FIRST)
    os.utime(mine / FIRST, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert blamed(mine) == {FIRST}
    build(mine, Dataset(mine).recipe(), Crew(), shown="none")
    assert (mine / FIRST).read_bytes() == (built / FIRST).read_bytes()


SILENT = {"a short array", "an array of another type"}
"""Damage that only the hash tells, which is in the index."""


@pytest.mark.parametrize(
    "damage", [cut, flip, garble, *(OF_CONTENT[name] for name in OF_CONTENT if name not in SILENT)]
)
def test_a_file_says_itself_that_it_is_damaged(damage, mine):
    without_index(mine)
    damage(mine / FIRST)
    assert blamed(mine) == {FIRST}


def test_a_file_of_another_place_and_one_of_no_slot_are_found(mine):
    without_index(mine)
    shutil.copy(mine / FIRST, mine / SECOND)
    foreign = "episodes/gone_task/aloha-agilex/L1/clean/episode_0000000.hdf5"
    make_episode(mine / foreign, task="gone_task", frames=3)
    lines = problems(mine)
    assert {line.partition(": ")[0] for line in lines} == {SECOND, foreign}
    for path, said in (
        (SECOND, f"holds {FIRST.removesuffix('.hdf5')}"),
        (foreign, "belongs to no slot"),
    ):
        assert any(line.startswith(path) and said in line for line in lines)


@pytest.mark.parametrize("damage", [cut, flip, Path.unlink, make_directory])
def test_damage_of_assets_and_annotations_is_found_in_them_alone(damage, mine):
    asset = min(mine.glob("assets/bodies/*/*.npz"))
    flow = min(mine.glob("annotations/*/click_bell/**/*.h5"))
    damage(asset)
    damage(flow)
    # an annotation that is missing is for `annotate` to make
    wanted = [asset] + [flow] * (damage is not Path.unlink and damage is not make_directory)
    assert blamed(mine) >= {path.relative_to(mine).as_posix() for path in wanted}
    assert not any(name.startswith("episodes/") for name in blamed(mine))


@pytest.mark.parametrize("damage", [cut, flip, Path.unlink])
def test_damage_of_an_export_is_found_in_it_alone(damage, mine):
    damage(min(mine.glob("exports/parquet/data-*.parquet")))
    assert blamed(mine) == {"exports/parquet"}


@pytest.mark.parametrize(
    "damage", [empty_list, garble, cut, lambda path: path.write_text('{"renderer": "x"}')]
)
def test_provenance_that_was_changed_is_one_line(damage, mine):
    damage(mine / "provenance.json")
    assert blamed(mine) == {"provenance.json"}
    status, out, err = inside("verify", mine, "--quiet")
    assert (status, err) == (1, "") and "Traceback" not in out
    assert inside("status", mine)[0] == 0


def test_attempts_that_cannot_be_read_are_found(mine):
    garble(mine / "attempts.parquet")
    assert blamed(mine) == {"attempts.parquet"}


def test_an_index_that_is_gone_costs_nothing(mine):
    without_index(mine)
    assert problems(mine) == []


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("levels:\n- 1\n", "levels:\n- 0\n"),
        ("alpha:\n- 0.1\n", "alpha:\n- 0.9\n"),
        ("lead: 0.0", "lead: 0.5"),
    ],
)
def test_an_edited_manifest_is_found_and_no_episode_is_blamed(old, new, mine):
    manifest = mine / "manifest.yaml"
    assert old in manifest.read_text()
    manifest.write_text(manifest.read_text().replace(old, new))
    assert blamed(mine) == {"manifest.yaml"}
    flip(mine / FIRST)
    assert blamed(mine) == {"manifest.yaml", FIRST}


def test_an_unfinished_dataset_is_no_damaged_one(mine):
    without_index(mine)
    (mine / FIRST).unlink()
    (mine / "attempts.parquet").unlink()
    found = verify(Dataset(mine))
    assert (found["ok"], found["episodes"], found["open"]) == (True, 2, 1)


def test_episodes_are_made_again_to_the_same_bytes(mine):
    status, out, err = inside("verify", mine, "--again", "1", "--quiet")
    assert (status, err) == (0, "") and "made again, state bytes equal, images equal" in out


def test_an_episode_that_nobody_could_have_made_is_found(mine):
    """All hashes are those of its content."""
    without_index(mine)
    for path in mine.glob("episodes/**/*.hdf5"):
        put("joint_action/vector", lambda v: v + 1e-3)(path)
    assert problems(mine) == []
    (found,) = problems(mine, again=1)
    assert "made again, it differs in joint_action/vector" in found


def test_episodes_of_another_version_cannot_be_made_again(mine, monkeypatch):
    without_index(mine)
    monkeypatch.setattr(core, "PHYSICS_PACKAGES", ("numpy",))
    code.cell_code.cache_clear()
    status, out, _ = inside("verify", mine, "--again", "2", "--quiet")
    code.cell_code.cache_clear()
    assert (
        status == 1
        and "2 of 2 episodes are not made again" in out
        and "3 made by another version" in out
    )
