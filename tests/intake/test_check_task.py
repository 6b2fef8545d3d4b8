"""The contract checker on a broken task and on the one that docs/add_a_task.md adds; tests/tasks
has it check every task."""

import re
from pathlib import Path

import numpy as np
import pytest

from pipeline.intake.check_task import check_task
from pipeline.tasks import TASKS, Task

PAGE = Path(__file__).parents[2] / "docs" / "add_a_task.md"


@pytest.fixture
def documented_task():
    code = re.search(r"^```python\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    assert code is not None
    assert len(code.group(1).splitlines()) < 120
    before = set(TASKS)
    exec(compile(code.group(1), str(PAGE), "exec"), {"__name__": __name__})
    (name,) = set(TASKS) - before
    yield name
    TASKS.remove(name)


def test_the_documented_task_keeps_the_contract(documented_task):
    findings = {f.name: f for f in check_task(documented_task, levels=(0, 3))}
    bad = [f for f in findings.values() if not f.ok]
    assert not bad, bad
    assert {"level 0", "level 3", "determinism", "arms", "language", "level 3 conditions"} <= set(
        findings
    )


def test_the_page_says_how_many_templates_the_contract_asks_for():
    assert f"at least {Task.least_seen} seen and {Task.least_unseen} unseen" in " ".join(
        PAGE.read_text().split()
    )


def test_a_task_that_succeeds_by_itself_is_found_out(documented_task, monkeypatch):
    monkeypatch.setattr(
        type(TASKS[documented_task]), "success", lambda self, o, arms: {"held": True}
    )
    findings = {f.name: f for f in check_task(documented_task, levels=(1,))}
    assert not findings["level 1 start"].ok
    assert findings["level 1 conditions"].ok


@pytest.mark.parametrize(
    ("conditions", "said"),
    [
        (
            lambda o: {"held": True} if len(o.log) > 5 else {"lifted": True},
            "the names change: ['lifted'] and ['held']",
        ),
        (lambda o: {"Held up": True}, "Held up"),
        (lambda o: {"held": np.bool_(True)}, "held"),
        (lambda o: {}, ""),
    ],
)
def test_conditions_without_stable_names_are_found_out(
    documented_task, monkeypatch, conditions, said
):
    monkeypatch.setattr(
        type(TASKS[documented_task]), "success", lambda self, o, arms: conditions(o)
    )
    findings = {f.name: f for f in check_task(documented_task, levels=(0,))}
    assert not findings["level 0 conditions"].ok
    assert said in findings["level 0 conditions"].detail


def test_a_task_that_fails_says_what_exactly_and_what_to_change(documented_task, monkeypatch):
    monkeypatch.setattr("pipeline.intake.check_task.SEEDS_PER_LEVEL", 2)
    monkeypatch.setattr(
        type(TASKS[documented_task]),
        "success",
        lambda self, o, arms: {"held": True, "painted": False},
    )
    finding = next(f for f in check_task(documented_task, levels=(0,)) if f.name == "level 0")
    assert not finding.ok
    assert finding.detail.startswith(
        "none of 2 seeds was accepted; 2 x dry_run: no_success (not fulfilled: painted 2)"
    )


def test_a_task_that_never_meets_its_target_is_found_out(documented_task, monkeypatch):
    monkeypatch.setattr(type(TASKS[documented_task]), "meet", lambda self, a: iter(()))
    findings = {f.name: f for f in check_task(documented_task, levels=(1,))}
    assert not findings["level 1"].ok


def test_errors_of_a_tasks_own_code_and_words_are_findings(documented_task, monkeypatch):
    monkeypatch.setattr("pipeline.intake.check_task.LAYOUTS", 2)
    task = type(TASKS[documented_task])
    monkeypatch.setattr(task, "meet", lambda self, a: iter([a.nothing]))
    monkeypatch.setattr(task, "seen", (*task.seen, "Lift {hand}."))
    findings = {f.name: f for f in check_task(documented_task, levels=(0,))}
    assert re.search(
        r"test_check_task.py:\d+: .*AttributeError: 'Actor' object has no",
        findings["level 0"].detail,
    )
    assert "the unknown slot {hand}" in findings["language"].detail


def test_one_complaint_is_made_once_and_words_can_wait(documented_task, monkeypatch):
    def broken(self, *_):
        raise KeyError("no such body")

    monkeypatch.setattr(type(TASKS[documented_task]), "meet", broken)
    monkeypatch.setattr(type(TASKS[documented_task]), "seen", ("Take it.",))
    bad = [f for f in check_task(documented_task, levels=(0, 1, 3)) if not f.ok]
    assert len({f.detail for f in bad}) == len(bad)
    names = ", ".join(f.name for f in bad)
    assert "language" in names and names.count("level 3") == 1
    later = [f.name for f in check_task(documented_task, levels=(0,), words=False) if not f.ok]
    assert later and "language" not in later
