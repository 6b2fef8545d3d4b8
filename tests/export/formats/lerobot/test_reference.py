"""The LeRobot export against lerobot itself: the files it writes for the same frames, and what it
reads from ours."""

import json

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from pipeline.data.episode.file import open_episode
from pipeline.export.shared.video import frames_of
from tests.export.running import run
from tests.synthetic import COLORS, episode_path, make_episode

CAMERAS = {
    "cam_high": "head_camera",
    "cam_left_wrist": "left_camera",
    "cam_right_wrist": "right_camera",
}


def test_against_lerobot_itself(tmp_path, monkeypatch):
    """One test, so that only one worker imports lerobot, which takes 15 s of CPU."""
    pytest.importorskip("lerobot")
    import datasets
    from lerobot.datasets import lerobot_dataset

    monkeypatch.setattr(datasets.config, "HF_DATASETS_CACHE", tmp_path / "cache")
    monkeypatch.setattr(datasets.config, "HF_HUB_OFFLINE", True)
    lerobot_reads_every_frame(lerobot_dataset, tmp_path / "a")
    a_plain_data_loader_takes_the_default(tmp_path / "a/out")
    policies_are_built_from_a_dataset_with_depth(lerobot_dataset, tmp_path / "d")
    the_files_are_those_that_lerobot_writes(lerobot_dataset, tmp_path / "b")
    load_dataset_reads_the_directory(tmp_path / "c")
    statistics_of_an_episode_are_lerobots()


def lerobot_reads_every_frame(lerobot, root):
    """Three episodes of different lengths, one data file and one video file each."""
    paths = [
        make_episode(episode_path(root, slot=i), slot=i, seed=i, frames=4 + i, level=1 + i)
        for i in range(3)
    ]
    out = root / "out"
    run("lerobot", root, out, paths, data_bytes=1)
    loaded = lerobot.LeRobotDataset("domino/test", root=out, video_backend="pyav")
    assert (loaded.num_episodes, loaded.num_frames, loaded.fps) == (3, 15, 15)
    row = 0
    for index, path in enumerate(paths):
        with open_episode(path) as e:
            state, action, pose = (
                e.array("joint_state/vector"),
                e.array("joint_action/vector"),
                e.array("target/pose"),
            )
            for t in range(len(e)):
                item = loaded[row]
                np.testing.assert_array_equal(
                    item["observation.state"].numpy(), state[t].astype(np.float32)
                )
                np.testing.assert_array_equal(item["action"].numpy(), action[t].astype(np.float32))
                np.testing.assert_array_equal(
                    item["target.pose"].numpy(), pose[t].astype(np.float32)
                )
                assert (
                    float(item["timestamp"]) == np.float32(t / 15)
                    and int(item["episode_index"]) == index
                )
                assert item["task"] in e.instructions()
                for name, camera in CAMERAS.items():
                    picture = item[f"observation.images.{name}"].numpy().transpose(1, 2, 0) * 255
                    source = e.rgb(camera, t).astype(float)
                    assert np.abs(picture - source).mean() < 3
                    square = np.abs(source - COLORS[camera]).max(-1) < 10
                    assert np.abs(picture[square].mean(0) - COLORS[camera]).max() < 15
                row += 1
    assert loaded.meta.filter_episodes(lambda ep: ep["domino.level"] == 2) == [1]
    window = lerobot.LeRobotDataset(
        "domino/test",
        root=out,
        video_backend="pyav",
        delta_timestamps={"action": [0, 1 / 15]},
        episodes=[1],
    )
    assert len(window) == 5 and window[0]["action"].shape == (2, 14)


def a_plain_data_loader_takes_the_default(out):
    """Batches of four, shuffled, with delta_timestamps, and torch's own collate: as the benchmark
    has other versions do it."""
    from benchmarks.consumers import loads

    loads.main(out)


def policies_are_built_from_a_dataset_with_depth(lerobot, root):
    """ACT's inputs are those of the dataset without depth, and a training step runs."""
    from lerobot.datasets.dataset_metadata import LeRobotDatasetMetadata
    from lerobot.policies.act.configuration_act import ACTConfig
    from lerobot.policies.factory import make_policy, make_pre_post_processors
    from torch.utils.data import DataLoader

    path = make_episode(episode_path(root), frames=5, depth=True)
    run("lerobot", root, root / "out", [path], depth=True)
    meta = LeRobotDatasetMetadata("domino/test", root=root / "out")
    small = {
        "dim_model": 32,
        "n_heads": 2,
        "dim_feedforward": 32,
        "n_encoder_layers": 1,
        "chunk_size": 2,
        "n_action_steps": 2,
    }
    config = ACTConfig(**small, device="cpu", pretrained_backbone_weights=None, use_vae=False)
    policy = make_policy(config, ds_meta=meta)
    assert set(config.image_features) == {f"observation.images.{name}" for name in CAMERAS}
    process, _ = make_pre_post_processors(config, dataset_stats=meta.stats)
    steps = {"action": [0.0, 1 / 15]}
    loaded = lerobot.LeRobotDataset(
        "domino/test", root=root / "out", video_backend="pyav", delta_timestamps=steps
    )
    loss, _ = policy.forward(process(next(iter(DataLoader(loaded, batch_size=2)))))
    loss.backward()
    assert np.isfinite(loss.item())


def the_files_are_those_that_lerobot_writes(lerobot, root):
    """info.json, tasks and data equal; episode rows equal but for our own columns and finer
    statistics; the same videos."""
    from lerobot.configs import RGBEncoderConfig

    paths = [
        make_episode(episode_path(root, slot=i), slot=i, seed=i, frames=5 + i) for i in range(2)
    ]
    ours, theirs = root / "ours", root / "theirs"
    run("lerobot", root, ours, paths)
    info = json.loads((ours / "meta/info.json").read_text())
    given = {n: f for n, f in info["features"].items() if f["names"]}
    given = {
        n: {"dtype": f["dtype"], "shape": tuple(f["shape"]), "names": f["names"]}
        for n, f in given.items()
    }
    made = lerobot.LeRobotDataset.create(
        "domino/test",
        15,
        given,
        theirs,
        "aloha-agilex",
        video_backend="pyav",
        rgb_encoder=RGBEncoderConfig(vcodec="h264", g=1, crf=20, preset="ultrafast"),
        encoder_threads=1,
    )
    tasks = [
        row["tasks"][0]
        for row in pq.read_table(ours / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    ]
    for path, task in zip(paths, tasks, strict=True):
        with open_episode(path) as e:
            for t in range(len(e)):
                keys = {
                    "observation.state": "joint_state/vector",
                    "action": "joint_action/vector",
                    "target.pose": "target/pose",
                }
                frame = {name: e.array(key)[t].astype(np.float32) for name, key in keys.items()}
                for what in ("velocity", "angular_velocity"):
                    frame[f"target.{what}"] = e.array(f"target/{what}")[t].astype(np.float32)
                frame["ee.pose"] = np.concatenate(
                    [e.array(f"endpose/{s}_endpose")[t] for s in ("left", "right")]
                ).astype(np.float32)
                frame |= {
                    f"camera.{n}.pose": e.array(f"observation/{c}/pose")[t].astype(np.float32)
                    for n, c in CAMERAS.items()
                }
                # the one contact of the synthetic log
                touch = np.array([t == len(e) // 2, 0], np.float32)
                frame |= {"contact.target": touch, "contact.manipulated": touch}
                later = [min(t + k, len(e) - 1) for k in range(1, 16)]
                frame["target.path"] = e.array("target/pose")[later, :3].ravel().astype(np.float32)
                for name, camera in CAMERAS.items():
                    frame[f"trace.{name}"] = trace(e, camera, t, later).ravel().astype(np.float32)
                frame |= wanted_texts(t, len(e))
                frame |= {
                    f"observation.images.{name}": e.rgb(camera, t)
                    for name, camera in CAMERAS.items()
                }
                made.add_frame({**frame, "task": task})
        made.save_episode(parallel_encoding=False)
    made.finalize()

    assert info == json.loads((theirs / "meta/info.json").read_text())
    pd.testing.assert_frame_equal(
        pd.read_parquet(ours / "meta/tasks.parquet"), pd.read_parquet(theirs / "meta/tasks.parquet")
    )
    data = [pq.ParquetFile(where / "data/chunk-000/file-000.parquet") for where in (ours, theirs)]
    assert data[0].schema_arrow.equals(data[1].schema_arrow)
    described = [
        json.loads(d.schema_arrow.metadata[b"huggingface"])["info"]["features"] for d in data
    ]
    assert described[0] == described[1]
    for name in data[0].schema_arrow.names:
        mine, other = (d.read([name]) for d in data)
        if name.startswith("trace."):  # computed otherwise here: the last digits differ
            np.testing.assert_allclose(mine[name].to_pylist(), other[name].to_pylist(), atol=1e-3)
        else:
            assert mine.equals(other), name
    assert data[0].num_row_groups == data[1].num_row_groups == 2

    rows = [
        pq.read_table(where / "meta/episodes/chunk-000/file-000.parquet")
        for where in (ours, theirs)
    ]
    added = set(rows[0].column_names) - set(rows[1].column_names)
    assert not set(rows[1].column_names) - set(rows[0].column_names) and all(
        n.startswith("domino.") for n in added
    )
    for name in rows[1].column_names:
        assert rows[0].schema.field(name).type == rows[1].schema.field(name).type, name
        if not name.startswith("stats/"):
            got, want = rows[0][name].to_pylist(), rows[1][name].to_pylist()
            assert got == (want if name == "tasks" else pytest.approx(want)), name
    compare_statistics(
        *(json.loads((where / "meta/stats.json").read_text()) for where in (ours, theirs))
    )
    for name in CAMERAS:
        video = f"videos/observation.images.{name}/chunk-000/file-000.mp4"
        for (t0, a), (t1, b) in zip(
            frames_of(ours / video), frames_of(theirs / video), strict=True
        ):
            assert t0 == pytest.approx(t1) and np.abs(a.astype(int) - b).mean() < 1.5


def trace(e, camera, t, later):
    """Pixels and depth of the target's later places in a camera that stays where it is at frame t,
    by its stored matrices."""
    points = e.array("target/pose")[later, :3]
    k, extrinsic = (
        e.array(f"observation/{camera}/intrinsic_cv")[t],
        e.array(f"observation/{camera}/extrinsic_cv")[t],
    )
    seen = points @ extrinsic[:, :3].T + extrinsic[:, 3]
    uvd = np.column_stack([seen[:, :2] @ k[:2, :2] / seen[:, 2:] + k[:2, 2], seen[:, 2]])
    return np.where(seen[:, 2:] > 0.01, uvd, 0.0)


def wanted_texts(t, frames):
    """The script of the synthetic log: a grasp beside the other arm until the middle, nothing for
    half a frame, a lift."""
    if t < frames // 2:
        subtask = "grasp the bell with the left arm and bring the right arm home"
        return {"subtask": subtask, "skill": "grasp+home", "stage": "meet"}
    if frames // 2 < t < frames - 1:
        return {"subtask": "lift the bell with the left arm", "skill": "lift", "stage": "finish"}
    return {"subtask": "wait", "skill": "wait", "stage": "finish"}


def load_dataset_reads_the_directory(root):
    """`load_dataset(DIR)` finds the data by the front matter of the card."""
    import datasets

    path = make_episode(episode_path(root), frames=5)
    run("lerobot", root, root / "out", [path])
    loaded = datasets.load_dataset(str(root / "out"), split="train")
    assert len(loaded) == 5 and len(loaded[0]["observation.state"]) == 14
    card = (root / "out/README.md").read_text()
    assert "LeRobot" in card and "size_categories" in card and "5 frames at 15 Hz" in card


def compare_statistics(ours, theirs):
    """Equal but for the quantiles, which lerobot averages over episodes, and for what float32 costs
    it in the std of pictures."""
    assert set(ours) == set(theirs)
    for feature, entry in theirs.items():
        assert set(ours[feature]) == set(entry), feature
        for stat, value in entry.items():
            assert np.shape(ours[feature][stat]) == np.shape(value), (feature, stat)
            if not stat.startswith("q"):
                np.testing.assert_allclose(
                    ours[feature][stat], value, atol=5e-3, err_msg=f"{feature} {stat}"
                )


def statistics_of_an_episode_are_lerobots():
    """Quantiles within a bin or two of lerobot's histogram, the rest equal, the same frames and
    pixels sampled."""
    from lerobot.datasets.compute_stats import compute_episode_stats, sample_indices

    from pipeline.export.shared.statistics import (
        color_counts,
        image_stats,
        sample_rows,
        vector_stats,
    )

    rng = np.random.default_rng(0)
    values = rng.normal(size=(150, 3)).astype(np.float32)
    want = compute_episode_stats({"x": values}, {"x": {"dtype": "float32", "shape": (3,)}})["x"]
    got = vector_stats(values)
    for name, value in want.items():
        np.testing.assert_allclose(got[name], value, atol=2 * np.ptp(values) / 5000, err_msg=name)
    for length in (1, 99, 100, 465, 2000, 300_000):
        np.testing.assert_array_equal(sample_rows(length), sample_indices(length))

    frames = rng.integers(0, 256, (2, 240, 320, 3), np.uint8)
    from lerobot.datasets.compute_stats import auto_downsample_height_width, get_feature_stats

    thin = np.stack([auto_downsample_height_width(f.transpose(2, 0, 1)) for f in frames])
    want = get_feature_stats(thin, axis=(0, 2, 3), keepdims=True)
    got = image_stats(color_counts(list(frames)), 2)
    for name, value in want.items():
        np.testing.assert_allclose(
            got[name].ravel() * (1 if name == "count" else 255),
            value.ravel(),
            atol=0.1,
            err_msg=name,
        )
