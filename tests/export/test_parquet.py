"""Flat Parquet: every column against the episode, read by pyarrow, pandas and Hugging Face datasets."""

import json

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pipeline.data.episode import open_episode
from pipeline.export import check_exports
from tests.export.running import run
from tests.synthetic import COLORS, episode_path, make_episode


@pytest.fixture
def episodes(tmp_path):
    """Two episodes of 14 values and one of 16."""
    wide = make_episode(episode_path(tmp_path, "franka-panda"), embodiment="franka-panda", frames=3, level=3)
    return [wide, *(make_episode(episode_path(tmp_path, slot=i), slot=i, seed=i, frames=5 + i) for i in range(2))]


def test_every_frame_is_a_row_with_its_own_values(tmp_path, episodes):
    out = tmp_path / "out"
    summary = run("parquet", tmp_path, out, episodes)
    assert summary["embodiments"] == ["aloha-agilex", "franka-panda"] and summary["frames"] == 3 + 5 + 6
    table = pq.read_table(out / "data-00000.parquet")
    assert len(table) == 14
    assert pq.read_metadata(out / "data-00000.parquet").num_row_groups == 3
    for index, path in enumerate(sorted(episodes)):
        rows = table.filter(pa.compute.equal(table["episode_index"], index)).to_pylist()
        with open_episode(path) as e:
            assert [r["frame_index"] for r in rows] == list(range(len(e)))
            np.testing.assert_allclose([r["timestamp"] for r in rows], np.arange(len(e)) / 15, atol=1e-12)
            for column, key in (("state", "joint_state/vector"), ("action", "joint_action/vector"), ("target_pose", "target/pose")):
                np.testing.assert_array_equal(np.array([r[column] for r in rows], np.float32), e.array(key).astype(np.float32))
            np.testing.assert_array_equal(
                np.array([r["tcp_right"] for r in rows], np.float32), e.array("endpose/right_endpose").astype(np.float32)
            )
            for column, camera in (("image_cam_high", "head_camera"), ("image_cam_left_wrist", "left_camera")):
                assert [r[column]["bytes"] for r in rows] == [e.jpeg(camera, t) for t in range(len(e))]
            assert {r["instruction"] for r in rows} <= set(e.instructions())
            assert {(r["task"], r["level"], r["slot"]) for r in rows} == {(e.spec.task, e.spec.level, e.spec.slot)}
        assert [r["is_first"] for r in rows] == [True] + [False] * (len(rows) - 1)
        assert [r["is_last"] for r in rows] == [False] * (len(rows) - 1) + [True]
    assert check_exports(tmp_path, out, "parquet", episodes) == []


def test_events_are_on_their_frames(tmp_path):
    path = make_episode(episode_path(tmp_path), frames=12)
    run("parquet", tmp_path, tmp_path / "out", [path])
    rows = pq.read_table(tmp_path / "out" / "data-00000.parquet").to_pylist()
    # the synthetic release is 0.4 of a frame after the meeting at frame 6
    assert {r["frame_index"]: r["events"] for r in rows if r["events"]} == {6: ["meeting"], 7: ["release"], 11: ["success"]}
    assert rows[7]["event_times"] == [pytest.approx(6.4 / 15)]


def test_metadata_names_the_joints_of_each_embodiment(tmp_path, episodes):
    run("parquet", tmp_path, tmp_path / "out", episodes)
    domino = json.loads(pq.read_schema(tmp_path / "out" / "data-00000.parquet").metadata[b"domino"])
    assert domino["fps"] == 15
    assert {name: len(names) for name, names in domino["names"].items()} == {"aloha-agilex": 14, "franka-panda": 16}
    rows = pq.read_table(tmp_path / "out" / "episodes.parquet").to_pylist()
    assert [r["length"] for r in rows] == [5, 6, 3] and len(rows[0]["instructions_seen"]) == 3


def test_files_roll_over_and_stay_in_order(tmp_path, episodes):
    out = tmp_path / "out"
    assert run("parquet", tmp_path, out, episodes, file_bytes=1)["files"] == 3
    assert [p.name for p in sorted(out.glob("data-*"))] == [f"data-0000{i}.parquet" for i in range(3)]
    assert pq.read_table(sorted(out.glob("data-*"))[1])["episode_index"].to_pylist() == [1] * 6
    assert check_exports(tmp_path, out, "parquet", episodes) == []


def test_hugging_face_datasets_and_pandas_read_it_offline(tmp_path, episodes, monkeypatch):
    datasets = pytest.importorskip("datasets")
    monkeypatch.setattr(datasets.config, "HF_DATASETS_CACHE", tmp_path / "cache")
    monkeypatch.setattr(datasets.config, "HF_HUB_OFFLINE", True)
    run("parquet", tmp_path, tmp_path / "out", episodes)
    loaded = datasets.load_dataset("parquet", data_files=str(tmp_path / "out" / "data-*.parquet"), split="train")
    assert len(loaded) == 14
    picture = np.asarray(loaded[0]["image_cam_high"])
    assert 1200 < (np.abs(picture.astype(int) - COLORS["head_camera"]).max(-1) < 25).sum() <= 1700
    frame = loaded.to_pandas()
    assert frame["state"].map(len).tolist() == [14] * 11 + [16] * 3


def test_jpeg_bytes_are_true_rgb(tmp_path, episodes):
    run("parquet", tmp_path, tmp_path / "out", episodes)
    row = pq.read_table(tmp_path / "out" / "data-00000.parquet").slice(0, 1).to_pylist()[0]
    rgb = cv2.imdecode(np.frombuffer(row["image_cam_right_wrist"]["bytes"], np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    assert (np.abs(rgb.astype(int) - COLORS["right_camera"]).max(-1) < 25).sum() > 1200


def test_check_sees_a_changed_value(tmp_path, episodes):
    out = tmp_path / "out"
    run("parquet", tmp_path, out, episodes)
    file = out / "data-00000.parquet"
    table = pq.read_table(file)
    actions = table["action"].to_pylist()
    actions[0][3] += 1e-3
    changed = table.set_column(
        table.schema.get_field_index("action"), table.schema.field("action"), pa.array(actions, pa.list_(pa.float32()))
    )
    with pq.ParquetWriter(file, table.schema) as writer:
        for start, length in ((0, 5), (5, 6), (11, 3)):
            writer.write_table(changed.slice(start, length))
    problems = check_exports(tmp_path, out, "parquet", episodes)
    assert len(problems) == 1 and "data-00000.parquet, row group 0: column action differs from" in problems[0]
    file.write_bytes(file.read_bytes()[:1000])
    assert len(check_exports(tmp_path, out, "parquet", episodes)) == 1
