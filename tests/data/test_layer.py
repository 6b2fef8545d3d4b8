"""The data layer opens, iterates and checks a dataset where nothing of the simulator is
installed."""

import subprocess
import sys
from pathlib import Path

from pipeline.data.dataset import Dataset
from pipeline.data.keys import Key, SlotKeys
from pipeline.data.recipe.model import parse_recipe
from tests.recording import record_file
from tests.synthetic import make_episode

ROOT = Path(__file__).parents[2]
HEAVY = ("sapien", "numba", "coal", "torch", "ray", "scipy", "trimesh")
READ = f"""
import sys
HEAVY = {HEAVY!r}

class Refused:
    def find_spec(self, name, path=None, target=None):
        ours = name.startswith("pipeline.") and not name.startswith(("pipeline.data", "pipeline.poses"))
        if ours or name.split(".")[0] in HEAVY:
            raise ImportError(f"{{name}} must not be imported")

sys.meta_path.insert(0, Refused())
from pipeline.data.dataset import Dataset
from pipeline.data.episode.file import open_episode
from pipeline.data.keys import file_hash

dataset = Dataset(sys.argv[1])
recipe = dataset.recipe()
for slot, record in dataset.records(recipe):
    with open_episode(dataset.episode(slot)) as episode:
        assert file_hash(episode.path) == record.sha256
        print(episode.spec.task, len(episode), episode.rgb("head_camera", 0).shape, episode.meta.target, len(episode.read().log))
"""  # noqa: E501


def test_a_dataset_is_read_without_the_simulator(tmp_path):
    dataset = Dataset(tmp_path / "out")
    recipe = parse_recipe(
        {"tasks": "a_task_of_tomorrow", "embodiments": "robot-9", "levels": 1, "episodes": 2}
    )
    dataset.create(recipe)
    keys = SlotKeys(Key({}), Key({}), Key({}))
    for slot in recipe.slots():
        make_episode(
            dataset.episode(slot), task=slot.cell.task, embodiment=slot.cell.embodiment, frames=3
        )
        record_file(dataset, slot, keys)
    done = subprocess.run(
        [sys.executable, "-c", READ, str(dataset.root)],
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=False,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == ["a_task_of_tomorrow 3 (240, 320, 3) target 3"] * 2
