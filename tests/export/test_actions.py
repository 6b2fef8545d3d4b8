"""What an action is, chosen by options: the same numbers in every format, and statistics as lerobot
makes them."""

import json
from dataclasses import replace
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pipeline.data.actions import ACTIONS, ActionCodec, Representation
from pipeline.data.chains import read_chains
from pipeline.data.episode.file import open_episode
from pipeline.export import ExportError, parse_options
from pipeline.export.formats.lerobot.options import LerobotOptions
from pipeline.export.formats.tfrecord import example
from tests.export.running import run
from tests.synthetic import episode_path, make_episode

FRAMES = 6
WORDS: dict[str, Any] = {"actions": "ee-relative", "rotation": "6d"}
ARMS = read_chains("aloha-agilex")


def as_recorded(path):
    """Move the measured tools of a synthetic episode to where its joints put them."""
    f: Any
    with h5py.File(path, "r+") as f:
        state = f["joint_state/vector"][()]
        for side, at in (("left", 0), ("right", 7)):
            f[f"endpose/{side}_endpose"][...] = ARMS[side].poses(state[:, at : at + 6])
    return path


@pytest.fixture
def episode(tmp_path):
    return as_recorded(make_episode(episode_path(tmp_path), frames=FRAMES))


def expected(path, representation):
    with open_episode(path) as e:
        log = e.read().log
    codec = ActionCodec(representation, log.vector_names, ARMS)
    rows = codec.encode(log.action, codec.references(log.action, log.state))
    return codec.names, rows.astype(np.float32)


def written(format, out):
    """The actions (T,D) of an export of one episode."""
    if format.startswith("lerobot"):
        (file,) = out.glob("data/*/*.parquet")
        return np.stack(pq.read_table(file)["action"].to_pylist())
    if format == "parquet":
        return np.stack(pq.read_table(out / "data-00000.parquet")["action"].to_pylist())
    if format in ("aloha", "robomimic"):
        file = out / ("episode_0.hdf5" if format == "aloha" else "demos/demo_0.hdf5")
        f: Any
        with h5py.File(file) as f:
            return f["action" if format == "aloha" else "actions"][()]
    if format == "zarr":
        folder = out / "replay_buffer.zarr/data/action"
        shape = json.loads((folder / ".zarray").read_text())["shape"]
        data = pa.input_stream(folder / "0.0", compression="zstd").read()
        return np.frombuffer(data, np.float32).reshape(-1, shape[1])[: shape[0]]
    raise AssertionError(format)


@pytest.mark.parametrize("format", ["lerobot", "lerobot-v2.1", "parquet", "aloha", "robomimic"])
def test_every_format_holds_the_same_actions(tmp_path, episode, format):
    out = tmp_path / "out"
    # only robomimic also holds absolute poses, which have a frame
    words = WORDS | ({"frame": "base"} if format == "robomimic" else {})
    summary = run(format, tmp_path, out, [episode], **words)
    names, rows = expected(episode, Representation(**words))
    np.testing.assert_array_equal(written(format, out), rows)
    assert "relative to the measured state" in summary["action"]
    assert summary["options"]["actions"] == "ee-relative"
    if format.startswith("lerobot"):
        info = json.loads((out / "meta/info.json").read_text())
        assert info["features"]["action"]["names"] == list(names)
        assert info["features"]["action"]["shape"] == [20]
        part = json.loads((out / "meta/modality.json").read_text())["action"]
        assert part["left_position"] == {
            **{"start": 0, "end": 3, "absolute": False, "original_key": "action"}
        }
        assert part["right_gripper"]["absolute"]
    if format == "robomimic":
        absolute = expected(episode, Representation("ee", "6d", "base"))[1]
        f: Any
        with h5py.File(out / "demos/demo_0.hdf5") as f:
            np.testing.assert_array_equal(f["abs_actions"][()], absolute)
            assert f.attrs["action_names"].tolist() == list(names)


@pytest.mark.parametrize("format", ["zarr", "robomimic"])
@pytest.mark.parametrize("actions", ACTIONS)
def test_zarr_and_robomimic_hold_every_representation(tmp_path, episode, format, actions):
    rotation = "axis-angle" if actions.startswith("ee") else "quaternion"
    out, words = tmp_path / "out", Representation(actions, rotation)
    run(format, tmp_path, out, [episode], actions=actions, rotation=rotation, size=(12, 16))
    rows = expected(episode, words)[1]
    np.testing.assert_array_equal(written(format, out), rows)
    if format == "robomimic":
        f: Any
        with h5py.File(out / "demos/demo_0.hdf5") as f:
            assert ("abs_actions" in f) == (words.reference != "absolute")
            if "abs_actions" in f:
                absolute = expected(episode, replace(words, actions=words.kind))[1]
                np.testing.assert_array_equal(f["abs_actions"][()], absolute)


def test_a_lerobot_dataset_holds_further_representations(tmp_path, episode):
    out = tmp_path / "out"
    more = ("ee", "joints-delta")
    run("lerobot", tmp_path, out, [episode], more_actions=more, rotation="axis-angle")
    info = json.loads((out / "meta/info.json").read_text())["features"]
    (file,) = out.glob("data/*/*.parquet")
    table = pq.read_table(file)
    stats = json.loads((out / "meta/stats.json").read_text())
    for feature, words in {"action": "joints", **{f"action.{name}": name for name in more}}.items():
        names, rows = expected(episode, Representation(words, "axis-angle"))
        assert info[feature]["names"] == list(names)
        np.testing.assert_array_equal(np.stack(table[feature].to_pylist()), rows)
        np.testing.assert_allclose(stats[feature]["max"], rows.max(0))


def test_rlds_steps_hold_the_actions(tmp_path, episode):
    out = tmp_path / "out"
    run("rlds", tmp_path, out, [episode], **WORDS)
    (folder,) = out.glob("domino_*/1.0.0")
    step = json.loads((folder / "features.json").read_text())["featuresDict"]["features"]["steps"]
    shape = step["sequence"]["feature"]["featuresDict"]["features"]["action"]["tensor"]["shape"]
    assert shape == {"dimensions": ["20"]}
    rows = expected(episode, Representation(**WORDS))[1]
    packed = example({"steps/action": rows.ravel()})
    numbers = rows.ravel().tobytes()
    (record,) = folder.glob("*.tfrecord-*")
    assert numbers in packed
    assert numbers in record.read_bytes()


def test_joint_targets_are_what_nobody_chose(tmp_path, episode):
    summary = run("aloha", tmp_path, tmp_path / "out", [episode])
    assert "action" not in summary
    assert not {"actions", "rotation", "frame"} & set(summary["options"])
    np.testing.assert_array_equal(
        written("aloha", tmp_path / "out"), expected(episode, Representation())[1]
    )


def test_an_episode_of_another_robot_is_refused(tmp_path):
    path = make_episode(episode_path(tmp_path), frames=FRAMES)  # its tools are not its joints'
    with pytest.raises(ExportError, match="another aloha-agilex than the one installed"):
        run("aloha", tmp_path, tmp_path / "out", [path], actions="ee")
    run("aloha", tmp_path, tmp_path / "out", [path], actions="joints-delta")


def test_unknown_words_are_refused():
    with pytest.raises(ExportError, match="--actions"):
        parse_options("lerobot", LerobotOptions, {"actions": "poses"})
    options = parse_options("lerobot", LerobotOptions, {"actions": "ee", "rotation": "axis-angle"})
    assert options.representation == Representation("ee", "axis-angle")


def test_statistics_are_those_of_lerobot(tmp_path, episode):
    """joints-relative as `recompute_stats` counts relative actions of one step; ee-delta as it
    counts any action."""
    pytest.importorskip("lerobot")
    from lerobot.datasets.dataset_tools import recompute_stats
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    def ours(name, **words):
        run("lerobot", tmp_path, tmp_path / name, [episode], **words)
        return json.loads((tmp_path / name / "meta/stats.json").read_text())["action"]

    def theirs(name, **options):
        data = LeRobotDataset("x/y", root=tmp_path / name)
        stats: Any = recompute_stats(data, **options).meta.stats
        return stats["action"]

    relative = ours("relative", actions="joints-relative")
    ours("joints")
    delta = ours("delta", actions="ee-delta", rotation="axis-angle")
    counted = theirs("joints", relative_action=True, chunk_size=1)
    for ours_, theirs_ in ((relative, counted), (delta, theirs("delta"))):
        for name in ("min", "max", "mean", "std"):
            np.testing.assert_allclose(ours_[name], theirs_[name], atol=2e-6, err_msg=name)
