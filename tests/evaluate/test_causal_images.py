"""The study of what a policy from images learns: the order of its units, and its contrasts of constructed rows."""

import pytest

from benchmarks.causal_images import Unit, contrasts, holm, units
from benchmarks.causal_tables import differences


def test_primary_arms_come_first_and_each_unit_once():
    order = list(units())
    assert order[:3] == [
        Unit("click_bell", kind, sight, 1)
        for kind, sight in (("reactive", "history"), ("planned", "history"), ("reactive", "none"))
    ]
    assert [unit.seed for unit in order[:18]] == [1] * 3 + [2] * 3 + [1] * 3 + [3] * 3 + [2] * 3 + [3] * 3
    assert len(set(order)) == len(order) == 36


def test_holms_correction_is_that_of_the_textbook():
    assert holm([0.01, 0.04, 0.03, 0.005], 4) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.01], 4) == pytest.approx([0.04])


def test_a_contrast_compares_the_scenes_of_the_seeds_that_both_arms_have():
    def row(arm: str, seed: int, solved: list[int]) -> dict:
        return {"task": "click_bell", "n": 100, "seed": seed, "arm": arm, "level": 1, "tried": 4, "solved": solved}

    one, other = contrasts("click_bell")["primary"][0]
    rows = [row(one, 1, [5, 6, 7]), row(one, 2, []), row(other, 1, [7])]
    [(line, p)] = differences(rows, [("click_bell", level, (one, 100), (other, 100)) for level in (1, 3)])
    # two scenes won and none lost: half of all sign patterns are as far from 0
    assert line[1:4] == [1, "75 %", "25 %"]
    assert str(line[4]).startswith("+50 ")
    assert p == pytest.approx(0.5)
