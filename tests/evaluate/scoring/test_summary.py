"""Intervals and tables against hand calculation and against scipy."""

import numpy as np
import pytest
from scipy.stats import binomtest

from pipeline.commands.evaluate import describe, describe_clocks
from pipeline.evaluate.scoring.statistics import bootstrap, wilson
from pipeline.evaluate.scoring.summary import over_tasks, summarise


@pytest.mark.parametrize(("k", "n"), [(0, 20), (1, 7), (10, 20), (19, 20), (100, 100)])
def test_wilson_is_scipys(k, n):
    wanted = binomtest(k, n).proportion_ci(method="wilson")
    assert wilson(k, n) == pytest.approx((wanted.low, wanted.high), abs=1e-9)


def test_bootstrap_of_many_is_the_normal_interval():
    values = np.random.default_rng(0).normal(50, 10, 400).tolist()
    low, high = bootstrap(values)
    half = 1.96 * np.std(values) / 20
    assert (low, high) == pytest.approx((np.mean(values) - half, np.mean(values) + half), abs=0.12)
    assert bootstrap(values[::-1]) == (low, high)
    assert bootstrap([3.0, 3.0]) == (3.0, 3.0)
    assert np.isnan(bootstrap([])).all()


def row(task, success, score, category="tracking", level=1, **other):
    cell = {
        "policy": "p",
        "clock": "sim",
        "rules": "strict",
        "task": task,
        "embodiment": "r",
        "level": level,
        "alpha": 0.1,
        "domain": "clean",
    }
    seen = {"same_start": True, "sees_truth": False, "seed": 0}
    values = {
        "success": success,
        "route_completion": score,
        "manipulation_score": score,
        "penalties": [],
    } | seen
    return (
        cell
        | {
            "category": category,
            "failure": "" if success else "missed",
            "failed": [] if success else ["touched"],
        }
        | values
        | other
    )


ROWS = [
    row("a", True, 100.0),
    row("a", False, 20.0),
    row("b", True, 100.0, "interception"),
    row("a", False, 0.0, level=3),
]


def test_cells_are_counted_apart():
    a, b, a3 = summarise(ROWS)
    assert (a["task"], a["episodes"], a["success_rate"], a["manipulation_score"]) == (
        "a",
        2,
        50.0,
        60.0,
    )
    assert a["failures"] == {"missed": 1}
    assert a["failed_conditions"] == {"touched": 1}
    assert (b["success_rate"], b["failures"]) == (100.0, {})
    assert (a3["level"], a3["success_rate"]) == (3, 0.0)
    assert " evaluator " in (line := describe([a, b, a3], []).splitlines()[1])
    assert line.endswith("missed 1")


def test_columns_of_the_table_are_as_wide_as_their_words():
    (cell,) = summarise(ROWS[:1])
    cell |= {"condition": "light+stop", "rules": "strict-light@share0.4+stop@share0.6"}
    head, line = describe([cell], []).splitlines()
    assert head.index("condition") == line.index("light+stop ")
    assert head.index("truth") == line.index(cell["rules"]) + len(cell["rules"]) + 2
    assert "condition" not in describe(summarise(ROWS[:1]), over_tasks(ROWS[:1]))


def test_rules_are_counted_apart():
    both = [row("a", True, 100.0), row("a", False, 0.0, rules="domino")]
    assert [(c["rules"], c["success_rate"]) for c in summarise(both)] == [
        ("strict", 100.0),
        ("domino", 0.0),
    ]
    assert {
        (m["rules"], m["success_rate"]) for m in over_tasks(both) if m["category"] == "all"
    } == {("strict", 100.0), ("domino", 0.0)}


def test_every_task_counts_the_same_in_a_mean():
    means = {(m["level"], m["category"]): m for m in over_tasks(ROWS)}
    assert means[1, "all"]["success_rate"] == 75.0
    assert means[1, "all"]["manipulation_score"] == 80.0
    assert means[1, "tracking"]["success_rate"] == 50.0
    assert means[1, "interception"]["tasks"] == 1
    for kind, solved, episodes in (("interception", 1, 1), ("tracking", 1, 2)):
        wanted = binomtest(solved, episodes).proportion_ci(method="wilson")
        assert means[1, kind]["success_rate_interval"] == pytest.approx(
            (100 * wanted.low, 100 * wanted.high)
        )
    # tasks of one and two episodes: the variance of the mean is that of 2^2 / (1 + 1/2) episodes
    low, high = means[1, "all"]["success_rate_interval"]
    assert (low, high) == pytest.approx([100 * x for x in wilson(2.0, 8 / 3)])
    assert means[3, "all"]["episodes"] == 1


def test_clocks_are_columns_and_what_a_pause_hides_is_a_mean_over_cells():
    solved = {"sim": (True, True), "latency:100": (True, False), "latency:300": (False, False)}
    rows = [
        row(task, success, 0, clock=clock)
        for clock, both in solved.items()
        for task, success in zip("ab", both, strict=True)
    ]
    head, a, b, mean, hides = describe_clocks(summarise(rows), over_tasks(rows)).splitlines()
    assert head.split()[-5:] == ["paused", "100", "ms", "300", "ms"]
    numbers = [[float(text) for text in line.split()[-3:]] for line in (a, b, mean)]
    assert numbers == [[100, 100, 0], [100, 0, 0], [100, 50, 0]]
    assert "50.0 at 100 ms, 100.0 at 300 ms" in hides
