"""The sequential comparison against closed forms, scipy and simulation."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom, false_discovery_control
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.evaluate.scoring.statistics import BETS, holm, sequential, wealth
from tests.evaluate.scoring.test_compare import write

LIMIT = -np.log(0.05)


def pairs(rng, runs, scenes, first, second):
    """Differences (runs, scenes) of two policies whose successes share a third of the scenes'
    luck."""
    luck = rng.random((runs, scenes))
    other = np.where(rng.random((runs, scenes)) < 1 / 3, luck, rng.random((runs, scenes)))
    return (other < second).astype(float) - (luck < first)


def credited(rng, runs, scenes, first, second):
    """Differences of success, and of a score that credits what went part of the way."""
    solved = [rng.random((runs, scenes)) < rate for rate in (first, second)]
    scores = [
        np.where(done, 1, rng.beta(1 + 3 * rate, 2, done.shape))
        for done, rate in zip(solved, (first, second), strict=True)
    ]
    return solved[1].astype(float) - solved[0], scores[1] - scores[0]


def ends(differences):
    """After how many scenes each run is decided; a large number where it is not."""
    at = []
    for row in differences:
        test = sequential(row)
        at.append(test.decided or 10**6)
    return np.array(at)


def test_wealth_is_the_mean_of_products():
    x = [0.5, -1, 0.25]
    for side, sign in enumerate((1, -1)):
        products = [np.prod([1 + sign * bet * d for d in x]) for bet in BETS]
        assert np.exp(wealth(x)[-1, side]) == pytest.approx(np.sum(products) / (2 * len(BETS)))


@given(st.lists(st.floats(-1, 1), max_size=30))
def test_the_other_way_round_is_the_mirror_image(differences):
    one, other = sequential(differences), sequential([-d for d in differences])
    assert (one.decided, one.better) == (other.decided, -other.better)
    assert one.p == pytest.approx(other.p)


@given(st.lists(st.sampled_from([-1.0, 0.0, 1.0]), min_size=1, max_size=12), st.data())
def test_expected_wealth_never_grows_without_a_difference(past, data):
    """Ville's condition, whatever the past: the mean over a fair next scene is the wealth now."""
    size = data.draw(st.floats(0, 1))
    now = np.exp(wealth(past)[-1]).sum()
    after = np.mean([np.exp(wealth([*past, d])[-1]).sum() for d in (size, -size)])
    assert after == pytest.approx(now)


def test_false_alarms_are_rarer_than_alpha_however_often_one_looks():
    rng = np.random.default_rng(1)
    for make in (pairs, lambda *sizes: credited(*sizes)[1]):
        alarms = (ends(make(rng, 1000, 200, 0.5, 0.5)) <= 200).mean()
        assert 0 < alarms <= 0.05


def test_two_fifths_of_fifty_scenes_are_saved_at_equal_error():
    """Against McNemar's test of 50 scenes; the sequential one may continue to 65."""
    rng = np.random.default_rng(2)
    for first, second in ((0.3, 0.7), (0.2, 0.6), (0.4, 0.85)):
        solved, scores = credited(rng, 500, 65, first, second)
        won, lost = (solved[:, :50] > 0).sum(1), (solved[:, :50] < 0).sum(1)
        fixed = 2 * binom.cdf(np.minimum(won, lost), won + lost, 0.5) <= 0.05
        at = ends(scores)
        assert (at <= 65).mean() >= fixed.mean()
        assert np.minimum(at, 65).mean() <= 0.6 * 50


def test_holm_is_stricter_than_false_discovery_and_keeps_order():
    p = [0.04, 0.001, 0.03, 0.2]
    assert holm(p) == pytest.approx([0.09, 0.004, 0.09, 0.2])
    assert all(a >= b - 1e-12 for a, b in zip(holm(p), false_discovery_control(p), strict=True))


def test_the_command_names_the_better_policy(tmp_path):
    good = write(tmp_path / "good", "good", [True] * 30)
    bad = write(tmp_path / "bad", "bad", [False] * 30)
    same = write(tmp_path / "same", "same", [False] * 30)
    said = CliRunner().invoke(
        app, ["compare", bad, good, same, "--sequential", "--score", "success", "--json"]
    )
    first, second = json.loads(said.stdout)["comparisons"]
    assert first["better"] == "good" and first["decided"] < 12
    assert second["better"] is None and second["more"] is None


def test_p_of_several_policies_is_corrected(tmp_path):
    runs = [write(tmp_path / "a", "a", [False] * 6)]
    runs += [write(tmp_path / name, name, [True] * 6) for name in ("b", "c")]
    said = CliRunner().invoke(app, ["compare", *runs, "--json"])
    assert [row["p"] for row in json.loads(said.stdout)["comparisons"]] == [2 * 2 / 2**6] * 2


def test_a_score_outside_its_range_is_refused():
    with pytest.raises(ValueError, match="-1, 1"):
        sequential([2.0])
