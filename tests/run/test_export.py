"""What an export says of episodes that another version of the code made, and what it loads for
it."""

import subprocess
import sys

from pipeline.data.dataset import Dataset
from pipeline.data.keys import Key, SlotKeys
from pipeline.data.recipe.model import parse_recipe
from pipeline.run.export import stale_warning
from pipeline.run.identity.core import shared_physics
from tests.recording import finish

RECIPE = parse_recipe({"tasks": "click_bell", "levels": [1], "episodes": 3})

ROW = {"attempt": 0, "seed": 1, "outcome": "accepted", "seconds": 1.0, "sim_steps": 8}


def test_stale_episodes_are_counted(tmp_path):
    dataset = Dataset(tmp_path / "set")
    dataset.create(RECIPE)
    now = shared_physics()
    for slot, core in zip(RECIPE.slots(), (now["core"], "older", "oldest"), strict=True):
        keys = SlotKeys(Key({"slot": "1", **now, "core": core}), Key({}), Key({}))
        finish(dataset, slot, keys, [ROW])
    assert stale_warning(dataset, RECIPE).startswith("2 episodes were made by another version")
    for slot in RECIPE.slots():
        keys = SlotKeys(Key({"slot": "1", **now}), Key({}), Key({}))
        finish(dataset, slot, keys, [ROW])
    assert stale_warning(dataset, RECIPE) == ""


def test_the_comparison_loads_no_simulator():
    code = "import sys, pipeline.run.identity.core; print('pipeline.world' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"
