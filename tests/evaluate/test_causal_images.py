"""The study of what a policy from images learns: the order of its units, and its contrasts of
constructed rows."""

from dataclasses import asdict

import numpy as np
import pytest

from benchmarks import causal_repeat
from benchmarks.causal_images import ImageUnit, pairs, units
from benchmarks.causal_tables import add_missing, contrasts, read, redraw_all, spread


def test_primary_arms_come_first_and_each_unit_once():
    order = list(units())
    assert order[:3] == [
        ImageUnit("click_bell", arm, inputs, 1)
        for arm, inputs in (("reactive", "history"), ("planned", "history"), ("reactive", "none"))
    ]
    assert [unit.seed for unit in order[:18]] == [1] * 3 + [2] * 3 + [1] * 3 + [3] * 3 + [2] * 3 + [
        3
    ] * 3
    assert len(set(order)) == len(order) == 36


def test_the_repetition_makes_each_unit_once_and_two_networks_of_everything_first():
    order = list(causal_repeat.units())
    assert len(set(order)) == len(order) == 6 * 2 * 5 + 3 * 5
    assert {unit.seed for unit in order[:30]} == {0, 1}


def test_rows_are_added_for_units_that_have_none(tmp_path):
    rows, made = tmp_path / "rows.jsonl", []

    def make(unit: ImageUnit) -> list[dict]:
        made.append(unit)
        return [{**asdict(unit), "level": level, "solved": []} for level in (1, 3)]

    wanted = [ImageUnit("click_bell", arm, "history", 1) for arm in ("planned", "reactive")]
    add_missing(rows, wanted[:1], make)
    add_missing(rows, wanted, make)
    assert made == wanted
    assert [row["arm"] for row in read(rows)] == ["planned"] * 2 + ["reactive"] * 2


def test_contrasts_are_of_the_seeds_that_both_arms_have():
    def row(arm: str, seed: int, solved: list[int]) -> dict:
        given = {"task": "click_bell", "n": 100, "arm": arm, "inputs": "history", "seed": seed}
        return {**given, "level": 1, "tried": 4, "solved": solved}

    rows = [row("reactive", 1, [5, 6, 7]), row("reactive", 2, []), row("planned", 1, [7])]
    [(line, p)] = contrasts(rows, pairs("click_bell")[0])
    assert str(line[0]) == "click_bell, level 1, N = 100, history: reactive - planned"
    # two scenes won and none lost: half of all sign patterns are as far from 0
    assert line[1:4] == [1, "75.0", "25.0"]
    assert str(line[4]).startswith("+50.0 ")
    assert line[5] == "too few networks"
    assert p == pytest.approx(0.5)


def test_networks_drawn_again_widen_the_interval_by_their_own_spread():
    """Four networks that solve all scenes or none, beside four that solve half of all: scenes alone
    cannot vary, networks can. The mean of four fair coins is 0 or 1 in one of sixteen draws each,
    so the quantiles 0.025 and 0.975 are those."""
    solved = np.stack([np.repeat([[1.0], [1.0], [0.0], [0.0]], 6, axis=1), np.full((4, 6), 0.5)])
    assert redraw_all(solved) == pytest.approx([-50, 50])
    assert redraw_all(solved[::-1] * 0 + 0.5) == pytest.approx([0, 0])


def test_spread_pairs_networks_that_differ_in_their_seed_alone():
    def row(arm: str, seed: int, count: int) -> dict:
        return {
            "task": "click_bell",
            "level": 1,
            "arm": arm,
            "n": 150,
            "inputs": "velocity",
            "seed": seed,
            "tried": 10,
            "solved": list(range(count)),
        }

    # 3 pairs within an arm of three networks, 1 in the other: 10, 20, 30 and 80 points apart
    rows = [
        row("planned", 0, 1),
        row("planned", 1, 2),
        row("planned", 2, 4),
        row("reactive", 0, 1),
        row("reactive", 1, 9),
    ]
    assert spread(rows) == [4, "25.0", "80.0"]


def test_the_second_task_has_no_primary_contrast():
    assert [len(some) for task in ("click_bell", "adjust_bottle") for some in pairs(task)] == [
        4,
        8,
        0,
        12,
    ]
