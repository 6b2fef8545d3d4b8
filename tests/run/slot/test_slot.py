"""One slot: what the rows of its attempts say."""

import pyarrow.parquet as pq
import pytest

from pipeline.data.dataset import Dataset
from pipeline.run.names import recipe_from
from pipeline.run.slot.fill import FillJob, fill_slot
from pipeline.tasks import TASKS
from tests.recording import record_all

BUDGET = 2


@pytest.fixture
def unsolvable(monkeypatch):
    """click_bell with two conditions more that never hold."""
    task = type(TASKS["click_bell"])
    success = task.success
    never = {"rung_twice": False, "heard": False}
    monkeypatch.setattr(task, "success", lambda self, o, arms: success(self, o, arms) | never)
    return "click_bell"


def test_a_failed_attempt_names_its_conditions_in_the_attempts_table(tmp_path, unsolvable):
    recipe = recipe_from(
        {
            "tasks": [unsolvable],
            "embodiments": ["aloha-agilex"],
            "levels": [0],
            "episodes": 1,
            "attempts": BUDGET,
        }
    )
    dataset = Dataset(tmp_path / "out")
    dataset.create(recipe)
    slot = next(recipe.slots())
    record = fill_slot(FillJob(str(dataset.root), recipe, slot))
    record_all(dataset, [(slot, record)])
    assert not record.accepted and len(record.attempts) == BUDGET
    dataset.write_attempts(recipe)
    rows = pq.read_table(dataset.attempts).to_pylist()
    assert [row["attempt"] for row in rows] == list(range(BUDGET))
    unsolved = [row for row in rows if row["reason"] == "no_success"]
    assert unsolved, rows
    for row in unsolved:
        assert (row["outcome"], row["stage"]) == ("failed", "dry_run")
        assert row["conditions"] == ["rung_twice", "heard"]
        assert "rung_twice, heard" in row["detail"]
    for row in rows:
        assert row["detail"]
        assert (row["conditions"] != []) == (row["reason"] == "no_success")
