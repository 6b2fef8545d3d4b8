"""The study of docs/science/phases.md: its estimate, and its tables from rows."""

from collections import Counter
from itertools import product

import numpy as np
import pytest
from scipy.stats import ttest_1samp

from benchmarks.phase_diagram import EXPERTS, INPUTS, NETWORKS, SETS, TASKS, units
from benchmarks.phase_tables import PRIMARY, CrossedMean, by_task, contrasts, crossed, draw, success


def drawn(
    rng: np.random.Generator, sets: float, networks: float, scenes: float, both: float
) -> np.ndarray:
    """Values (3,5,10) around 0 with these standard deviations, and noise of 1."""
    return (
        sets * rng.normal(size=(3, 1, 1))
        + networks * rng.normal(size=(3, 5, 1))
        + scenes * rng.normal(size=(1, 1, 10))
        + both * rng.normal(size=(3, 1, 10))
        + rng.normal(size=(3, 5, 10))
    )


@pytest.mark.parametrize(
    "spread", [(1, 0.5, 1, 0.5), (0, 0, 1, 0), (1, 0, 0, 0), (0, 0.3, 0, 0.5), (0, 0, 0, 0)]
)
def test_intervals_cover_the_truth_whatever_varies(spread: tuple[float, ...]):
    rng = np.random.default_rng(0)
    found = [crossed(drawn(rng, *spread)) for _ in range(1000)]
    covered = np.mean([e.low <= 0 <= e.high for e in found])
    assert 0.93 <= covered <= 1.0
    assert np.mean([e.p < 0.05 for e in found]) == pytest.approx(1 - covered, abs=0.002)


def test_it_is_a_t_test_over_sets_where_only_these_vary():
    means = np.array([1.0, 2.0, 4.0])
    estimate = crossed(np.broadcast_to(means[:, None, None], (3, 5, 10)))
    known = ttest_1samp(means, 0.0)
    interval = known.confidence_interval()
    assert estimate.p == pytest.approx(known.pvalue)
    assert (estimate.low, estimate.high) == pytest.approx((interval.low, interval.high))


def test_it_is_a_t_test_over_scenes_where_only_these_vary():
    values = np.random.default_rng(1).normal(1.0, 1.0, 10)
    estimate, known = crossed(np.broadcast_to(values, (3, 5, 10))), ttest_1samp(values, 0.0)
    assert estimate.p == pytest.approx(known.pvalue)


def test_nothing_varies():
    assert crossed(np.zeros((3, 5, 10))) == CrossedMean(0.0, 0.0, 0.0, 1.0)
    with pytest.raises(ValueError, match="one set"):
        crossed(np.zeros((1, 5, 10)))


def test_every_kind_of_network_comes_once_and_early():
    wanted = list(units())
    kinds = Counter((u.task, u.set, u.network, u.arm, u.inputs) for u in wanted)
    assert set(kinds.values()) == {1}
    assert len(wanted) == len(TASKS) * SETS * NETWORKS * len(EXPERTS) * len(INPUTS)
    first = {(u.task, u.set, u.arm, u.inputs) for u in wanted[: len(wanted) // NETWORKS]}
    assert len(first) == len(wanted) // NETWORKS


def test_tables_count_what_rows_say(tmp_path):
    """History adds exactly 40 points after reactive demonstrations and nothing after planned ones,
    but for one unfinished network."""
    cells = [f"{e} {ms} {a}" for e, ms, a in product((1, 8), (0, 300), (0.05, 0.2))]
    rows = [
        {"task": "click_bell", "set": held, "network": network, "arm": arm, "inputs": inputs}
        | {"scenes": {}, "solved": dict.fromkeys(cells, "1" * high + "0" * (10 - high))}
        for held, network, arm, inputs in product(range(3), range(2), EXPERTS, INPUTS)
        for high in [6 if (arm, inputs) == ("reactive", "two_frames") else 2]
    ]
    rows = rows[:-1]  # the last network has not been evaluated
    cubes = by_task(rows)
    cube = cubes["click_bell"]
    assert cube.networks == [0]
    values = {name: crossed(contrast(cube)).mean for name, contrast in PRIMARY.items()}
    assert [*values.values()] == pytest.approx([40, 0, 0, 0, 0, 40])
    lines = success(cubes).splitlines()[2:]
    assert len(lines) == 16
    assert all("| 20 | 60 |" in line for line in lines if "| reactive |" in line)
    assert len(contrasts(cubes).splitlines()) == 2 + len(PRIMARY)
    draw(cubes, tmp_path / "phases.png")
    assert (tmp_path / "phases.png").stat().st_size > 1000
    # of a set that has only begun nothing counts, and the others do
    began = [r for r in rows if r["network"] == 0 and (r["set"] < 2 or r["arm"] == "planned")]
    assert by_task(began)["click_bell"].sets == [0, 1]
    assert not by_task([row for row in began if row["set"] == 0])
