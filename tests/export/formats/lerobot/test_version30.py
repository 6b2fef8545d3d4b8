"""LeRobot export without lerobot: its files, counts, files that roll over, workers, and what the
check finds."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest

from pipeline.data.episode.file import open_episode
from pipeline.export import ExportError
from pipeline.export.formats.lerobot.options import datasets_of
from pipeline.export.shared.video import frames_of
from tests.export.running import run
from tests.synthetic import episode_path, make_episode

HEAD = "observation.images.cam_high"


@pytest.fixture
def episodes(tmp_path):
    """Three episodes of different lengths."""
    return [
        make_episode(episode_path(tmp_path, slot=i), slot=i, seed=i, frames=4 + i) for i in range(3)
    ]


def tree(root):
    return {p.relative_to(root): p.read_bytes() for p in sorted(root.rglob("*")) if p.is_file()}


def test_counts_agree_everywhere(tmp_path, episodes):
    out = tmp_path / "out"
    summary = run("lerobot", tmp_path, out, episodes)
    info = json.loads((out / "meta/info.json").read_text())
    data = pq.read_table(out / "data/chunk-000/file-000.parquet")
    assert summary["frames"] == info["total_frames"] == len(data) == 15
    assert (
        info["total_episodes"]
        == pq.read_metadata(out / "data/chunk-000/file-000.parquet").num_row_groups
        == 3
    )
    assert data["index"].to_pylist() == list(range(15))
    assert data["frame_index"].to_pylist() == [*range(4), *range(5), *range(6)]
    assert info["fps"] == 15 and type(info["fps"]) is int
    for camera in ("cam_high", "cam_left_wrist", "cam_right_wrist"):
        assert (
            len(list(frames_of(out / f"videos/observation.images.{camera}/chunk-000/file-000.mp4")))
            == 15
        )
    assert all(f["names"] for n, f in info["features"].items() if "." in n or n == "action")


def test_statistics_are_those_of_all_frames(tmp_path, episodes):
    out = tmp_path / "out"
    run("lerobot", tmp_path, out, episodes)
    stats = json.loads((out / "meta/stats.json").read_text())
    states = []
    for path in episodes:
        with open_episode(path) as e:
            states.append(e.array("joint_state/vector"))
    all_states = np.concatenate(states)
    entry = stats["observation.state"]
    np.testing.assert_allclose(entry["mean"], all_states.mean(0), atol=1e-6)
    np.testing.assert_allclose(entry["std"], all_states.std(0), atol=1e-6)
    np.testing.assert_allclose(
        entry["q90"], np.quantile(all_states, 0.9, axis=0, method="inverted_cdf"), atol=1e-6
    )
    info = json.loads((out / "meta/info.json").read_text())
    assert set(stats) == {
        n for n, f in info["features"].items() if f["dtype"] not in ("string", "language")
    }
    assert all(
        set(s) == {"min", "max", "mean", "std", "count", "q01", "q10", "q50", "q90", "q99"}
        for s in stats.values()
    )
    assert np.shape(stats[HEAD]["mean"]) == (3, 1, 1) and 0.4 < stats[HEAD]["mean"][0][0][0] < 0.55


def test_provenance_and_modality(tmp_path, episodes):
    out = tmp_path / "out"
    run("lerobot", tmp_path, out, episodes)
    rows = pq.read_table(out / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert [r["domino.slot"] for r in rows] == [0, 1, 2]
    assert (
        rows[1]["domino.T_meet"] == rows[1]["domino.t_meeting"] == pytest.approx(2 / 15)
        and rows[1]["domino.level"] == 1
        and rows[1]["domino.alpha"] == 0.1
    )
    assert rows[2]["domino.source"].endswith(
        "click_bell/aloha-agilex/L1/clean/episode_0000002.hdf5"
    )
    assert (
        rows[0]["domino.t_release"] == pytest.approx(2.4 / 15) and rows[0]["domino.arms"] == "left"
    )
    told = pq.read_table(out / "meta/domino_episodes.parquet").to_pylist()
    assert len(told[0]["instructions_seen"]) == 3 and told[0]["instruction"] == rows[0]["tasks"][0]
    modality = json.loads((out / "meta/modality.json").read_text())
    slices = {
        "left_joints": (0, 6),
        "left_gripper": (6, 7),
        "right_joints": (7, 13),
        "right_gripper": (13, 14),
    }
    for kind, key in (("state", "observation.state"), ("action", "action")):
        assert modality[kind] == {
            n: {"start": a, "end": b, "original_key": key} for n, (a, b) in slices.items()
        }
    assert modality["video"]["cam_left_wrist"] == {
        "original_key": "observation.images.cam_left_wrist"
    }


def test_workers_change_nothing(tmp_path, episodes):
    run("lerobot", tmp_path, tmp_path / "one", episodes)
    run("lerobot", tmp_path, tmp_path / "two", episodes, workers=2)
    assert tree(tmp_path / "one") == tree(tmp_path / "two")


@pytest.mark.parametrize(
    ("limits", "files"),
    [
        ({"data_bytes": 1}, [0, 1, 2]),
        ({"video_bytes": 1}, [0, 1, 2]),
        ({"video_seconds": 1}, [0, 0, 1]),
    ],
)
def test_data_and_videos_roll_over_together(tmp_path, limits, files):
    # 8 + 7 frames are a second
    paths = [make_episode(episode_path(tmp_path, slot=i), slot=i, frames=8 - i) for i in range(3)]
    out = tmp_path / "out"
    run("lerobot", tmp_path, out, paths, **limits)
    rows = pq.read_table(out / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert [row["data/file_index"] for row in rows] == files
    for camera in ("cam_high", "cam_left_wrist", "cam_right_wrist"):
        key = f"observation.images.{camera}"
        assert [row[f"videos/{key}/file_index"] for row in rows] == files
        assert len(list((out / "videos" / key).rglob("*.mp4"))) == files[-1] + 1
        starts = [0 if new else 8 / 15 for new in (True, files[1] == 1, True)]
        assert [row[f"videos/{key}/from_timestamp"] for row in rows] == pytest.approx(starts)
    assert len(list((out / "data").rglob("*.parquet"))) == files[-1] + 1


def test_poses_and_contacts_are_features(tmp_path, episodes):
    out = tmp_path / "out"
    run("lerobot", tmp_path, out, episodes[:1])
    data = pq.read_table(out / "data/chunk-000/file-000.parquet").to_pydict()
    with open_episode(episodes[0]) as e:
        tcp = np.concatenate(
            [e.array(f"endpose/{side}_endpose") for side in ("left", "right")], axis=1
        )
        np.testing.assert_array_equal(data["ee.pose"], tcp.astype(np.float32))
        for name, camera in (("cam_high", "head_camera"), ("cam_right_wrist", "right_camera")):
            np.testing.assert_array_equal(
                data[f"camera.{name}.pose"],
                e.array(f"observation/{camera}/pose").astype(np.float32),
            )
    # the synthetic log has one contact, of the target and the left hand, in frame 2 of 4
    assert data["contact.target"] == data["contact.manipulated"] == [[0, 0], [0, 0], [1, 0], [0, 0]]
    cameras = json.loads((out / "meta/domino.json").read_text())["cameras"]
    focal = 120 / np.tan(np.radians(37 / 2))  # D435: 240 pixels high, 37 degrees
    np.testing.assert_allclose(
        cameras["cam_high"]["intrinsic_cv"], [[focal, 0, 160], [0, focal, 120], [0, 0, 1]]
    )
    assert cameras["cam_high"]["link"] is None and cameras["cam_left_wrist"]["link"] == "left_hand"


def test_other_camera_names(tmp_path, episodes):
    out = tmp_path / "out"
    run("lerobot", tmp_path, out, episodes[:1], camera_names={"head_camera": "top"})
    assert sorted(p.name for p in (out / "videos").iterdir()) == [
        f"observation.images.{name}" for name in ("cam_left_wrist", "cam_right_wrist", "top")
    ]
    assert json.loads((out / "meta/modality.json").read_text())["video"]["top"] == {
        "original_key": "observation.images.top"
    }
    with pytest.raises(ExportError, match="--camera-names: there is no camera front"):
        run("lerobot", tmp_path, out, episodes, camera_names={"front": "top"})


def test_one_dataset_for_every_task_and_level(tmp_path, episodes):
    other = make_episode(
        episode_path(tmp_path, task="shake_bottle", level=2), task="shake_bottle", level=2, frames=3
    )
    out = tmp_path / "out"
    run("lerobot", tmp_path, out, [*episodes, other], per_task=True)
    index = json.loads((out / "index.json").read_text())
    assert [
        (row["path"], row["tasks"], row["levels"], row["episodes"], row["frames"]) for row in index
    ] == [
        ("aloha-agilex/L1/clean/click_bell", ["click_bell"], [1], 3, 15),
        ("aloha-agilex/L2/clean/shake_bottle", ["shake_bottle"], [2], 1, 3),
    ]
    for row in index:
        info = json.loads((out / row["path"] / "meta/info.json").read_text())
        assert info["total_episodes"] == row["episodes"]


def test_a_large_embodiment_gets_a_dataset_for_every_level(tmp_path, episodes, monkeypatch):
    other = make_episode(episode_path(tmp_path, level=2), level=2, frames=3)
    monkeypatch.setattr("pipeline.export.formats.lerobot.options.EPISODES_PER_DATASET", 3)
    assert {
        name: len(paths) for name, (_, paths) in datasets_of(episodes, tmp_path, False).items()
    } == {"aloha-agilex": 3}
    split = datasets_of([*episodes, other], tmp_path, False)
    assert {name: len(paths) for name, (_, paths) in split.items()} == {
        "aloha-agilex/L1": 3,
        "aloha-agilex/L2": 1,
    }


def test_embodiments_become_datasets_of_their_own(tmp_path, episodes):
    franka = make_episode(
        episode_path(tmp_path, "franka-panda"), embodiment="franka-panda", frames=3
    )
    out = tmp_path / "out"
    summary = run("lerobot", tmp_path, out, [*episodes, franka])
    assert summary["episodes"] == 4 and summary["embodiments"] == ["aloha-agilex", "franka-panda"]
    info = json.loads((out / "franka-panda/meta/info.json").read_text())
    assert (
        info["features"]["action"]["shape"] == [16]
        and len(info["features"]["action"]["names"]) == 16
    )
    assert info["robot_type"] == "franka-panda" and info["total_episodes"] == 1


def test_odd_pictures_are_refused(tmp_path, monkeypatch):
    from pipeline.data.cameras import CAMERA_TYPES, CameraType

    monkeypatch.setitem(CAMERA_TYPES, "odd", CameraType(321, 240, 37.0))
    path = make_episode(episode_path(tmp_path), frames=2, camera_type="odd")
    with pytest.raises(ExportError, match="must be even"):
        run("lerobot", tmp_path, tmp_path / "out", [path])


def test_an_unknown_codec_is_named_before_anything_is_read(tmp_path, episodes):
    with pytest.raises(ExportError, match="'gif' is not available: use h264, libsvtav1, hevc"):
        run("lerobot", tmp_path, tmp_path / "out", episodes, codec="gif")
    with pytest.raises(
        ExportError, match=r"h264 cannot encode .*nonsense.*: choose another --preset"
    ):
        run("lerobot", tmp_path, tmp_path / "out", episodes, codec="h264", preset="nonsense")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "options",
    [
        {"codec": "libsvtav1", "crf": 30, "gop": 2, "preset": "12"},
        {"codec": "h264", "crf": 23, "gop": 2},
    ],
)
def test_other_encoders(tmp_path, episodes, options):
    run("lerobot", tmp_path, tmp_path / "out", episodes, **options)
    info = json.loads((tmp_path / "out/meta/info.json").read_text())["features"][HEAD]["info"]
    assert (info["video.codec"], info["video.crf"], info["video.g"]) == (
        {"libsvtav1": "av1"}.get(options["codec"], options["codec"]),
        options["crf"],
        2,
    )
    for camera, name in (
        ("head_camera", HEAD),
        ("left_camera", "observation.images.cam_left_wrist"),
    ):
        sources = [image for path in episodes for image in frames(path, camera)]
        shown = list(frames_of(tmp_path / f"out/videos/{name}/chunk-000/file-000.mp4"))
        for t, ((time, image), source) in enumerate(zip(shown, sources, strict=True)):
            assert time == pytest.approx(t / 15) and np.abs(image.astype(int) - source).mean() < 3


def frames(path, camera):
    with open_episode(path) as e:
        return list(e.frames(camera))


@pytest.mark.parametrize("format", ["lerobot", "lerobot-v2.1"])
def test_episodes_end_so_long_after_the_success(tmp_path, episodes, format):
    whole, short = tmp_path / "whole", tmp_path / "short"
    run(format, tmp_path, whole, episodes)
    summary = run(format, tmp_path, short, episodes, after_success=-1 / 15)
    told, rows = (
        pq.read_table(out / "meta/domino_episodes.parquet").to_pylist() for out in (whole, short)
    )
    lengths = [min(row["length"], int(row["t_success"] * 15 + 1e-9)) for row in told]
    assert [row["length"] for row in rows] == lengths and sum(lengths) == summary["frames"] < 15
    first, cut = (
        pq.read_table(
            next((out / "data/chunk-000").iterdir()), filters=[("episode_index", "==", 0)]
        ).drop(["index"])
        for out in (whole, short)
    )
    assert cut == first.slice(0, lengths[0])
    video = min((short / "videos").rglob("*.mp4"))
    assert len(list(frames_of(video))) == (sum(lengths) if format == "lerobot" else lengths[0])
