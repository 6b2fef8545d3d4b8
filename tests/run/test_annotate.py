"""The promises of `annotate`: incremental, keyed by content, resumable, honest about what
failed."""

import dataclasses
import multiprocessing
import shutil
import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from pipeline.annotate.flow import Colour
from pipeline.annotate.options import AnnotateOptions, FlowOptions, MaskOptions, WorldOptions
from pipeline.annotate.stage import AnnotateError, Redraw
from pipeline.data.atomic import Busy, exclusive
from pipeline.data.cameras import Surfaces, world_poses
from pipeline.data.episode.file import open_episode
from pipeline.data.episode.world import BodyFacts, WorldTruth
from pipeline.data.errors import DominoError
from pipeline.data.slots.annotations import read_entry
from pipeline.run.annotate import annotate
from tests.synthetic import HALF, episode_path, make_episode, square_corner

OPTIONS = AnnotateOptions(flow=FlowOptions(stride=2))


def dataset(root: Path, slots: range = range(3), **extra: object) -> Path:
    for slot in slots:
        make_episode(
            episode_path(root, slot=slot),
            slot=slot,
            seed=slot,
            frames=6,
            cameras=("head_camera",),
            **extra,
        )
    return root


def tree(root: Path) -> dict[str, bytes]:
    return {
        str(p.relative_to(root)): p.read_bytes()
        for p in sorted((root / "annotations").rglob("*"))
        if p.is_file()
    }


def one(report: dict, name: str = "flow") -> dict:
    return next(s for s in report["stages"] if s["name"] == name)


def counts(report: dict, name: str = "flow") -> tuple[int, int, int]:
    s = one(report, name)
    return s["computed"], s["reused"], s["invalid"]


def test_second_run_computes_nothing_and_says_so(tmp_path: Path):
    dataset(tmp_path)
    assert counts(annotate(tmp_path, ["flow"], options=OPTIONS)) == (3, 0, 0)
    before = tree(tmp_path)
    report = annotate(tmp_path, ["flow"], options=OPTIONS)
    assert counts(report) == (0, 3, 0)
    assert one(report)["hit_rate"] == 1.0
    assert tree(tmp_path) == before


def test_two_at_once_are_refused_and_a_dry_run_is_not(tmp_path: Path):
    dataset(tmp_path, range(1))
    (tmp_path / "annotations").mkdir()
    with exclusive(tmp_path / "annotations"):
        with pytest.raises(Busy, match=r"/annotations: another command is writing it"):
            annotate(tmp_path, ["flow"], options=OPTIONS)
        assert counts(annotate(tmp_path, ["flow"], options=OPTIONS, dry_run=True)) == (1, 0, 0)
    assert tree(tmp_path) == {}
    with exclusive(tmp_path):  # a build
        assert counts(annotate(tmp_path, ["flow"], options=OPTIONS)) == (1, 0, 0)


def test_one_file_per_episode_indexed_by_absolute_frame(tmp_path: Path):
    dataset(tmp_path, range(1))
    directory = one(annotate(tmp_path, ["flow"], options=OPTIONS))["directory"]
    path = (
        tmp_path / "annotations" / directory / "click_bell/aloha-agilex/L1/clean/episode_0000000.h5"
    )
    arrays = read_entry(path).arrays
    assert arrays["flow"].shape == (6, 64, 64, 2) and arrays["flow"].dtype == np.float16
    assert arrays["rgb"].shape == (6, 64, 64, 3) and arrays["rgb"].dtype == np.uint8
    assert arrays["previous"].tolist() == [0, 0, 0, 1, 2, 3]
    assert (path.parents[4] / "stage.json").is_file()


def test_new_episodes_only_are_computed(tmp_path: Path):
    dataset(tmp_path, range(2))
    annotate(tmp_path, ["flow"], options=OPTIONS)
    dataset(tmp_path, range(2, 12))
    assert counts(annotate(tmp_path, ["flow"], options=OPTIONS)) == (10, 2, 0)


def test_moving_the_dataset_invalidates_nothing(tmp_path: Path):
    dataset(tmp_path / "a")
    annotate(tmp_path / "a", ["flow"], options=OPTIONS)
    shutil.move(tmp_path / "a", tmp_path / "b")
    assert counts(annotate(tmp_path / "b", ["flow"], options=OPTIONS)) == (0, 3, 0)


def test_deleting_one_file_recomputes_one_with_the_same_bytes(tmp_path: Path):
    dataset(tmp_path)
    annotate(tmp_path, ["flow"], options=OPTIONS)
    before = tree(tmp_path)
    next((tmp_path / "annotations").rglob("episode_0000001.h5")).unlink()
    assert counts(annotate(tmp_path, ["flow"], options=OPTIONS)) == (1, 2, 0)
    assert tree(tmp_path) == before


def test_corrupt_and_truncated_files_are_found_and_recomputed(tmp_path: Path):
    dataset(tmp_path)
    annotate(tmp_path, ["flow"], options=OPTIONS)
    before = tree(tmp_path)
    files = sorted((tmp_path / "annotations").rglob("*.h5"))
    with h5py.File(files[0], "r+") as f:
        f["flow"][3, 5, 5, 0] += np.float16(1)
    files[2].write_bytes(files[2].read_bytes()[:5000])
    assert counts(annotate(tmp_path, ["flow"], options=OPTIONS)) == (2, 1, 2)
    assert tree(tmp_path) == before


def test_changed_frames_make_an_entry_stale(tmp_path: Path):
    dataset(tmp_path)
    annotate(tmp_path, ["flow"], options=OPTIONS)
    make_episode(
        episode_path(tmp_path, slot=1), slot=1, seed=99, frames=6, cameras=("head_camera",)
    )
    report = annotate(tmp_path, ["flow"], options=OPTIONS, dry_run=True)
    assert counts(report) == (1, 2, 1)
    assert one(report)["plan"][0]["state"] == "stale"
    assert counts(annotate(tmp_path, ["flow"], options=OPTIONS)) == (1, 2, 1)


def test_dry_run_writes_nothing_and_says_why(tmp_path: Path):
    dataset(tmp_path)
    report = annotate(tmp_path, ["flow"], options=OPTIONS, dry_run=True)
    assert counts(report) == (3, 0, 0)
    assert {p["reason"] for p in one(report)["plan"]} == {"not annotated yet"}
    assert not (tmp_path / "annotations").exists()


def test_where_selects(tmp_path: Path):
    dataset(tmp_path)
    report = annotate(tmp_path, ["flow"], options=OPTIONS, where="slot>=1 and task=click_bell")
    assert (report["episodes"], counts(report)) == (2, (2, 0, 0))


def test_a_changed_parameter_goes_to_another_directory(tmp_path: Path):
    dataset(tmp_path)
    annotate(tmp_path, ["flow"], options=OPTIONS)
    before = tree(tmp_path)
    other = dataclasses.replace(OPTIONS, flow=FlowOptions(stride=2, colour=Colour("shared")))
    assert counts(annotate(tmp_path, ["flow"], options=other)) == (3, 0, 0)
    after = tree(tmp_path)
    assert {k: after[k] for k in before} == before
    assert counts(annotate(tmp_path, ["flow"], options=OPTIONS)) == (0, 3, 0)


def test_unreadable_episode_is_reported_and_the_rest_goes_on(tmp_path: Path):
    dataset(tmp_path)
    path = episode_path(tmp_path, slot=1)
    path.write_bytes(path.read_bytes()[:2000])
    s = one(annotate(tmp_path, ["flow"], options=OPTIONS))
    assert (s["computed"], s["failed"]) == (2, 1)
    assert "episode_0000001" in s["problems"][0] and "cannot be read" in s["problems"][0]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"stages": ["flwo"]}, "stage flwo is unknown: stages are flow, masks, features"),
        ({"stages": []}, "unknown"),
        ({"stages": ["flow"], "where": "levle=3"}, "'levle' is no column"),
        ({"stages": ["flow"], "where": "embodiment=aloha"}, "embodiment is aloha-agilex"),
    ],
)
def test_bad_arguments_get_one_line(tmp_path: Path, arguments: dict, words: str):
    dataset(tmp_path, range(1))
    with pytest.raises(DominoError, match=words) as caught:
        annotate(tmp_path, **arguments)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "annotations").exists()


def test_no_dataset_and_no_camera(tmp_path: Path):
    with pytest.raises(AnnotateError, match="is no dataset"):
        annotate(tmp_path / "nowhere", ["flow"])
    dataset(tmp_path, range(1))
    s = one(annotate(tmp_path, ["flow"], options=AnnotateOptions(cameras=("side_camera",))))
    assert s["failed"] == 1 and "has no camera side_camera: it has head_camera" in s["problems"][0]


def test_killed_midway_and_run_again_ends_with_the_same_bytes(tmp_path: Path):
    dataset(tmp_path / "a", range(30))
    shutil.copytree(tmp_path / "a", tmp_path / "b")
    annotate(tmp_path / "a", ["flow"], options=OPTIONS)
    process = multiprocessing.get_context("spawn").Process(
        target=annotate, args=(tmp_path / "b", ["flow"]), kwargs={"options": OPTIONS}
    )
    process.start()
    deadline = time.monotonic() + 30
    while len(list((tmp_path / "b").rglob("*.h5"))) < 3 and time.monotonic() < deadline:
        time.sleep(0.002)
    process.kill()
    process.join()
    done = len(list((tmp_path / "b").rglob("*.h5")))
    assert 3 <= done < 30
    computed, reused, _ = counts(annotate(tmp_path / "b", ["flow"], options=OPTIONS))
    assert (computed, reused) == (30 - done, done)
    assert tree(tmp_path / "a") == tree(tmp_path / "b")


def test_sim_flow_of_stored_truth_and_by_rendering_agree(tmp_path: Path):
    options = AnnotateOptions(flow=FlowOptions(source="sim", stride=1, size=(320, 240)))
    dataset(tmp_path / "stored", range(1), depth=True, segmentation=True)
    dataset(tmp_path / "plain", range(1))
    rendered: list[str] = []

    def render(path: Path, camera: str):
        from pipeline.data.episode.file import open_episode
        from tests.synthetic import make_view

        rendered.append(camera)
        with open_episode(path) as e:
            return make_view(camera, e.read().log, "D435", True, True)

    s = one(annotate(tmp_path / "plain", ["flow"], options=options))
    assert (
        s["failed"] == 1
        and "stores no actor_segmentation and depth of head_camera" in s["problems"][0]
    )
    results = []
    for name in ("stored", "plain"):
        s = one(annotate(tmp_path / name, ["flow"], options=options, redraw=Redraw(render)))
        assert s["computed"] == 1
        results.append(read_entry(next((tmp_path / name).rglob("*.h5"))).arrays["flow"])
    np.testing.assert_array_equal(*results)
    assert rendered == ["head_camera"]
    assert counts(
        annotate(tmp_path / "plain", ["flow"], options=options, redraw=Redraw(render))
    ) == (0, 1, 0)
    assert rendered == ["head_camera"]


def test_sim_flow_points_where_the_square_goes(tmp_path: Path):
    from pipeline.data.cameras import CAMERA_TYPES, Camera
    from tests.synthetic import head_pose, make_log

    dataset(tmp_path, range(1), depth=True, segmentation=True)
    options = AnnotateOptions(flow=FlowOptions(source="sim", stride=4, size=(320, 240)))
    annotate(tmp_path, ["flow"], options=options)
    flow = read_entry(next((tmp_path / "annotations").rglob("*.h5"))).arrays["flow"]
    log = make_log("aloha-agilex", 6, 15, 0)
    camera = Camera("head_camera", CAMERA_TYPES["D435"], None, head_pose())
    corners = [square_corner(camera, t, log.pose("target")) for t in (1, 5)]
    column, row = corners[0]
    inside = flow[5, row : row + 2 * HALF, column : column + 2 * HALF].astype(float)
    assert (flow[5, :row] == 0).all()
    # the image's square is placed on whole pixels and lies at a made-up depth of 0.85 m
    assert inside[..., 0].mean() == pytest.approx(corners[1][0] - corners[0][0], rel=0.3)
    assert abs(inside[..., 1]).max() < 0.5


def test_a_dry_run_needs_no_weights_and_downloads_none(tmp_path: Path, monkeypatch):
    dataset(tmp_path / "data")
    monkeypatch.setenv("HF_HUB_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(
        "socket.socket.connect", lambda *_: pytest.fail("a dry run asks the network")
    )
    options = AnnotateOptions(masks=MaskOptions(detector=str(tmp_path / "nowhere")))
    report = annotate(tmp_path / "data", options=options, dry_run=True)
    assert [counts(report, name) for name in ("flow", "masks", "features")] == [(3, 0, 0)] * 3
    assert "nowhere" in one(report, "masks")["plan"][0]["reason"]
    hub = annotate(tmp_path / "data", ["masks"], dry_run=True)
    assert "grounding-dino-tiny is not on this machine" in one(hub, "masks")["plan"][0]["reason"]
    assert not (tmp_path / "data" / "annotations").exists() and not (tmp_path / "cache").exists()
    with pytest.raises(AnnotateError, match="nowhere"):
        annotate(tmp_path / "data", ["masks"], options=options)


def test_the_stage_world_is_kept_by_what_it_was_made_from(tmp_path: Path):
    """It is made again if a pose changes, and only then; no other stage asks for it."""
    dataset(tmp_path, range(2))
    asked = list[str]()

    def truth(path: Path, camera: str) -> WorldTruth:
        asked.append(path.name)
        with open_episode(path) as e:
            log, seen = e.read().log, e.meta.drawing.cameras[camera].camera(camera)
        shape = (len(log), seen.type.height, seen.type.width)
        corners = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0.05]], np.float32)
        body = BodyFacts(corners, np.array([[0, 1, 2]], np.uint32), 0.3, None)
        surfaces = Surfaces(
            seen,
            world_poses(seen, {}, len(log)),
            np.ones(shape, np.float32),
            np.ones(shape, np.uint8),
            np.ones((*shape, 3), np.float16),
        )
        boxes, shares = np.zeros((len(log), 1, 4)), np.ones((len(log), 1))
        return WorldTruth({"target": body}, surfaces, ("target",), boxes, shares)

    def run() -> tuple[int, int, int]:
        options = AnnotateOptions(world=WorldOptions(points=5))
        report = annotate(tmp_path, ["world"], options=options, redraw=Redraw(truth=truth))
        return counts(report, "world")

    assert run() == (2, 0, 0) and run() == (0, 2, 0) and len(asked) == 2
    entry = read_entry(next(tmp_path.rglob("annotations/world@*/**/*.h5")))
    assert entry.attributes["mass"] == {"target": 0.3}
    np.testing.assert_allclose(entry.attributes["size"]["target"], [0.1, 0.1, 0.05])
    assert entry.arrays["tracks_XYZ"].shape == (6, 5, 3)
    path = next((tmp_path / "episodes").rglob(asked[0]))
    with h5py.File(path, "r+") as f:
        f["state/poses"][2, 0, 0] += 0.01
    assert run() == (1, 1, 1)
    assert annotate(tmp_path, ["world"])["stages"][0]["failed"] == 2
