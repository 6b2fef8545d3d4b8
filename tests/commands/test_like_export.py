"""`evaluate --like EXPORT`: the recipe of the dataset that holds the export, and the export's
actions for the policy."""

import json

import pytest

from pipeline.commands.common import UsageError
from pipeline.commands.evaluate import named_policy
from pipeline.commands.options import Given
from pipeline.data.dataset import Dataset
from pipeline.data.names import EXPORT_RECORD
from pipeline.data.recipe.model import Recipe, RecipeError
from pipeline.data.setup import Setup
from pipeline.evaluate.asking import introduce
from pipeline.evaluate.episode import start_of
from pipeline.evaluate.policies.policy import PolicyError
from pipeline.world.robots import get_embodiment

POLICY = """
import numpy as np
from pipeline.evaluate.policies.contract import Contract
class P:
    contract = Contract(representation="ee-relative", rotation="6d", frame="base")
    def reset(self, start):
        assert len(start.action_names) == 20 and start.action_names[3] == "left_r00"
        assert len(start.state_names) == 14
    def act(self, observation): return np.ones(20)
def make_policy(): return P()
"""


def test_an_export_gives_the_recipe_of_its_dataset_and_its_actions(tmp_path):
    dataset, policy = Dataset(tmp_path / "out"), tmp_path / "act"
    dataset.create(Recipe(tasks=("click_bell",), fps=10))
    export = dataset.exports("lerobot")
    export.mkdir(parents=True)
    (export / EXPORT_RECORD).write_text(json.dumps({"options": {"actions": "ee", "crf": 18}}))
    policy.mkdir()
    (policy / "config.json").write_text("{}")
    given = Given(like=export)
    assert given.recipe().fps == 10
    name = named_policy(f"lerobot:{policy}?rotation=6d", False, like=given.export)
    assert name.text == f"lerobot:{policy.resolve()}?actions=ee&rotation=6d"
    file = tmp_path / "p.py"
    file.write_text(POLICY)
    start = start_of(get_embodiment("aloha-agilex"), Setup(), "press")
    absolute = named_policy(f"{file}", True, like=given.export)
    with pytest.raises(PolicyError, match="ee-relative, 6d, base, the evaluation ee, quatern"):
        introduce(absolute, [start])
    (export / EXPORT_RECORD).write_text(
        json.dumps({"options": {"actions": "ee-relative", "rotation": "6d"}})
    )
    introduce(named_policy(f"{file}", True, like=given.export), [start])
    assert Given(like=dataset.root).export is None
    (tmp_path / EXPORT_RECORD).write_text("{}")
    with pytest.raises(UsageError, match="outside of its dataset"):
        Given(like=tmp_path).recipe()


def test_without_events_no_scene_of_a_file_is_paired_by_them(tmp_path):
    file = tmp_path / "pairs.yaml"
    file.write_text("tasks: click_bell\nepisodes: 4\nevents: stop\npaired: [levels, events]\n")
    assert Given(manifest=file).recipe().paired == ("levels", "events")
    recipe = Given({"events": ["none"]}, file).recipe()
    assert (recipe.events, recipe.paired) == ((), ("levels",))
    with pytest.raises(RecipeError, match="paired: events needs events"):
        Given({"events": ["none"], "paired": ["events"]}, file).recipe()
