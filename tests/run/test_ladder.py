"""The sanity ladder as a whole: demonstrations, tables, and a small one end to end."""

import json

import numpy as np
import pytest

from pipeline.data.dataset import Dataset
from pipeline.data.recipe import Recipe
from pipeline.evaluate.evaluate import inline
from pipeline.evaluate.ladder.demonstrations import ARRAYS, SlotJob, fill, stored
from pipeline.evaluate.ladder.network import Settings
from pipeline.run.ladder import Ladder, LadderError, climb, summary, table


def test_a_datasets_episodes_are_those_made_without_images(built):
    recipe = Dataset(built).recipe()
    slot = next(iter(recipe.physical_slots()))
    found = list(stored(built, recipe.cells()))
    assert len(found) == len(Dataset(built).accepted(recipe))
    made = fill(SlotJob(recipe, slot))
    assert (made.cell, made.bodies, made.target) == (found[0].cell, found[0].bodies, found[0].target)
    for name in ARRAYS:
        np.testing.assert_allclose(getattr(found[0], name), getattr(made, name), atol=1e-5)
    assert list(stored(built, [])) == []


def test_a_task_without_demonstrations_is_named(built, tmp_path):
    wanted = Ladder(Recipe(tasks=("stamp_seal",), levels=(1,), episodes=1), ("position",), ((8, 4),), 1, 1, data=built)
    with pytest.raises(LadderError, match="stamp_seal"):
        climb(wanted, tmp_path, inline)


def test_seeds_are_summed_up_with_an_interval():
    row = {"task": "t", "embodiment": "e", "alpha": 0.1, "level": 1, "inputs": "position", "chunk": 8, "execute": 4}
    row |= {"demonstrations": 9, "episodes": 10}
    (found,) = summary([row | {"solved": 3}, row | {"solved": 5}])
    assert (found["success_rate"], found["episodes"], found["by_seed"]) == (40, 20, [30, 50])
    assert found["success_interval"][0] == pytest.approx(21.9, abs=0.1)  # Wilson by hand
    assert table([found]).splitlines()[-1] == "| t | position | 8 | 4 | 40 (22-61) |"


def test_a_small_ladder_end_to_end(tmp_path):
    recipe = Recipe(tasks=("click_bell",), levels=(1,), episodes=2)
    wanted = Ladder(recipe, ("position", "two_frames"), ((8, 4),), 1, 1, Settings(epochs=1, width=32), code="c")
    rows = climb(wanted, tmp_path, inline)
    assert [(r["level"], r["inputs"], r["episodes"], r["demonstrations"]) for r in rows] == [
        (1, kind, 1, 2) for kind in ("position", "two_frames")
    ]
    lines = (tmp_path / "episodes.jsonl").read_text().splitlines()
    assert all(json.loads(line)["sees_truth"] for line in lines)
    times = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.npz")}
    assert len(times) == 4
    assert climb(wanted, tmp_path, inline) == rows
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.npz")} == times
    assert (tmp_path / "episodes.jsonl").read_text().splitlines() == lines
