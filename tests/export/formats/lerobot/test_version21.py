"""LeRobot v2.1: the files its reader asks for, read as that reader does."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pipeline.data.episode.file import open_episode
from pipeline.export.shared.video import frames_of
from tests.export.running import run
from tests.synthetic import episode_path, make_episode

CAMERAS = {
    "cam_high": "head_camera",
    "cam_left_wrist": "left_camera",
    "cam_right_wrist": "right_camera",
}


@pytest.fixture
def episodes(tmp_path):
    """Three episodes of different lengths."""
    return [
        make_episode(episode_path(tmp_path, slot=i), slot=i, seed=i, frames=4 + i) for i in range(3)
    ]


def lines(path):
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_round_trip_by_the_templates_of_info(tmp_path, episodes):
    out = tmp_path / "out"
    summary = run("lerobot-v2.1", tmp_path, out, episodes)
    assert (summary["version"], summary["episodes"], summary["frames"]) == ("v2.1", 3, 15)
    info = json.loads((out / "meta/info.json").read_text())
    assert (info["codebase_version"], info["total_videos"], info["total_chunks"], info["fps"]) == (
        "v2.1",
        9,
        1,
        15,
    )
    tasks = {row["task_index"]: row["task"] for row in lines(out / "meta/tasks.jsonl")}
    start = 0
    for row, path in zip(lines(out / "meta/episodes.jsonl"), episodes, strict=True):
        index = row["episode_index"]
        table = pq.read_table(out / info["data_path"].format(episode_chunk=0, episode_index=index))
        data = table.to_pydict()
        with open_episode(path) as e:
            assert row["length"] == len(e) == len(table) and row["tasks"] == [
                tasks[data["task_index"][0]]
            ]
            assert row["tasks"][0] in e.instructions()
            np.testing.assert_array_equal(
                data["action"], e.array("joint_action/vector").astype(np.float32)
            )
            np.testing.assert_array_equal(
                data["observation.state"], e.array("joint_state/vector").astype(np.float32)
            )
            assert data["index"] == list(range(start, start + len(e)))
            for name, camera in CAMERAS.items():
                key = f"observation.images.{name}"
                video = out / info["video_path"].format(
                    episode_chunk=0, episode_index=index, video_key=key
                )
                for (time, image), (t, want) in zip(
                    frames_of(video), enumerate(e.frames(camera)), strict=True
                ):
                    assert (
                        time == pytest.approx(t / 15)
                        and np.abs(image.astype(int) - want).mean() < 3
                    )
            start += len(e)


def test_statistics_are_those_of_each_episode_in_the_shapes_asked_for(tmp_path, episodes):
    out = tmp_path / "out"
    run("lerobot-v2.1", tmp_path, out, episodes)
    info = json.loads((out / "meta/info.json").read_text())
    for row, path in zip(lines(out / "meta/episodes_stats.jsonl"), episodes, strict=True):
        assert set(row["stats"]) == {
            n for n, f in info["features"].items() if f["dtype"] != "string"
        }
        with open_episode(path) as e:
            state = e.array("joint_state/vector")
            np.testing.assert_allclose(
                row["stats"]["observation.state"]["mean"], state.mean(0), atol=1e-6
            )
            assert row["stats"]["observation.state"]["count"] == [len(e)]
        for name, entry in row["stats"].items():
            assert set(entry) == {"min", "max", "mean", "std", "count"} and np.shape(
                entry["count"]
            ) == (1,)
            assert np.shape(entry["mean"]) == (
                (3, 1, 1) if "images" in name else tuple(info["features"][name]["shape"])
            )


def test_old_versions_of_datasets_understand_the_features(tmp_path, episodes):
    out = tmp_path / "out"
    run("lerobot-v2.1", tmp_path, out, episodes[:1])
    metadata = pq.read_schema(out / "data/chunk-000/episode_000000.parquet").metadata[
        b"huggingface"
    ]
    features = json.loads(metadata)["info"]["features"]
    assert features["action"] == {
        "feature": {"dtype": "float32", "_type": "Value"},
        "length": 14,
        "_type": "Sequence",
    }


def test_statistics_of_all_frames_are_those_that_groot_would_make(tmp_path, episodes):
    out = tmp_path / "out"
    run("lerobot-v2.1", tmp_path, out, episodes)
    info, stats = (
        json.loads((out / "meta" / name).read_text()) for name in ("info.json", "stats.json")
    )
    frames = pa.concat_tables(
        pq.read_table(file) for file in sorted(out.glob("data/*/*.parquet"))
    ).to_pydict()
    assert (
        set(stats)
        == {name for name, feature in info["features"].items() if "float" in feature["dtype"]}
        >= {"timestamp", "action"}
    )
    for name, entry in stats.items():
        values = np.vstack([np.asarray(value, np.float32) for value in frames[name]])
        want = {key: getattr(np, key)(values, axis=0) for key in ("mean", "std", "min", "max")}
        want |= {key: np.quantile(values, q, axis=0) for key, q in (("q01", 0.01), ("q99", 0.99))}
        assert set(entry) == set(want)
        for key, value in want.items():
            np.testing.assert_allclose(
                entry[key], value, rtol=1e-4, atol=1e-6, err_msg=f"{name} {key}"
            )
