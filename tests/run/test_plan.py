"""What a plan says a build will take."""

import json
import os
from pathlib import Path

import pytest

from pipeline.crew.progress import Bar, JsonLines, Progress
from pipeline.data.atomic import write_atomic
from pipeline.data.dataset import Dataset, DatasetError
from pipeline.data.recipe.model import parse_recipe
from pipeline.data.slots.records import FileFacts, SlotRecord
from pipeline.run.plan import BOUNDS, EpisodeCost, Unbounded, check_bounded, cost_of, plan, typical
from tests.data.test_dataset import KEYS, attempt_row
from tests.recording import record_all
from tests.synthetic import make_episode

RECIPE = parse_recipe({"tasks": "click_bell", "levels": [1, 3], "episodes": 2})


def test_hours_are_seconds_of_all_attempts_spread_over_workers(tmp_path):
    dataset = Dataset(tmp_path)
    dataset.create(RECIPE)
    slot = next(iter(RECIPE.slots()))
    write_atomic(dataset.episode(slot), bytes(5000))
    rows = (attempt_row(0, "failed") | {"seconds": 2.0}, attempt_row(1) | {"seconds": 7.0})
    record_all(
        dataset, [(slot, SlotRecord(KEYS, True, "0" * 64, rows, 1.0, file=FileFacts(size=5000)))]
    )
    assert cost_of(dataset, RECIPE) == EpisodeCost(9.0, 5000.0, "this dataset")
    values = plan(RECIPE, dataset, workers=2)
    assert values["finished"] == 1
    # the keys of the finished slot are not those of this code: its physics is made again
    assert [(row["what"], row["slots"]) for row in values["redo"]] == [("physics", 1)]
    assert values["estimated_hours"] == pytest.approx(4 * 9 / 3600 / 2)
    assert values["estimated_bytes"] == 20000
    assert values["estimated_core_hours"] == pytest.approx(4 * 9 / 3600)
    measured = plan(RECIPE, dataset, 2, EpisodeCost(100.0, 7.0, "here"))
    assert (
        measured["estimated_hours"] == pytest.approx(4 * 100 / 3600 / 2)
        and measured["estimate_from"] == "here"
    )
    dataset.episode(slot).unlink()  # an episode that is missing is made once, not twice
    gone = plan(RECIPE, dataset, 2, EpisodeCost(9.0, 5000.0, "here"))
    assert gone["finished"] == 0 and gone["redo"] == [] and gone["estimated_bytes"] == 20000


def test_a_plan_refuses_what_a_build_refuses_and_names_what_draws_another_camera(tmp_path):
    dataset = Dataset(tmp_path)
    dataset.create(RECIPE)
    other = RECIPE.override({"cameras": ["head", "observer"]})
    for use in (lambda: plan(other, dataset, workers=1), lambda: dataset.create(other)):
        with pytest.raises(DatasetError, match=r"cameras is .*render DATASET --cameras"):
            use()


def test_a_plan_of_nothing_uses_the_benchmarks():
    values, cost = plan(RECIPE, None, workers=1), typical(RECIPE)
    assert values["estimated_hours"] == pytest.approx(4 * cost.seconds / 3600)
    assert values["estimated_bytes"] == int(4 * cost.size)
    assert values["estimate_from"] == "benchmarks"


def test_a_new_build_that_nothing_bounds_is_refused_with_what_it_would_make(tmp_path):
    dataset = Dataset(tmp_path / "new")
    with pytest.raises(Unbounded, match=r"4 episodes, .* min on 1 worker and .* MB .*--yes$"):
        check_bounded(["seed", "alpha"], RECIPE, dataset, 1)
    assert not dataset.root.exists()
    for key in BOUNDS:
        check_bounded([key], RECIPE, dataset, 1)
    dataset.create(RECIPE)
    check_bounded([], RECIPE, dataset, 1)


def test_a_plan_reckons_with_the_setup():
    """Bytes of one episode of handover_block at level 2: 172 frames at 15 Hz, four cameras, without
    sensors and with all of them at 640x480."""
    wanted = {
        "tasks": "handover_block",
        "levels": 2,
        "episodes": 1,
        "cameras": ["head", "left", "right", "observer"],
    }
    sensors = {"depth": True, "segmentation": True, "pointcloud": True}
    large = parse_recipe(wanted | sensors | {"size": [640, 480]})
    assert 1 / 1.5 < typical(large).size / (172 * 329_853) < 1.5
    small = parse_recipe(wanted | {"size": [160, 120]})
    assert 1 / 1.5 < typical(small).size / (172 * 36_964) < 1.5
    twice = small.override({"fps": 30, "lead": 1.0})
    assert typical(twice).size > 2 * (typical(small).size - 95_000)
    assert (
        typical(small).seconds
        < typical(twice).seconds
        < typical(twice.override({"render": "rt"})).seconds / 10
    )


def test_a_plan_says_core_hours(tmp_path):
    dataset = Dataset(tmp_path)
    dataset.create(RECIPE)
    slot = next(iter(RECIPE.slots()))
    make_episode(dataset.episode(slot), frames=4, depth=True)
    file = FileFacts(size=dataset.episode(slot).stat().st_size)
    rows = (attempt_row(0) | {"seconds": 7.0},)
    record_all(dataset, [(slot, SlotRecord(KEYS, True, "0" * 64, rows, 6.0, 1.5, file))])
    # the finished slot has keys of other code: it is made again
    values = plan(RECIPE, dataset, workers=1)
    assert values["estimated_hours"] == pytest.approx(4 * 7 / 3600)
    assert values["estimated_core_hours"] == pytest.approx(4 * 1.5 / 3600)
    assert values["estimated_bytes"] == 4 * file.size


@pytest.mark.parametrize(
    ("seconds", "episodes", "workers", "text"),
    [
        (60, 10, 2, "5 min to 8 min on 2 workers and 20 MB (estimated from x)"),
        (3600, 3, 1, "3.0 h to 5.1 h on 1 worker and 6 MB (estimated from x)"),
        (1, 1, 1, "1 min on 1 worker and 2 MB (estimated from x)"),
        (1, 0, 10, "nothing is left to make"),
    ],
)
def test_an_estimate_is_a_range_in_round_figures(seconds, episodes, workers, text, monkeypatch):
    monkeypatch.setattr(os, "getloadavg", lambda: (0.0, 0.0, 0.0))
    monkeypatch.setattr(os, "cpu_count", lambda: 4)
    assert EpisodeCost(seconds, 2e6, "x").describe(episodes, workers) == text


def test_an_estimate_widens_with_the_load(monkeypatch):
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    times = []
    for load in (0.0, 20.0):
        monkeypatch.setattr(os, "getloadavg", lambda load=load: (load, load, load))
        times.append(EpisodeCost(60.0, 1.0, "").hours(10, workers=2))
    assert times[0][0] == times[1][0] == 10 * 60 / 2 / 3600
    assert times[1][1] == pytest.approx(11 * times[0][1])


def test_progress_as_json_lines_counts_what_changed(capsys, monkeypatch):
    clock = iter([100.0, 100.0, 110.0, 110.0, 130.0])
    monkeypatch.setattr("pipeline.crew.progress.time.monotonic", lambda: next(clock))
    lines = JsonLines(10, 4)
    lines.add([attempt_row(0, "failed"), attempt_row(1)])
    lines.count_lost()
    lines.show_activity("compiling")
    lines.add([attempt_row(0, "failed"), attempt_row(1, "failed")])
    start, slot, lost, note, last = map(json.loads, capsys.readouterr().out.splitlines())
    assert (start["event"], start["wanted"], start["done"], start["eta_seconds"]) == (
        "start",
        10,
        4,
        None,
    )
    assert (slot["task"], slot["slot"], slot["done"], slot["accepted"], slot["attempts"]) == (
        "click_bell",
        0,
        5,
        1,
        2,
    )
    # one slot in 10 s, of which five are left
    assert (slot["elapsed_seconds"], slot["episodes_per_hour"], slot["eta_seconds"]) == (
        10.0,
        360.0,
        50.0,
    )
    assert (lost["event"], lost["workers_lost"]) == ("worker_lost", 1)
    assert note == {"event": "note", "text": "compiling"}
    reason = attempt_row(0, "failed")["reason"]
    assert (last["given_up"], last["failures"], last["eta_seconds"]) == (1, {reason: 3}, 60.0)
    page = (Path(__file__).parents[2] / "docs" / "cluster.md").read_text()
    for key in {*start, *slot, *lost, *note}:
        assert f"`{key}`" in page, key


def test_the_bar_says_what_goes_on_before_the_first_episode(capsys):
    progress = Bar(3, 0)
    progress.write_line("3 episodes to make")
    progress.show_activity("starting 2 workers")
    progress.close()
    err = capsys.readouterr().err
    assert err.index("3 episodes to make") < err.index("starting 2 workers")
    quiet = Progress(3, 0)
    quiet.write_line("3 episodes to make")
    quiet.show_activity("starting 2 workers")
    quiet.close()
    assert capsys.readouterr().err == ""
