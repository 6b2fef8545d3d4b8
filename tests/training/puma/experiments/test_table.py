"""The paper's experiments beside our rows."""

import pytest

from pipeline.data.recipe.model import Recipe
from pipeline.tasks import TASKS
from training.puma.errors import TrainError
from training.puma.experiments.table import EXPERIMENTS, beside, differences, experiment, printed


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
    assert Recipe(levels=tuple({row.level for row in found.rows}), alpha=found.alpha)
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
    with pytest.raises(TrainError, match="choose main, task-type"):
        experiment("none")


def test_an_evaluation_stands_beside_the_papers_rows(monkeypatch, tmp_path):
    means = [mean(1, "all", 30.0) | {"episodes": 200, "tasks": 10}]
    monkeypatch.setattr("training.puma.experiments.table.newest", lambda out: [])
    monkeypatch.setattr("training.puma.experiments.table.over_tasks", lambda rows: means)
    lines = list(printed("slow", tmp_path))
    assert lines[1].split() == [
        "->",
        "mine",
        "1",
        "all",
        *["30.0", "(25.0-35.0)"],
        "31.0",
        "(25.0-35.0)",
    ]
    assert any(line.split() == ["PUMA", "1", "all", "19.91", "36.75"] for line in lines[2:4])
    assert any("clock sim" in line for line in lines) and any("20 scenes" in line for line in lines)


@pytest.mark.parametrize(("level", "task"), [(3, "click_bell"), (1, "pick_ripe")])
def test_an_evaluation_of_nothing_that_the_paper_has_is_refused(monkeypatch, tmp_path, level, task):
    rows = [mean(level, "all", 30.0) | {"task": task}]
    monkeypatch.setattr("training.puma.experiments.table.newest", lambda out: rows)
    monkeypatch.setattr("training.puma.experiments.table.over_tasks", list)
    with pytest.raises(TrainError, match="no task of it is in the paper's table 'main'"):
        list(printed("main", tmp_path))


def test_the_options_of_an_evaluation_are_those_of_the_experiment():
    words = experiment("slow").words()
    given = dict(zip(words[::2], words[1::2], strict=True))
    assert (given["--alpha"], given["--levels"], given["--rules"]) == ("0.05", "1", "domino")
    assert len(given["--tasks"].split(",")) == 10
