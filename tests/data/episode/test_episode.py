"""The episode file: what goes in comes out, bytes depend on nothing else, damage is named."""

import io
import json
import time
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from pipeline.data.episode import writer as module
from pipeline.data.episode.file import Episode, EpisodeError, EpisodeFile, open_episode
from pipeline.data.episode.frames import decode_frame, encode_frames, stated_size
from pipeline.data.episode.writer import write_episode
from pipeline.data.names import is_embodiment, is_name
from pipeline.data.spec import EpisodeSpec
from tests.synthetic import CAMERAS, COLORS, make_episode, make_log, make_meta, make_view


@pytest.fixture
def made():
    log = make_log("aloha-agilex", 5, 15, 3)
    text = {"seen": ["Ring the bell.", "Läute!"], "unseen": ["Tap it."]}
    spec = EpisodeSpec("click_bell", "aloha-agilex", 2, 0.1, "clean", 4, 2**62)
    views = [make_view(name, log, "D435", True, True) for name in CAMERAS]
    meta = make_meta(log, 15, views, objects={"target": {"noun": "Glöckchen"}, "other": {}})
    return Episode(spec, log, '{"a": 1}', text, meta), views


def test_everything_that_is_written_is_read(tmp_path, made):
    episode, views = made
    path = tmp_path / "deep" / "e.hdf5"
    write_episode(path, episode, views)
    with open_episode(path) as file:
        back = file.read()
        assert (back.spec, back.motion, back.meta) == (episode.spec, episode.motion, episode.meta)
        assert back.instructions == episode.instructions
        assert file.instructions("unseen") == ["Tap it."]
        assert file.cameras == back.cameras == tuple(sorted(CAMERAS))
        assert (len(file), file.fps) == (5, 15)
        for key, value in vars(episode.log).items():
            if isinstance(value, np.ndarray):
                got = getattr(back.log, key)
                assert (got.dtype, got.shape, got.tobytes()) == (
                    value.dtype,
                    value.shape,
                    value.tobytes(),
                ), key
            else:
                assert getattr(back.log, key) == value, key
        for view in views:
            group = f"observation/{view.camera.name}"
            np.testing.assert_array_equal(file.array(f"{group}/depth"), view.depth)
            np.testing.assert_array_equal(
                file.array(f"{group}/actor_segmentation"), view.segmentation
            )
            np.testing.assert_array_equal(file.array(f"{group}/pose"), view.poses)
    assert [p.name for p in path.parent.iterdir()] == ["e.hdf5"]


def test_what_is_not_what_was_written_is_named(tmp_path, made):
    episode, views = made
    path = tmp_path / "e.hdf5"
    write_episode(path, episode, views)
    whole = path.read_bytes()

    def damaged(change):
        path.write_bytes(whole)
        with h5py.File(path, "r+") as f:
            change(f)
        with open_episode(path) as file:
            return file.damaged()

    def replaced(key, change):
        def do(f):
            values = change(f[key][()])
            del f[key]
            f[key] = values

        return do

    assert damaged(lambda f: None) == []
    with h5py.File(path) as f:
        arrays = {}
        f.visititems(
            lambda name, found: (
                arrays.update({name: found[()]}) if isinstance(found, h5py.Dataset) else None
            )
        )
    turned = [
        name
        for name, values in arrays.items()
        if np.ndim(values) and values[::-1].tobytes() != values.tobytes()
    ]
    assert len(turned) > 30
    assert {name: damaged(replaced(name, lambda values: values[::-1])) for name in turned} == {
        name: [name] for name in turned
    }
    assert damaged(replaced("events", lambda _: "[]")) == ["events"]
    assert damaged(lambda f: f.pop("state/qpos")) == ["state/qpos"]
    for attributes in (lambda f: f.attrs, lambda f: f["joint_state"].attrs):
        assert damaged(lambda f, of=attributes: of(f).update({next(iter(of(f))): "x"})) == [
            "header"
        ]


def test_arrays_of_the_interception_group_come_back_by_key(tmp_path, made):
    episode, views = made
    arrays = {
        "planned_time": np.array(2.5),
        "conditions/held": np.array([True, False]),
        "tracks/head_camera/box": np.ones((2, 1, 4)),
    }
    write_episode(tmp_path / "e.hdf5", replace(episode, interception=arrays), views)
    with open_episode(tmp_path / "e.hdf5") as file:
        back = file.interception()
    assert set(back) == set(arrays)
    assert all(
        np.array_equal(back[key], values) and back[key].dtype == values.dtype
        for key, values in arrays.items()
    )


def test_arms_and_grippers_are_columns_of_the_vector(tmp_path):
    with h5py.File(make_episode(tmp_path / "e.hdf5", embodiment="franka-panda", frames=4)) as f:
        for group in ("joint_action", "joint_state"):
            parts = [f[f"{group}/left_arm"][()], f[f"{group}/left_gripper"][()][:, None]]
            parts += [f[f"{group}/right_arm"][()], f[f"{group}/right_gripper"][()][:, None]]
            np.testing.assert_array_equal(np.hstack(parts), f[f"{group}/vector"][()])


def test_frames_are_true_rgb_for_another_decoder(tmp_path, made):
    episode, views = made
    write_episode(tmp_path / "e.hdf5", episode, views)
    with EpisodeFile(tmp_path / "e.hdf5") as file:
        for view in views:
            ours = list(file.frames(view.camera.name))
            for t, rgb in enumerate(view.rgb):
                with Image.open(io.BytesIO(file.jpeg(view.camera.name, t))) as image:
                    assert (image.format, image.mode, image.size) == ("JPEG", "RGB", (320, 240))
                    theirs = np.asarray(image).astype(int)
                marked = (rgb == COLORS[view.camera.name]).all(-1)
                if marked.sum() > 200:
                    np.testing.assert_allclose(
                        np.median(theirs[marked], axis=0), COLORS[view.camera.name], atol=12
                    )
                assert np.abs(theirs - rgb).mean() < 3
                assert np.abs(theirs - ours[t]).max() <= 3
                np.testing.assert_array_equal(file.rgb(view.camera.name, t), ours[t])
            assert file.size(view.camera.name) == ours[0].shape[:2]


def test_a_size_is_that_of_a_whole_header_and_not_too_large():
    header = bytes(encode_frames(np.zeros((1, 16, 40, 3), np.uint8))[0])
    assert stated_size(header) == (40, 16)
    at = header.index(b"\xff\xc0") + 5
    for wrong, said in (
        (header[:at], "does not decode"),
        (header[:at] + b"\xff\xff" + header[at + 2 :], "65535 pixels"),
    ):
        with pytest.raises(EpisodeError, match=said):
            stated_size(wrong)


def test_the_same_episode_gives_the_same_bytes_at_another_time(tmp_path, made):
    write_episode(tmp_path / "a.hdf5", *made)
    time.sleep(1.1)  # HDF5 keeps times in whole seconds
    write_episode(tmp_path / "b.hdf5", *made)
    assert (tmp_path / "a.hdf5").read_bytes() == (tmp_path / "b.hdf5").read_bytes()


def test_a_write_that_fails_leaves_nothing(tmp_path, monkeypatch, made):
    def full(*_: object):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(module, "_write_view", full)
    with pytest.raises(OSError, match="space"):
        write_episode(tmp_path / "e.hdf5", *made)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("keep", [0, 100, 0.3, 0.9])
def test_a_truncated_file_is_named(tmp_path, keep):
    path = make_episode(tmp_path / "e.hdf5", frames=3)
    data = path.read_bytes()
    path.write_bytes(data[: keep if isinstance(keep, int) else int(keep * len(data))])
    with pytest.raises(EpisodeError, match=r"e\.hdf5.*run the build again"):
        EpisodeFile(path)


def test_other_files_are_refused(tmp_path):
    with pytest.raises(EpisodeError, match="missing"):
        EpisodeFile(tmp_path / "missing.hdf5")
    with h5py.File(tmp_path / "other.hdf5", "w") as f:
        f["x"] = 1
    with pytest.raises(EpisodeError, match="schema"):
        EpisodeFile(tmp_path / "other.hdf5")
    with (
        EpisodeFile(make_episode(tmp_path / "e.hdf5", frames=2)) as file,
        pytest.raises(EpisodeError, match="no nothing"),
    ):
        file.array("nothing")
    for data in (b"", b"\xff\xd8 not a image"):
        with pytest.raises(EpisodeError, match="JPEG"):
            decode_frame(data)


@pytest.mark.parametrize(
    ("attribute", "values", "said"),
    [
        ("spec", {"embodiment": "../../x"}, "embodiment"),
        ("spec", {"task": "a/b"}, "task"),
        ("spec", {"task": ""}, "task"),
        ("spec", {"level": 12}, "level"),
        ("spec", {"more": 1}, "spec"),
        ("meta", {"target": "../../x"}, "target"),
        ("meta", {"objects": {"/etc": {}}}, "objects"),
        ("meta", {"fps": 0}, "fps"),
        ("meta", {"fps": "often"}, "fps"),
        ("meta", {"note": 1}, "note"),
        ("meta", {"arms": {"arm": "middle"}}, "arms"),
    ],
)
def test_a_header_that_cannot_be_is_refused_and_the_file_named(tmp_path, attribute, values, said):
    path = make_episode(tmp_path / "e.hdf5", frames=2)
    with h5py.File(path, "r+") as f:
        f.attrs[attribute] = json.dumps(json.loads(f.attrs[attribute]) | values)
    with EpisodeFile(path) as file, pytest.raises(EpisodeError, match=rf"e\.hdf5.*{said}") as error:
        file.read()
    assert "\n" not in str(error.value)


@given(st.text(alphabet="ab./\\_-+\0 ~", max_size=12))
def test_a_name_is_never_a_path(text):
    for check in (is_name, is_embodiment):
        if check(text):
            assert Path("/x", text).parent == Path("/x") and text.strip(" .~") == text != ""
