"""The study of what a policy from images learns: the order of its units, and its contrasts of constructed rows."""

import pytest

from benchmarks.causal_images import Unit, pairs, units
from benchmarks.causal_tables import contrasts


def test_primary_arms_come_first_and_each_unit_once():
    order = list(units())
    assert order[:3] == [
        Unit("click_bell", arm, inputs, 1)
        for arm, inputs in (("reactive", "history"), ("planned", "history"), ("reactive", "none"))
    ]
    assert [unit.seed for unit in order[:18]] == [1] * 3 + [2] * 3 + [1] * 3 + [3] * 3 + [2] * 3 + [3] * 3
    assert len(set(order)) == len(order) == 36


def test_contrasts_are_of_the_seeds_that_both_arms_have():
    def row(arm: str, seed: int, solved: list[int]) -> dict:
        given = {"task": "click_bell", "n": 100, "arm": arm, "inputs": "history", "seed": seed}
        return {**given, "level": 1, "tried": 4, "solved": solved}

    rows = [row("reactive", 1, [5, 6, 7]), row("reactive", 2, []), row("planned", 1, [7])]
    [(line, p)] = contrasts(rows, pairs("click_bell")[0])
    assert str(line[0]) == "click_bell, level 1, N = 100, history: reactive - planned"
    # two scenes won and none lost: half of all sign patterns are as far from 0
    assert line[1:4] == [1, "75 %", "25 %"]
    assert str(line[4]).startswith("+50 ")
    assert p == pytest.approx(0.5)


def test_the_second_task_has_no_primary_contrast():
    assert [len(some) for task in ("click_bell", "adjust_bottle") for some in pairs(task)] == [4, 8, 0, 12]
