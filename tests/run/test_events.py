"""The recipe of pairs, small: what is built is a pair, and what is exported says when."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest

from pipeline.data.episode.events import FIRED, WITHHELD
from pipeline.data.episode.file import EpisodeFile
from pipeline.report.viewer.data import episode_data
from tests.run.command import inside


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    out = tmp_path_factory.mktemp("events")
    small = ("--tasks", "click_bell", "--levels", "1", "--episodes", "2", "--size", "80x60")
    one = ("--events", "stop@share=0.5", "--cameras", "head", "--instructions", "2")
    code, _, err = inside(
        *("build", "--manifest", "events", *small, *one, "--out", out),
        *("--quiet", "--executor", "inline"),
    )
    assert code == 0, err
    return out


@pytest.mark.parametrize(
    ("verb", "event", "said"),
    [
        ("build", {"kind": "freeze", "cameras": ["nose"]}, "no camera 'nose'"),
        ("build", {"kind": ["push", "goal"]}, "click_bell"),
        ("build", {"kind": "latency"}, "latency"),
        ("build", {"kind": "instruction"}, "pick_named"),
        ("evaluate", {"kind": "goal"}, "click_bell"),
        ("evaluate", {"kind": "freeze", "cameras": ["nose"]}, "no camera 'nose'"),
    ],
)
def test_events_that_cannot_act_are_refused_before_anything_is_made(tmp_path, verb, event, said):
    values = {"tasks": ["click_bell"], "levels": [1], "events": [event]}
    (tmp_path / "recipe.yaml").write_text(json.dumps(values))
    policy = ("--policy", "chaser", "--cameras", "head") if verb == "evaluate" else ()
    options = ("--manifest", tmp_path / "recipe.yaml", "--episodes", "1", "--quiet")
    code, _, err = inside(verb, *options, *policy, "--out", tmp_path / "out")
    assert code == 2 and said in err and err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_the_shipped_recipe_can_be_planned():
    code, _, err = inside("plan", "--manifest", "events")
    assert code == 0, err


def test_both_arms_are_the_same_until_the_event_and_exported_with_it(pair):
    files = sorted(pair.glob("episodes/**/*.hdf5"))
    episodes, images = [], []
    for path in files:
        with EpisodeFile(path) as file:
            episodes.append(file.read())
            images.append(file.array("observation/head_camera/rgb").tolist())
    one, two = episodes
    assert one.spec.pair == two.spec.pair != ""
    at = one.log.time_of(FIRED)
    assert at is not None and at == two.log.time_of(WITHHELD)
    frames = int((one.log.times <= at + 1e-9).sum())
    for name in ("poses", "qpos", "qvel", "state", "tcp"):
        first, second = (getattr(log, name)[:frames] for log in (one.log, two.log))
        assert first.tobytes() == second.tobytes(), name
    assert one.log.action[: frames - 1].tobytes() == two.log.action[: frames - 1].tobytes()
    assert images[0][:frames] == images[1][:frames]
    assert images[0][frames:] != images[1][frames : len(images[0])]
    assert not np.linalg.norm(one.log.target_velocity[frames : frames + 5], axis=1).any()
    code, _, err = inside("export", pair, "--format", "parquet", "--quiet")
    assert code == 0, err
    table = pq.read_table(pair / "exports/parquet/data-00000.parquet")
    rows = table.select(["timestamp", "event_kind", "event_active", "pair", "arm"]).to_pylist()
    active = [row for row in rows if row["event_active"]]
    assert {row["event_kind"] for row in active} == {"stop"}
    assert len(active) == len(one.log) - frames
    assert {row["pair"] for row in rows} == {one.spec.pair}
    assert {row["arm"] for row in active} == {"event"} < {row["arm"] for row in rows}
    code, _, err = inside("export", pair, "--format", "lerobot", "--workers", "1", "--quiet")
    assert code == 0, err
    (path,) = (pair / "exports/lerobot/meta/episodes").rglob("*.parquet")
    told = pq.read_table(path, columns=["domino.pair", "domino.arm"]).to_pylist()
    assert [row["domino.arm"] for row in told] == ["event", "control"]
    assert {row["domino.pair"] for row in told} == {one.spec.pair}


def test_the_viewer_names_what_happened_by_its_kind(pair):
    eventful, control = (
        episode_data(path, pair) for path in sorted((pair / "episodes").rglob("*.hdf5"))
    )
    names = [{event["name"] for event in data["events"]} for data in (eventful, control)]
    assert "stop" in names[0] ^ names[1] and "stop withheld" in names[0] ^ names[1]
