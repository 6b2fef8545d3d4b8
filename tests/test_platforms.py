"""What works where the simulator has no wheel, and none of the extras is installed."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from pipeline.data.dataset import Dataset
from pipeline.data.keys import Key, SlotKeys
from pipeline.data.recipe.model import parse_recipe
from tests.recording import record_file
from tests.synthetic import make_episode

ROOT = Path(__file__).parents[1]
EXTRAS = ("ray", "torch", "transformers", "lerobot", "pandas", "huggingface_hub", "fsspec", "s3fs")
WITHOUT = """
import sys

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in MISSING:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Missing())
"""
VERB = "from domino_data_command import main; main()"


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """One episode of a task of the package: more are encoded in other processes, which find every
    module."""
    made = Dataset(tmp_path_factory.mktemp("data") / "out")
    keys = {"tasks": "click_bell", "embodiments": "aloha-agilex", "levels": 1, "episodes": 1}
    recipe = parse_recipe(keys)
    made.create(recipe)
    for slot in recipe.slots():
        make_episode(
            made.episode(slot), task=slot.cell.task, embodiment=slot.cell.embodiment, frames=3
        )
        record_file(made, slot, SlotKeys(Key({}), Key({}), Key({})))
    return made


def run(code: str, *words: object, missing: tuple[str, ...]) -> subprocess.CompletedProcess[str]:
    """A process in which these modules cannot be imported."""
    program = f"MISSING = {missing!r}\n{WITHOUT}\n{code}"
    return subprocess.run(
        [sys.executable, "-c", program, *map(str, words)],
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=False,
        timeout=300,
    )


def test_reading_exporting_and_viewing_need_no_simulator(dataset: Dataset, tmp_path: Path):
    code = """
import json
import domino_data as dd
from domino_data_command import main

source, out = sys.argv[1:]
dataset = dd.open_dataset(source)
frames = []
for path in dataset.accepted(dataset.recipe()):
    with dd.open_episode(path) as episode:
        frames.append(len(episode))
verbs = [f"export {source} --format {name} --quiet --out {out}/{name}" for name in FORMATS]
for verb in (*verbs, f"view {source} --quiet --out {out}/view"):
    sys.argv = ["domino-data", *verb.split()]
    try:
        main()
    except SystemExit as end:
        assert end.code == 0, verb
print(json.dumps(frames))
"""
    formats = ("lerobot", "lerobot-v2.1", "parquet", "aloha", "zarr")
    code = f"FORMATS = {formats!r}\n{code}"
    done = run(code, dataset.root, tmp_path, missing=("sapien", *EXTRAS))
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout.splitlines()[-1]) == [3]
    for name in formats:
        assert (tmp_path / name / "export.json").is_file(), name
    assert (tmp_path / "view" / "index.html").is_file()


def test_training_needs_no_simulator():
    code = "import training.puma.train, training.puma.corpus.mixture, training.puma.model, torch"
    done = run(code, missing=("sapien",))
    assert done.returncode == 0, done.stderr


def test_building_without_the_simulator_is_one_line(tmp_path: Path):
    words = ("build", "--tasks", "click_bell", "--episodes", "1", "--out", tmp_path / "out")
    done = run(VERB, *words, missing=("sapien",))
    assert done.returncode == 2
    assert "simulator (sapien)" in done.stderr.splitlines()[-1]
    assert not list(tmp_path.rglob("*.hdf5"))
