"""The table of several evaluations against counts by hand, and its page."""

import json

import pytest

from pipeline.evaluate.scoring.compare import newest
from pipeline.evaluate.scoring.page import ALL, board, board_page, clock_title
from tests.evaluate.scoring.test_compare import write


@pytest.fixture
def rows(tmp_path):
    """Two policies on two tasks and two levels, one of them also under a second clock."""
    for task, solved in (("a", [1, 1, 0, 0]), ("b", [1, 0, 0, 0])):
        write(tmp_path, "good", solved, task=task, levels=(1, 3))
        write(tmp_path, "good", [0] * 4, clock="latency:100", task=task)
        write(tmp_path, "<b>bad", [0] * 4, task=task, levels=(1, 3))
    return newest(tmp_path)


def test_a_line_is_a_policy_and_a_column_a_clock(rows):
    made = board(rows)
    assert made.clocks == ["sim", "latency:100"]
    assert (made.levels, made.tasks) == ([1, 3], [ALL, "a", "b"])
    assert len(made.lines) == 2 * 2 * 3
    best = next(line for line in made.lines if line.task == ALL and line.head["level"] == 1)
    assert best.head["policy"] == "good"
    # the mean over tasks of 50 and 25 per cent, not that of all episodes alone
    assert best.scores["sim"]["success_rate"] == pytest.approx(37.5)
    assert best.scores["latency:100"]["success_rate"] == 0
    low, high = best.scores["sim"]["success_rate_interval"]
    assert low < 37.5 < high


def test_a_scene_that_a_policy_tried_twice_counts_once(rows):
    def paired(row):
        return row | {"key": json.dumps([*json.loads(row["key"])[:5], ["paired"]])}

    assert board([*rows, *map(paired, rows)]) == board(rows)


def test_the_page_marks_up_no_name_and_has_no_script(rows, tmp_path):
    page = board_page({tmp_path: rows}, {tmp_path: ["<i>edited"]})
    assert "&lt;b&gt;bad" in page and "<b>bad" not in page
    assert "&lt;i&gt;edited" in page and "<script" not in page
    assert page.count("<tr data-level") == 12 + 10  # lines of the board, and cells
    assert page.count("8 in 2 tasks") == 5


def test_columns_go_from_paused_over_latencies_to_asynchronous_clocks(tmp_path):
    clocks = ["async:100", "latency:300", "late:50", "latency:100", "async:100:rtc", "sim"]
    for clock in clocks:
        write(tmp_path, "p", [1], clock=clock)
    titles = [clock_title(clock) for clock in board(newest(tmp_path)).clocks]
    assert titles == ["paused", "late:50", "100 ms", "300 ms", "async 100 ms", "async 100 ms rtc"]
    assert clock_title("latency:measured") == "latency:measured"
