"""Comparison of evaluations against scipy, brute force and simulation."""

import itertools
import json

import numpy as np
import pytest
from scipy.stats import binomtest, ttest_rel
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.evaluate.scoring.compare import CompareError, compare, read_arms
from pipeline.evaluate.scoring.results import EPISODES, Results, text_key
from pipeline.evaluate.scoring.statistics import interval, scenes_needed, sign_flip


def write(out, policy, solved, clock="sim", version="v", levels=(1,), task="a", **more):
    """A run in `out`: seed i of the task solved where solved[i] holds, at every level; rows hold
    `more`."""
    results = Results(out / EPISODES)
    for level, (seed, success) in itertools.product(levels, enumerate(solved)):
        spec = {
            "task": task,
            "embodiment": "r",
            "level": level,
            "alpha": 0.1,
            "domain": "clean",
            "seed": seed,
        }
        row = {
            "policy": policy,
            "probe": "",
            "clock": clock,
            "rules": "strict",
            "category": "tracking",
            "failure": "",
        } | spec
        row |= {
            "success": bool(success),
            "same_start": True,
            "sees_truth": False,
            "failed": [],
            "penalties": [],
        }
        row |= {"route_completion": 0.0, "manipulation_score": 0.0} | more
        key = text_key((version, policy, clock, json.dumps(spec), "digest", []))
        results.append(key, row)
    return str(out)


def test_the_exact_test_is_mcnemars_and_brute_force():
    for won, lost in ((0, 0), (1, 0), (9, 2), (15, 32), (40, 40)):
        wanted = binomtest(won, won + lost).pvalue if won + lost else 1.0
        assert sign_flip([1] * won + [-1] * lost + [0] * 5) == pytest.approx(wanted)
    sums = [3, -1, 2, 2, 0, -3, 1]
    flipped = [
        abs(np.dot(signs, sums)) >= abs(sum(sums))
        for signs in itertools.product((1, -1), repeat=len(sums))
    ]
    assert sign_flip(sums) == pytest.approx(np.mean(flipped))


def test_the_interval_is_that_of_paired_differences():
    change = np.random.default_rng(1).choice([-1.0, 0.0, 0.0, 1.0, 1.0], 400)
    wanted = ttest_rel(change, np.zeros(400)).confidence_interval()
    assert interval({"a": change}) == pytest.approx((wanted.low, wanted.high), abs=0.006)
    # tasks that differ from each other widen little: they are the same tasks in every evaluation
    low, high = interval({"a": np.ones(200), "b": np.zeros(200)})
    assert 0.47 < low < 0.5 < high < 0.53


@pytest.mark.parametrize("other", [[0.0], [0.0, 1.0]])
def test_the_interval_over_tasks_is_not_surer_than_one_scene_of_a_task(other):
    tasks = {"a": np.ones(1), "b": np.array(other)}
    low, high = interval(tasks)
    mean = np.mean([v.mean() for v in tasks.values()])
    own_low, own_high = interval({"a": tasks["a"]})  # -0.95 to 1
    assert -1 <= low <= mean - (1 - own_low) / 2 and mean + (own_high - 1) / 2 < high <= 1


def test_ten_scenes_without_a_difference_still_leave_room():
    low, high = interval({"a": np.zeros(10)})
    assert binomtest(0, 10).proportion_ci(0.95).high == pytest.approx(high) and low == -high
    low, high = interval({"a": np.ones(10)})
    assert (high, low) == (1.0, pytest.approx(1 - 2 * binomtest(0, 10).proportion_ci(0.95).high))


def test_the_scenes_needed_find_the_effect_four_times_of_five():
    win, lose = 0.20, 0.10
    count = scenes_needed(win + lose - (win - lose) ** 2, win - lose)
    rng = np.random.default_rng(0)
    draws = rng.choice([1, -1, 0], size=(4000, count), p=[win, lose, 1 - win - lose])
    found = np.abs(draws.mean(1)) > 1.96 * draws.std(1) / np.sqrt(count)
    assert found.mean() == pytest.approx(0.8, abs=0.03)
    assert scenes_needed(0.0, 0.05) is None


def test_policies_are_paired_by_scene(tmp_path):
    a = write(tmp_path / "a", "p", [1, 0, 0, 0, 1, 0])
    b = write(tmp_path / "b", "q", [1, 1, 1, 0, 0, 1])
    first, second = read_arms([a, b])
    (row,) = compare(first, second, 5)
    assert (row["first"], row["second"], row["scenes"], row["won"], row["lost"]) == (
        "p",
        "q",
        6,
        3,
        1,
    )
    assert row["effect"] == pytest.approx(100 * (4 - 2) / 6) and row["p"] == pytest.approx(
        binomtest(3, 4).pvalue
    )
    assert row["interval"][0] < row["effect"] < row["interval"][1]


def test_every_clock_has_a_line_of_its_own(tmp_path):
    for clock, one, other in (("paused", [1, 1], [1, 1]), ("latency:300", [0, 0], [1, 1])):
        a = write(tmp_path / "a", "p", one, clock)
        b = write(tmp_path / "b", "q", other, clock)
    lines = compare(*read_arms([a, b]), 5)
    assert {line["what"]: line["effect"] for line in lines} == {
        "all": 50.0,
        "latency:300": 100.0,
        "paused": 0.0,
    }


def test_levels_and_networks_of_one_scene_count_once(tmp_path):
    one, other = [1, 0, 1, 0, 0], [1, 1, 1, 1, 0]
    single = compare(
        *read_arms([write(tmp_path / "a", "p", one), write(tmp_path / "b", "q", other)]), 5
    )[0]
    a, b = (
        write(tmp_path / "c", "p", one, levels=(1, 3)),
        write(tmp_path / "d", "q", other, levels=(1, 3)),
    )
    every, *parts = compare(*read_arms([a, b]), 5)
    assert [part["what"] for part in parts] == ["level 1", "level 3"]
    assert (every["interval"], every["p"], every["needed"]) == (
        single["interval"],
        single["p"],
        single["needed"],
    )
    networks = ",".join((a, write(tmp_path / "e", "p2", one, levels=(1, 3))))
    pooled = compare(*read_arms([networks, b]), 5)[0]
    assert (pooled["interval"], pooled["p"], pooled["scenes"]) == (
        single["interval"],
        single["p"],
        5,
    )


def test_the_scenes_of_both_are_compared_and_counted(tmp_path):
    a, b = write(tmp_path / "a", "p", [1, 0, 1, 0] * 10), write(tmp_path / "b", "q", [1] * 4)
    (row,) = compare(*read_arms([a, b]), 5)
    assert (row["scenes"], row["shared"], row["won"], row["first_rate"], row["second_rate"]) == (
        4,
        4,
        2,
        50,
        100,
    )
    told = CliRunner().invoke(app, ["compare", a, b])
    assert told.output.splitlines()[-1] == "q against p: the 4 episodes of both, of 4 and 40"


def test_other_scenes_and_clocks_are_refused(tmp_path):
    a, task = write(tmp_path / "a", "p", [1, 0]), write(tmp_path / "d", "q", [1], task="other")
    late = write(tmp_path / "c", "q", [1, 0], clock="latency:100")
    with pytest.raises(CompareError, match="p and q share no episode"):
        compare(*read_arms([a, task]), 5)
    with pytest.raises(CompareError, match="differ in clock: sim and latency:100"):
        compare(*read_arms([a, late]), 5)


def test_a_run_with_several_policies_is_compared_within_itself(tmp_path):
    out = write(tmp_path, "old", [0, 0, 0], version="before")
    for policy in ("p", "q"):
        write(tmp_path, policy, [1, 0, 1])
    told = CliRunner().invoke(app, ["compare", out])
    assert told.exit_code == 0, told.output
    assert told.output.splitlines()[1].split()[:4] == ["q", "p", "all", "3"]
    found = json.loads(CliRunner().invoke(app, ["compare", out, "--json", "--effect", "2"]).output)
    assert found["effect"] == 2 and found["comparisons"][0]["p"] == 1.0
    with pytest.raises(CompareError, match=EPISODES):
        read_arms([str(tmp_path / "none")])


def test_results_that_are_a_link_are_refused_and_stay_as_they_are(tmp_path):
    one, two = write(tmp_path / "a", "x", [1, 0]), write(tmp_path / "b", "y", [1, 1])
    elsewhere = tmp_path / "elsewhere.jsonl"
    (tmp_path / "b" / EPISODES).rename(elsewhere)
    elsewhere.write_bytes(elsewhere.read_bytes() + b'{"cut')
    (tmp_path / "b" / EPISODES).symlink_to(elsewhere)
    before = elsewhere.read_bytes()
    result = CliRunner().invoke(app, ["compare", one, two])
    assert isinstance(result.exception, OSError) and "is a link" in str(result.exception)
    assert elsewhere.read_bytes() == before


CALM = {"success": True, "route_completion": 0.0, "manipulation_score": 0.0}


def test_a_paired_run_has_a_row_for_each_clock_and_each_run_a_name(tmp_path):
    out = write(tmp_path / "a", "p", [0, 0, 1], control=CALM, event="stop", phase="near")
    write(tmp_path / "a", "p", [1, 1, 1], clock="latency:100", control=CALM)
    told = json.loads(CliRunner().invoke(app, ["compare", out, "--json"]).output)["events"]
    assert [(r["first"], r["second"], r["scenes"], r["lost"]) for r in told] == [
        ("p, sim, no events", "p, sim", 3, 2),
        ("p, latency:100, no events", "p, latency:100", 3, 0),
    ]
    runs = [write(tmp_path / name, "p", [0, 1], control=CALM, rules=name[0]) for name in ("b", "c")]
    runs.append(write(tmp_path / "bb", "p", [0, 0], control=CALM, rules="b"))
    told = json.loads(CliRunner().invoke(app, ["compare", *runs, "--json"]).output)["events"]
    assert [r["second"] for r in told] == [
        f"p, {rules}, {run}" for rules, run in zip("bcb", runs, strict=True)
    ]


def test_a_paired_run_is_also_compared_scene_after_scene(tmp_path):
    out = write(tmp_path, "p", [0] * 30, control=CALM, event="none", phase="none")
    told = CliRunner().invoke(app, ["compare", out, "--sequential"])
    assert told.exit_code == 0, told.output
    assert told.output.startswith("p against p, no events: p, no events is better")
