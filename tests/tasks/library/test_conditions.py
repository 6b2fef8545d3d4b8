"""Every success condition of every task turns over where the specification says, and only that one.
No physics runs here."""

from copy import deepcopy
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from pipeline.poses import pose, quat_about
from pipeline.tasks import TASKS
from pipeline.tasks.contract import expand_tasks
from tests.tasks.library.interception import INTERCEPTION
from tests.tasks.library.take import SEED, Take, wrong
from tests.tasks.library.tracking import TRACKING

SPECS = TRACKING | INTERCEPTION
every = pytest.mark.parametrize(
    ("task", "rules"), [(task, rules) for task in sorted(SPECS) for rules in ("strict", "domino")]
)


@cache
def good(task, rules, seed=SEED):
    take = Take(task, rules, seed)
    SPECS[task].good(take)
    return take


@cache
def mirrored(task):
    """A seed with other arms than the usual one has, which stays where the arms are always the
    same."""
    arms = Take(task, "strict").arms
    return next((seed for seed in range(12) if Take(task, "strict", seed).arms != arms), SEED)


def changed(task, rules, row, value, seed):
    take = good(task, rules, seed)
    scene, take.scene = take.scene, None
    bodies, take.bodies = take.bodies, None
    copy = deepcopy(take)
    take.scene = copy.scene = scene
    take.bodies = copy.bodies = bodies
    row.change(copy, value)
    return copy


def test_every_task_has_its_rows():
    assert set(SPECS) == set(expand_tasks(()))


@every
def test_everything_holds_in_the_take_that_is_varied(task, rules):
    assert wrong(good(task, rules)) == set()


@every
def test_every_condition_has_a_row_and_every_row_a_condition(task, rules):
    assert set(good(task, rules).conditions()) == {
        r.condition for r in SPECS[task].rows if getattr(r, rules) is not None
    }


def mismatches(task, rules, seed=SEED):
    """What the rows say and the conditions do not, or the other way round."""
    asked = set(good(task, rules).conditions())
    for row in SPECS[task].rows:
        for value, holds in getattr(row, rules) or row.strict:
            failed = wrong(changed(task, rules, row, value, seed))
            if row.condition in asked and (row.condition not in failed) is not holds:
                yield f"{task}, {rules}: {row.condition} at {value:g} is {not holds}"
            if others := failed - {row.condition, *row.also}:
                yield (
                    f"{task}, {rules}: {', '.join(others)} fails with {row.condition} at {value:g}"
                )


@every
def test_a_condition_turns_over_at_its_threshold_and_no_other_with_it(task, rules):
    for seed in {SEED, mirrored(task)}:
        assert list(mismatches(task, rules, seed)) == []


@pytest.mark.parametrize("task", sorted(SPECS))
def test_the_rows_notice_a_limit_that_is_a_tenth_off(task, monkeypatch):
    kind = type(TASKS[task])
    true = kind.limits
    for name, limit in true.items():
        for rules in ("strict", "domino"):
            if getattr(limit, rules) is None:
                continue
            for sign in (1, -1):
                wrong_by = sign * (1 if limit.unit == "" else 0.1 * getattr(limit, rules))
                off = replace(limit, **{rules: getattr(limit, rules) + wrong_by})
                monkeypatch.setattr(kind, "limits", {**true, name: off})
                assert next(mismatches(task, rules), None), (
                    f"{task}, {rules}: nothing pins {name} to {getattr(limit, rules)}"
                )


@pytest.mark.parametrize("rules", ["strict", "domino"])
@pytest.mark.parametrize("beside", [(0.0, 0.30), (0.0, -0.30), (0.20, 0.22)])
def test_a_bottle_that_lies_on_the_floor_beside_the_bin_is_not_in_it(rules, beside):
    """The original's box around the bin is wider than ours is."""
    take = Take("put_bottles_dustbin", rules)
    SPECS["put_bottles_dustbin"].good(take)
    x, y, _ = take.pose("dustbin")[:3]
    take.put(
        "bottle", pose((x + beside[0], y + beside[1], 0.035), quat_about((0, 1, 0), np.pi / 2))
    )
    take.peak("bottle")
    assert wrong(take) == {"within_outline"}


def test_only_known_conditions_are_our_own():
    for name, task in ((name, TASKS[name]) for name in SPECS):
        returned = {row.condition for row in SPECS[name].rows} | {"at_rest", "released"}
        assert set(task.own_conditions) <= returned, name
