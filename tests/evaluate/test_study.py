"""The study of the reference policies: what it runs, what its tables say of constructed rows, and
the page they go to."""

import itertools

import pytest

from benchmarks.study import page, tables
from benchmarks.study.plan import GOES_ON, LATE, TEN, groups
from benchmarks.study.rows import Rate, StudyRows, at
from pipeline.data.setup import DEFAULT
from pipeline.evaluate.names import policy_name
from pipeline.evaluate.scoring.clock import parse_clock
from pipeline.evaluate.scoring.statistics import wilson
from pipeline.tasks import TASKS


def row(task, policy, clock="sim", level=1, alpha=0.1, rules="strict", success=True, seed=0):
    values = {"embodiment": "r", "seed": seed} | {
        "task": task,
        "policy": policy,
        "clock": clock,
        "level": level,
        "alpha": alpha,
        "rules": rules,
        "success": success,
    }
    return values | {"version": "v1", "hardware": "a processor, load 1; 2026-01-01"}


def cell_rows():
    """Two tasks: the static expert fails where the target moves; grab_roller suffers from lateness,
    click_bell does not."""
    out = []
    for task, (level, alpha) in itertools.product(("click_bell", "grab_roller"), tables.COLUMNS):
        for policy in ("replay", "static", "chaser", "interceptor", "random"):
            good = policy != "random" and (policy != "static" or level == 0)
            out += [
                row(task, policy, level=level, alpha=alpha or 0.1, success=good, seed=seed)
                for seed in (0, 1)
            ]
    for task, ms in itertools.product(("click_bell", "grab_roller"), LATE[1:]):
        for alpha in (0.05, 0.1, 0.2):
            out.append(
                row(
                    task,
                    "replay",
                    f"late:{ms}",
                    alpha=alpha,
                    success=task == "click_bell" or ms < 400,
                )
            )
    out += [
        row(
            "click_bell",
            "replay",
            f"late:{ms}" if ms else "sim",
            rules=GOES_ON.label,
            success=ms < 200,
        )
        for ms in LATE
    ]
    for chunk, ms in itertools.product(("", ":chunk=15"), (50, 100, 200, 400)):
        out.append(row("click_bell", f"interceptor{chunk}", f"latency:{ms}", success=bool(chunk)))
    return StudyRows(tuple(out))


def test_the_study_names_what_exists():
    assert len(set(TEN)) == 10
    assert [TASKS[task].category for task in TEN] == ["interception"] * 5 + ["tracking"] * 5
    tried = [(g.setup, *t) for task in TEN for g in groups(task) for t in g.tries]
    assert {rules for rules, _, _ in tried} == {DEFAULT, GOES_ON}
    for _, policy, clock in set(tried):
        assert policy_name(policy).label == policy
        assert parse_clock(clock).name == clock
    rules = {task: {g.setup for g in groups(task)} for task in TEN}
    assert rules["click_bell"] == {DEFAULT, GOES_ON}
    assert rules["shake_bottle"] == {DEFAULT}


def test_tables_say_what_the_rows_say():
    rows = cell_rows()
    lines = {line.split(" | ")[0].strip("| "): line for line in tables.summary(rows).splitlines()}
    # Wilson's interval of 4 of 4 and of 0 of 4
    assert lines["static"].startswith("| static | 100 (51-100) | 0 (0-49) |")
    assert "| grab_roller | 2/2 | 2/2 | 2/2 | 2/2 | 0/2 | 0/2 |" in tables.by_task(rows)
    assert "| grab_roller | stop | 0.1 | 100 | 100 | 100 | 0 | 0 |" in tables.timing(rows)
    assert "| click_bell | continue | 0.1 | 100 | 100 | 0 | 0 | 0 |" in tables.timing(rows)
    assert list(tables.untimed(rows)) == [("click_bell", "stop")]
    assert tables.delays(rows).splitlines()[-2].startswith("| 1 action | 100 (51-100) | 0 (0-79)")
    assert at(rows, 1, 0.0).rate == at(rows, 0, 0.1).rate
    tried = at(rows, 1, 0.0).rate
    assert (tried.solved, tried.episodes) == (16, 20)


def test_episodes_of_one_scene_are_no_evidence_of_their_own():
    once = [row("t", "replay", seed=seed, success=seed < 3) for seed in range(5)]
    assert Rate.of(once).interval == pytest.approx([100 * x for x in wilson(3, 5)])
    assert Rate.of(once * 4).interval == Rate.of(once).interval
    apart = [
        row("t", "replay", seed=seed, success=(seed + n) % 2 == 0)
        for seed in range(6)
        for n in range(4)
    ]
    assert Rate.of(apart).interval == pytest.approx([100 * x for x in wilson(12, 24)])


def test_the_page_is_written_between_its_marks(tmp_path):
    target = tmp_path / "measurements" / "evaluation.md"
    target.parent.mkdir()
    target.write_text(f"head\n{page.BEGIN}old{page.END}\ntail\n")
    page.write(cell_rows(), tmp_path)
    text = target.read_text()
    assert text.startswith("head\n")
    assert text.endswith("\ntail\n")
    assert "old" not in text
    assert "code v1, a processor" in text
    assert {path.name for path in tmp_path.glob("*.png")} == {
        "evaluation_policies.png",
        "evaluation_timing.png",
        "evaluation_latency.png",
    }
    with pytest.raises(ValueError, match="no marks"):
        page.inserted("nothing", "x", page.BEGIN, page.END)
