"""The paper's experiments beside our rows."""

from types import SimpleNamespace

import pytest

from pipeline.data.recipe.model import Recipe
from pipeline.evaluate.scoring.paper import EXPERIMENTS, PaperError, beside, differences, experiment
from pipeline.tasks import TASKS
from tests.run.command import inside


def mean(level, category, rate):
    scores = {"success_rate": rate, "manipulation_score": rate + 1}
    intervals = {f"{name}_interval": [rate - 5, rate + 5] for name in scores}
    return (
        {"policy": "mine", "level": level, "category": category, "rules": "domino", "clock": "sim"}
        | scores
        | intervals
    )


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_experiments_can_be_evaluated(name):
    found = experiment(name)
    tasks = [TASKS[task] for task in found.tasks if task != "all"]
    assert [task.category for task in tasks] in ([], ["interception"] * 5 + ["tracking"] * 5)
    assert Recipe(levels=found.levels, alpha=found.alpha)
    assert all(0 < row.success_rate <= row.manipulation_score < 100 for row in found.rows)


def test_ours_stands_before_the_papers_rows_of_its_group():
    rows = beside(
        experiment("cross-level"),
        [mean(2, "all", 50.0), mean(2, "tracking", 9.0), mean(3, "all", 40.0)],
    )
    assert [(row["method"], row["level"]) for row in rows[:2] + rows[4:6]] == [
        ("mine", 2),
        ("pi0.5", 2),
        ("mine", 3),
        ("pi0.5", 3),
    ]
    assert not any(row["category"] == "tracking" for row in rows)
    assert [
        line.split(",")[0] for line in differences(experiment("main"), 100, "domino", "step-locked")
    ][2:] == []
    assert len(differences(experiment("main"), 20, "strict", "sim")) == 5
    with pytest.raises(PaperError, match="choose main, task-type"):
        experiment("none")


def test_the_command_evaluates_what_the_experiment_says(monkeypatch, tmp_path):
    asked = []

    def evaluated(wanted, *_):
        asked.append(wanted)
        return SimpleNamespace(
            means=[mean(1, "all", 30.0)], baselines=[mean(1, "all", 2.0) | {"policy": "still"}]
        )

    monkeypatch.setattr("pipeline.evaluate.evaluate.evaluate", evaluated)
    code, text, err = inside(
        "paper-table", "slow", "--policy", "static", "--episodes", 20, "--out", tmp_path
    )
    assert code == 0, err
    (wanted,), lines = asked, text.splitlines()
    assert {(cell.alpha, cell.level) for cell in wanted.cells} == {(0.05, 1)} and len(
        {cell.task for cell in wanted.cells}
    ) == 10
    assert (wanted.setup.rules, wanted.setup.textures, wanted.setup.camera_names) == (
        "domino",
        "unseen",
        ("head_camera", "left_camera", "right_camera"),
    )
    assert lines[4].split()[1:5] == ["still", "1", "all", "2.0"]
    assert lines[3].split() == [
        "->",
        "mine",
        "1",
        "all",
        "30.0",
        "(25.0-35.0)",
        "31.0",
        "(25.0-35.0)",
    ]
    assert lines[6].split() == ["PUMA", "1", "all", "19.91", "36.75"]
    assert any("clock sim" in line for line in lines) and any("20 scenes" in line for line in lines)
