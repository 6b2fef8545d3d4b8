"""A received dataset with links, pipes or devices in it: no verb reads, writes or deletes anything
elsewhere; one line, exit code 2. A dataset that is reached through a link is a dataset."""

import os
import shutil

import pytest

from pipeline.data.dataset import Dataset
from pipeline.data.keys import Key, SlotKeys
from pipeline.data.recipe.model import parse_recipe
from tests.recording import record_file
from tests.run.command import inside
from tests.synthetic import make_episode

RECIPE = parse_recipe({"tasks": "click_bell", "levels": [1], "episodes": 1})
KEYS = SlotKeys(Key({"core": "1"}), Key({"renderer": "2"}), Key({"phrases": "3"}))
CELL = "click_bell/aloha-agilex/L1/clean"
CANARY = "canary of elsewhere"

LINKS = (
    "annotations/flow@01234567",
    "assets/bodies/29",
    "assets",
    "episodes",
    f"episodes/{CELL}",
    f"episodes/{CELL}/episode_0000000.hdf5",
    "report",
    "report/view",
    f"logs/{CELL}/episode_0000000.log",
    "manifest.yaml",
    "index.sqlite",
    "provenance.json",
    "exports/parquet",
    "orphans",
)
VERBS = {
    "status": ("status", "{set}"),
    "rebuild": ("status", "{set}", "--rebuild"),
    "verify": ("verify", "{set}", "--quiet"),
    "gc": ("gc", "{set}"),
    "build": ("build", "--tasks", "click_bell", "--levels", "1", "--episodes", "1", "--quiet"),
    "plan": ("plan", "--like", "{set}"),
    "view": ("view", "{set}", "--quiet"),
    "export": ("export", "{set}", "--format", "parquet", "--quiet"),
    "annotate": ("annotate", "{set}", "--stages", "flow", "--quiet"),
    "render": ("render", "{set}", "--out", "{out}", "--size", "64x48", "--quiet"),
    "diff": ("diff", "{set}", "{sound}"),
    "merge": ("merge", "{set}", "{sound}", "--out", "{out}"),
    "verify one": ("verify", "{set}", "--episode", f"{CELL}/episode_0000000"),
    "push": ("push", "{set}", "s3://bucket/x"),
}


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    dataset = Dataset(tmp_path_factory.mktemp("links") / "set")
    dataset.create(RECIPE)
    (slot,) = RECIPE.slots()
    make_episode(dataset.episode(slot), level=1, alpha=slot.cell.alpha, frames=3)
    record_file(dataset, slot, KEYS)
    dataset.provenance.write_text("{}")
    return dataset.root


@pytest.fixture
def outside(tmp_path):
    folder = tmp_path / "outside"
    for name in ("episode_0000009.hdf5", "29/x.npz", "view/index.html", "x.log"):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(CANARY)
    return folder


def everything(folder):
    return {
        path: (path.lstat().st_mtime_ns, path.read_bytes() if path.is_file() else b"")
        for path in [folder, *folder.rglob("*")]
    }


@pytest.mark.parametrize("verb", VERBS)
def test_no_verb_follows_a_link(verb, sound, outside, tmp_path):
    for number, name in enumerate(LINKS):
        root = shutil.copytree(sound, tmp_path / f"set{number}")
        path = root / name
        if path.is_dir():
            shutil.rmtree(path)
        path.unlink(missing_ok=True)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.symlink_to(outside / "x.log" if path.suffix else outside)
        before = everything(outside)
        out = tmp_path / f"out{number}"
        words = [word.format(set=root, sound=sound, out=out) for word in VERBS[verb]]
        code, printed, err = inside(*words, *(("--out", root) if verb == "build" else ()))
        assert (code, err.count("\n")) == (2, 1), (name, printed, err)
        assert f"{path}: is a link, which does not belong there; remove it" in err
        assert CANARY not in printed + err
        assert everything(outside) == before and not out.exists(), name


def test_a_pipe_is_no_file_of_a_dataset(sound, tmp_path):
    root = shutil.copytree(sound, tmp_path / "set")
    os.mkfifo(root / f"episodes/{CELL}/episode_0000001.hdf5")
    code, _, err = inside("verify", root, "--quiet")
    assert code == 2 and "is no plain file, which does not belong there" in err


def test_a_dataset_that_is_reached_through_a_link_is_one(sound, tmp_path):
    (tmp_path / "root").symlink_to(sound)
    (tmp_path / "folder").symlink_to(sound.parent)
    for root in (tmp_path / "root", tmp_path / "folder" / sound.name):
        code, out, err = inside("status", root)
        assert code == 0 and "1 of 1 accepted" in out, err


def test_a_file_that_is_parsed_whole_has_a_largest_size(sound, tmp_path):
    root = shutil.copytree(sound, tmp_path / "set")
    with open(root / "provenance.json", "wb") as file:
        file.truncate(1 << 40)
    code, out, _ = inside("verify", root, "--quiet")
    assert code == 1 and "provenance.json: " in out and "has more than" in out
