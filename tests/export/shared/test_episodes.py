"""Whole exports or none, the order of episodes, bad input, and on which frame an event falls."""

import gc
from dataclasses import replace
from pathlib import Path

import av
import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.data.episode.events import DrawnEvent, by_role
from pipeline.data.episode.state_log import Event
from pipeline.data.errors import DominoError
from pipeline.data.spec import EpisodeSpec
from pipeline.export import EXPORTERS, ExportError
from pipeline.export.formats.parquet_table import event_frames
from pipeline.export.shared.episodes import (
    Facts,
    by_embodiment,
    choose_instruction,
    read_facts,
    reading,
    sort_episodes,
)
from tests.export.running import run
from tests.full_disk import longest_file
from tests.synthetic import episode_path, make_episode, make_log, make_meta, target_pose


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    """A dataset of two short episodes."""
    for slot in range(2):
        make_episode(episode_path(tmp_path, slot=slot), slot=slot, seed=slot, frames=4)
    return tmp_path


def episodes_of(dataset: Path) -> list[Path]:
    return sorted((dataset / "episodes").rglob("*.hdf5"))


def facts_with(times: list[float], frames: int, fps: int) -> Facts:
    log = make_log("aloha-agilex", frames, fps, 0)
    log.events = [Event(f"e{i}", t) for i, t in enumerate(times)]
    spec = EpisodeSpec("click_bell", "aloha-agilex", 1, 0.1, "clean", 0, 0)
    return Facts(
        "x",
        spec,
        fps,
        log,
        target_pose(log.times),
        "go",
        ["go"],
        [],
        "",
        make_meta(log, fps, []),
        (),
        (2, 2),
        {},
    )


@given(st.integers(2, 40), st.integers(1, 60), st.lists(st.floats(0, 1), max_size=5))
def test_an_event_is_on_the_first_frame_at_or_after_it(frames, fps, fractions):
    span = (frames - 1) / fps
    facts = facts_with([f * span for f in fractions], frames, fps)
    for frame, _, time in event_frames(facts):
        clock = [k / fps for k in range(frames)]
        assert frame == next(k for k, t in enumerate(clock) if t >= time - 1e-6)


def test_an_event_exactly_on_a_frame_belongs_to_it_and_a_late_one_to_the_last():
    facts = facts_with([3 / 15, 99.0], 12, 15)
    assert [(frame, name) for frame, name, _ in event_frames(facts)] == [(3, "e0"), (11, "e1")]


def test_instruction_depends_on_the_spec_only_and_uses_all_of_them():
    seen = ["a", "b", "c"]
    specs = [EpisodeSpec("t", "e", 1, 0.1, "clean", slot, 0) for slot in range(40)]
    chosen = [choose_instruction(s, seen) for s in specs]
    assert chosen == [choose_instruction(s, seen) for s in specs]
    assert set(chosen) == set(seen)


def test_order_is_that_of_the_paths_and_repeats_are_refused(dataset):
    paths = episodes_of(dataset)
    assert sort_episodes(paths[::-1]) == paths
    with pytest.raises(ExportError, match="given twice"):
        sort_episodes([paths[0], paths[0]])
    with pytest.raises(ExportError, match="no episodes"):
        sort_episodes([])


def test_embodiments_get_directories_only_when_there_are_several(dataset, tmp_path):
    out = tmp_path / "out"
    paths = episodes_of(dataset)
    assert by_embodiment(paths, out) == {"aloha-agilex": (out, paths)}
    franka = make_episode(
        episode_path(dataset, "franka-panda"), embodiment="franka-panda", frames=3
    )
    assert by_embodiment([*paths, franka], out) == {
        "aloha-agilex": (out / "aloha-agilex", paths),
        "franka-panda": (out / "franka-panda", [franka]),
    }


def bytes_of(out: Path) -> dict[Path, bytes]:
    return {p.relative_to(out): p.read_bytes() for p in out.rglob("*") if p.is_file()}


@pytest.mark.parametrize("format", sorted(EXPORTERS))
def test_the_same_episodes_give_the_same_bytes_and_a_failing_export_leaves_the_old_one_and_nothing_else(  # noqa: E501
    dataset, format
):
    paths, done = episodes_of(dataset), []
    first, second = dataset / "exports" / "a", dataset / "exports" / "b"
    summary = run(format, dataset, first, paths[::-1], progress=done.append)
    assert sum(done) == summary["episodes"] == 2
    assert summary["frames"] == 8 and summary["format"] == format
    run(format, dataset, second, paths)
    before = bytes_of(first)
    assert before.keys() == bytes_of(second).keys()
    assert [file for file in before if (second / file).read_bytes() != before[file]] == []

    def fail(_: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(format, dataset, first, paths, progress=fail)
    assert bytes_of(first) == before
    assert sorted(p.name for p in first.parent.iterdir()) == ["a", "b"]


def _truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def _change(key: str, value):
    def change(path: Path) -> None:
        with h5py.File(path, "r+") as f:
            del f[key]
            if value is not None:
                f[key] = value

    return change


BROKEN = {
    "truncated": (_truncate, "cannot be read as HDF5"),
    "empty": (lambda p: p.write_bytes(b""), "cannot be read as HDF5"),
    "no pictures": (
        _change("observation/head_camera/rgb", None),
        "has no observation/head_camera/rgb",
    ),
    "no picture": (
        _change("observation/head_camera/rgb", np.array([b"no jpeg"] * 4)),
        "does not decode as JPEG",
    ),
    "off the grid": (_change("timestamp", np.array([0, 0.06, 0.12, 0.18])), "not 15 per second"),
    "short action": (
        _change("joint_action/vector", np.zeros((3, 14))),
        "action has 3 rows for 4 frames",
    ),
    "not finite": (
        _change("target/pose", np.full((4, 7), np.nan)),
        "target/pose holds values that are not finite",
    ),
    "speechless": (
        _change("instruction/seen", np.array([], h5py.string_dtype())),
        "has no instruction",
    ),
    "blind for a frame": (
        _change("observation/head_camera/pose", np.zeros((3, 7))),
        "head_camera has 3 images",
    ),
}


@pytest.mark.parametrize("name", sorted(BROKEN))
def test_a_bad_episode_gives_one_line_that_names_it(dataset, name):
    path = episodes_of(dataset)[1]
    spoil, message = BROKEN[name]
    spoil(path)
    with pytest.raises(ExportError, match=message) as error, reading(path) as file:
        read_facts(file, dataset)
    assert str(path) in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("format", sorted(EXPORTERS))
def test_a_bad_episode_stops_the_export(dataset, format):
    _truncate(episodes_of(dataset)[1])
    with pytest.raises(ExportError, match="episode_0000001"):
        run(format, dataset, dataset / "exports" / format, episodes_of(dataset))
    assert not (dataset / "exports").exists()


@pytest.mark.parametrize("format", sorted(EXPORTERS))
def test_a_full_disk_is_one_line_that_blames_no_episode_and_leaves_nothing(dataset, format, capfd):
    av.logging.set_level(None)  # lerobot, in an earlier test of this process, lets FFmpeg print
    out, episodes = dataset / "exports" / format, episodes_of(dataset)
    run(format, dataset, out, episodes)
    largest = max(path.stat().st_size for path in out.rglob("*"))
    before = bytes_of(out)
    for size in (0, largest // 2, largest - 1):
        with (
            pytest.raises(ExportError, match=r"cannot be written: .*large") as refused,
            longest_file(size),
        ):
            # elsewhere: what stands there would lend its files
            run(format, dataset, dataset / "elsewhere" / format, episodes)
        assert "episode_0" not in str(refused.value) and "\n" not in str(refused.value)
        assert not (dataset / "elsewhere").exists()
    gc.collect()
    assert capfd.readouterr() == ("", "")
    assert bytes_of(out) == before


@pytest.mark.parametrize("format", sorted(EXPORTERS))
def test_an_episode_of_one_frame_is_exported(tmp_path, format):
    path = make_episode(episode_path(tmp_path), frames=1)
    out = tmp_path / "exports" / format
    assert run(format, tmp_path, out, [path])["frames"] == 1


@pytest.mark.parametrize("format", sorted(EXPORTERS))
def test_episodes_that_do_not_fit_together_are_refused(dataset, format):
    make_episode(episode_path(dataset, slot=2), slot=2, frames=3, fps=30)
    if format == "parquet":
        make_episode(
            episode_path(dataset, "franka-panda"), embodiment="franka-panda", frames=3, fps=30
        )
    with pytest.raises(ExportError, match=r"fps 30 differs from 15 of"):
        run(format, dataset, dataset / "exports" / format, episodes_of(dataset))


@pytest.mark.parametrize("name", sorted(EXPORTERS))
def test_an_episode_that_names_a_path_is_refused_and_nothing_is_written(dataset, tmp_path, name):
    path = episodes_of(dataset)[0]
    with h5py.File(path, "r+") as f:
        f.attrs["spec"] = f.attrs["spec"].replace("aloha-agilex", "../../x")
    before = sorted(p for p in tmp_path.rglob("*"))
    with pytest.raises(DominoError, match=r"episode_0000000\.hdf5.*embodiment '\.\./\.\./x'"):
        run(name, dataset, dataset / "exports" / name, episodes_of(dataset))
    after = [p for p in sorted(tmp_path.rglob("*")) if p not in before]
    assert not [p for p in after if p.is_file()]
    assert not (tmp_path.parent / "x").exists()


def test_from_an_exchange_on_a_frame_has_the_new_instruction_and_target(tmp_path):
    spoken = {"seen": ["the red one"], "unseen": ["red"], "seen_after": ["the blue one"]}
    path = make_episode(episode_path(tmp_path), frames=8, instructions=spoken)
    with reading(path) as file:
        facts = read_facts(file, tmp_path)
        assert file.read().instructions == spoken
    drawn = DrawnEvent(name="swap", kind="swap", trigger="time", value=0.1, body="other")
    log = replace(facts.log, events=[Event("event", 2 / 15, "swap")])
    assert set(facts.spoken) == {"the red one"}
    meta = facts.meta.model_copy(update={"events": (drawn,)})
    facts = replace(facts, log=log, meta=meta)
    assert facts.spoken == ["the red one"] * 3 + ["the blue one"] * 5
    assert facts.told == ["the red one", "the blue one"]
    assert replace(facts, kept=3).told == ["the red one"]
    asked = by_role(log, meta.events, "target")
    assert (asked.pose("target")[:3] == log.pose("target")[:3]).all()
    assert (asked.pose("target")[3:] == log.pose("other")[3:]).all()
    assert (asked.pose("left_hand") == log.pose("left_hand")).all()
    pairs = [(int(row["a"]), int(row["b"])) for row in (log.contacts[0], asked.contacts[0])]
    assert [[log.bodies[i] for i in pair] for pair in pairs] == [
        ["target", "left_hand"],
        ["other", "left_hand"],
    ]
