"""Yield tables from rows made by hand, the test of the law, and a run that is resumed."""

import json
import sys
from itertools import product

import numpy as np
import pytest

from benchmarks import success
from pipeline.evaluate.scoring.statistics import wilson

MOTION = {"average_speed": 0.05, "maximum_speed": 0.1, "end_speed": 0.05, "displacement": 0.2}


def slot(number: int, tries: int = 1, filled: bool = True, **changes):
    """The row of a slot whose last of some attempts was accepted, or none."""
    made = [
        {
            "attempt": n,
            "seconds": 1.0,
            "outcome": "failed",
            "stage": "dry_run",
            "reason": "no_success",
        }
        for n in range(tries)
    ]
    if filled:
        made[-1] = {"attempt": tries - 1, "seconds": 1.0, "outcome": "accepted"} | MOTION
    row = {
        "task": "click_bell",
        "embodiment": "piper",
        "level": 1,
        "alpha": 0.1,
        "domain": "clean",
        "slot": number,
    }
    row |= {
        "expert": "planned",
        "seed": 0,
        "attempts": 30,
        "contact": None,
        "start": None,
        "tries": made,
    }
    return (
        row
        | {"travel": {"total": 1.0 + number, "excess": 0.1}, "forces": {"finger": 20.0}}
        | changes
    )


def test_intervals_count_slots_where_attempts_of_a_slot_fail_together():
    together = [slot(0, 9), *(slot(n) for n in range(1, 12))]
    apart = [*(slot(n, 2) for n in range(8)), *(slot(n) for n in range(8, 12))]
    assert success.percent(together, 1) == success.percent(apart, 1) == "60.0"
    widths = [
        high - low
        for low, high in (
            [float(x) for x in success.interval(rows).split("-")] for rows in (together, apart)
        )
    ]
    low, high = wilson(12, 20)
    by_attempt = 100 * (high - low)
    assert widths[0] > 1.2 * by_attempt and widths[1] == pytest.approx(by_attempt, abs=0.2)


def test_tables_count_every_attempt_once():
    rows = [slot(0, 3, embodiment="ur5-wsg"), slot(1), slot(2, 2, filled=False, task="grab_roller")]
    text = success.rates(rows, "embodiment")
    assert "| click_bell | 100 | 33 | 50 |" in text and "| grab_roller | 0 |  | 0 |" in text
    assert (
        "| slots filled | 1 of 2 | 1 of 1 | 2 of 3 |" in text
        and "| original, static expert | 27 | 61 |  |" in text
    )
    assert "| dry_run: no_success | 4 | 2 | click_bell 2, grab_roller 2 |" in success.reasons(rows)
    assert (
        "| piper | 1 | 2.00, 2.00, 2.00 | 0.10, 0.10, 0.10 |" + 4 * " 0, 0, 0 |" + " 20, 20, 20 |"
        in success.hands(rows)
    )
    assert "2 motions accepted at 0.1 m/s" in success.speeds(rows)


@pytest.mark.parametrize(("alpha", "kept"), list(product((0.05, 0.2, 0.3), ("all", "slow"))))
def test_the_law_is_told_from_a_selection_of_its_slower_half(alpha, kept):
    drawn = np.clip(
        np.abs(np.random.default_rng(1).normal(0.8 * alpha, alpha / 3, 150)), 0.01, alpha
    )
    speeds = drawn if kept == "all" else np.sort(drawn)[:75]
    assert (success.kolmogorov_smirnov(speeds / alpha, 0.01 / alpha)[1] > 0.05) == (kept == "all")


def test_a_run_is_resumed_where_it_was_stopped(tmp_path, monkeypatch, capsys):
    filled = []

    def fill(jobs, workers, keep):
        for recipe, place in jobs[:3]:
            filled.append((recipe.expert, place.index))
            keep(slot(place.index, expert=recipe.expert, seed=recipe.seed))

    monkeypatch.setattr(success, "run", fill)
    options = [
        "--tasks",
        "click_bell",
        "--robots",
        "piper",
        "--experts",
        "planned,reactive",
        "--slots",
        "2",
    ]
    monkeypatch.setattr(sys, "argv", ["success", *options, "--rows", str(tmp_path / "rows.jsonl")])
    for _ in range(2):
        success.main()
    assert sorted(filled) == [("planned", 0), ("planned", 1), ("reactive", 0), ("reactive", 1)]
    rows = [json.loads(line) for line in (tmp_path / "rows.jsonl").read_text().splitlines()]
    assert len(rows) == 4 and "## reactive expert\n\n100.0 %" in capsys.readouterr().out
