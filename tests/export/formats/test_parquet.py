"""Flat Parquet: every column against the episode, read by pyarrow, pandas and Hugging Face
datasets."""

import json

import cv2
import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pipeline.annotate.networks.masks import pack
from pipeline.annotate.stage import encoded_frames, frames_inputs, sim_reading
from pipeline.annotate.store import write_entry, write_stage
from pipeline.data.cameras import project
from pipeline.data.episode.file import open_episode
from pipeline.data.imperfections import Sensors
from pipeline.data.slots.annotations import Entry, annotation_path
from pipeline.export import ExportError
from pipeline.export.shared.annotations import stale
from pipeline.export.shared.episodes import read_facts
from tests.export.running import check_export, run
from tests.synthetic import COLORS, episode_path, make_episode


@pytest.fixture
def episodes(tmp_path):
    """Two episodes of 14 values and one of 16."""
    wide = make_episode(
        episode_path(tmp_path, "franka-panda"), embodiment="franka-panda", frames=3, level=3
    )
    return [
        wide,
        *(
            make_episode(episode_path(tmp_path, slot=i), slot=i, seed=i, frames=5 + i)
            for i in range(2)
        ),
    ]


def test_every_frame_is_a_row_with_its_own_values(tmp_path, episodes):
    out = tmp_path / "out"
    summary = run("parquet", tmp_path, out, episodes)
    assert (
        summary["embodiments"] == ["aloha-agilex", "franka-panda"]
        and summary["frames"] == 3 + 5 + 6
    )
    table = pq.read_table(out / "data-00000.parquet")
    assert len(table) == 14
    assert pq.read_metadata(out / "data-00000.parquet").num_row_groups == 3
    for index, path in enumerate(sorted(episodes)):
        rows = table.filter(pa.compute.equal(table["episode_index"], index)).to_pylist()
        with open_episode(path) as e:
            assert [r["frame_index"] for r in rows] == list(range(len(e)))
            np.testing.assert_allclose(
                [r["timestamp"] for r in rows], np.arange(len(e)) / 15, atol=1e-12
            )
            for column, key in (
                ("state", "joint_state/vector"),
                ("action", "joint_action/vector"),
                ("target_pose", "target/pose"),
            ):
                np.testing.assert_array_equal(
                    np.array([r[column] for r in rows], np.float32), e.array(key).astype(np.float32)
                )
            np.testing.assert_array_equal(
                np.array([r["tcp_right"] for r in rows], np.float32),
                e.array("endpose/right_endpose").astype(np.float32),
            )
            for column, camera in (
                ("image_cam_high", "head_camera"),
                ("image_cam_left_wrist", "left_camera"),
            ):
                assert [r[column]["bytes"] for r in rows] == [
                    e.jpeg(camera, t) for t in range(len(e))
                ]
            assert {r["instruction"] for r in rows} <= set(e.instructions())
            assert {(r["task"], r["level"], r["slot"]) for r in rows} == {
                (e.spec.task, e.spec.level, e.spec.slot)
            }
        assert [r["is_first"] for r in rows] == [True] + [False] * (len(rows) - 1)
        assert [r["is_last"] for r in rows] == [False] * (len(rows) - 1) + [True]


def test_events_are_on_their_frames(tmp_path):
    path = make_episode(episode_path(tmp_path), frames=12)
    run("parquet", tmp_path, tmp_path / "out", [path])
    rows = pq.read_table(tmp_path / "out" / "data-00000.parquet").to_pylist()
    # the synthetic release is 0.4 of a frame after the meeting at frame 6
    assert {r["frame_index"]: r["events"] for r in rows if r["events"]} == {
        6: ["meeting"],
        7: ["release"],
        11: ["success"],
    }
    assert rows[7]["event_times"] == [pytest.approx(6.4 / 15)]


def test_metadata_names_the_joints_of_each_embodiment(tmp_path, episodes):
    run("parquet", tmp_path, tmp_path / "out", episodes)
    domino = json.loads(pq.read_schema(tmp_path / "out" / "data-00000.parquet").metadata[b"domino"])
    assert domino["fps"] == 15
    assert {name: len(names) for name, names in domino["names"].items()} == {
        "aloha-agilex": 14,
        "franka-panda": 16,
    }
    rows = pq.read_table(tmp_path / "out" / "episodes.parquet").to_pylist()
    assert [r["length"] for r in rows] == [5, 6, 3] and len(rows[0]["instructions_seen"]) == 3


def test_files_roll_over_and_stay_in_order(tmp_path, episodes):
    out = tmp_path / "out"
    assert run("parquet", tmp_path, out, episodes, file_bytes=1)["files"] == 3
    assert [p.name for p in sorted(out.glob("data-*"))] == [
        f"data-0000{i}.parquet" for i in range(3)
    ]
    assert pq.read_table(sorted(out.glob("data-*"))[1])["episode_index"].to_pylist() == [1] * 6


def test_hugging_face_datasets_and_pandas_read_it_offline(tmp_path, episodes, monkeypatch):
    datasets = pytest.importorskip("datasets")
    monkeypatch.setattr(datasets.config, "HF_DATASETS_CACHE", tmp_path / "cache")
    monkeypatch.setattr(datasets.config, "HF_HUB_OFFLINE", True)
    run("parquet", tmp_path, tmp_path / "out", episodes)
    loaded = datasets.load_dataset(str(tmp_path / "out"), split="train")
    assert len(loaded) == 14
    assert [
        row["length"]
        for row in datasets.load_dataset(str(tmp_path / "out"), "episodes", split="train")
    ] == [5, 6, 3]
    picture = np.asarray(loaded[0]["image_cam_high"])
    assert 1200 < (np.abs(picture.astype(int) - COLORS["head_camera"]).max(-1) < 25).sum() <= 1700
    frame = loaded.to_pandas()
    assert frame["state"].map(len).tolist() == [14] * 11 + [16] * 3


def test_jpeg_bytes_are_true_rgb(tmp_path, episodes):
    run("parquet", tmp_path, tmp_path / "out", episodes)
    row = pq.read_table(tmp_path / "out" / "data-00000.parquet").slice(0, 1).to_pylist()[0]
    rgb = cv2.imdecode(
        np.frombuffer(row["image_cam_right_wrist"]["bytes"], np.uint8), cv2.IMREAD_COLOR
    )[..., ::-1]
    assert (np.abs(rgb.astype(int) - COLORS["right_camera"]).max(-1) < 25).sum() > 1200


def test_tracks_contacts_and_physics_steps_are_those_of_the_log(tmp_path, episodes):
    run("parquet", tmp_path, tmp_path / "out", episodes)
    rows = pq.read_table(
        tmp_path / "out" / "data-00000.parquet", filters=[("episode_index", "=", 1)]
    ).to_pylist()
    with open_episode(sorted(episodes)[1]) as e:
        camera = e.meta.drawing.cameras["head_camera"].camera("head_camera")
        uv, depth = project(
            camera.type, e.array("observation/head_camera/pose")[3], e.array("target/pose")[3, :3]
        )
        np.testing.assert_allclose(rows[3]["target_track_cam_high"], [*uv, depth, 1], rtol=1e-6)
        np.testing.assert_allclose(
            rows[3]["camera_pose_cam_left_wrist"],
            e.array("observation/left_camera/pose")[3],
            rtol=1e-6,
        )
    assert [r["sim_step"] for r in rows] == [16 * t for t in range(6)]
    # the synthetic contact: target and left hand, in the middle
    assert [r["contact_target"] for r in rows] == [[t == 3, False] for t in range(6)]


def annotated(tmp_path, episode, frames):
    """A flow and a mask annotation of the head camera, known by heart, for one episode of the
    dataset."""
    relative = episode.relative_to(tmp_path / "episodes")
    rng = np.random.default_rng(0)
    flow = {
        "flow": rng.normal(size=(frames, 4, 5, 2)).astype(np.float16),
        "rgb": rng.integers(0, 255, (frames, 4, 5, 3), np.uint8),
    }
    flow |= {
        "scale": rng.random(frames).astype(np.float32),
        "previous": np.maximum(np.arange(frames) - 4, 0),
    }
    mask = rng.random((frames, 2, 6, 7)) > 0.5
    masks = {
        "mask": pack(mask),
        "box": np.ones((frames, 2, 4), np.float32),
        "score": np.ones((frames, 2), np.float32),
    }
    masks |= {"area": mask.sum((2, 3)), "valid": mask.any((2, 3))}
    said = {"objects": ["target", "other"], "height": 6, "width": 7}
    of_images = {"inputs": images(episode)}
    for directory, stage, arrays, attributes in (
        ("flow@00000001", "flow", flow, {}),
        ("masks@00000002", "masks", masks, said),
    ):
        write_stage(
            tmp_path,
            directory,
            {
                "stage": stage,
                "version": 1,
                "parameters": {"camera": "head_camera", "source": "sim"},
            },
        )
        write_entry(
            annotation_path(tmp_path, directory, relative), "key", arrays, attributes | of_images
        )
    return flow, mask


def images(episode):
    """What a stage that reads the images of the head camera says it was made from."""
    with open_episode(episode) as e:
        return frames_inputs(encoded_frames(e, "head_camera"))


def coco_decode(counts, height, width):
    """COCO's rule: runs of zeros and ones in turn, down the columns."""
    return np.repeat(np.arange(len(counts)) % 2, counts).reshape(width, height).T.astype(bool)


def test_annotations_are_joined_where_there_are_some(tmp_path, episodes):
    first, second, _ = sorted(episodes)
    flow, mask = annotated(tmp_path, first, 5)
    out = tmp_path / "out"
    assert run("parquet", tmp_path, out, episodes)["annotations"] == [
        "flow@00000001",
        "masks@00000002",
    ]
    table = pq.read_table(out / "data-00000.parquet")
    rows = table.filter(pa.compute.equal(table["episode_index"], 0)).to_pylist()
    for t, row in enumerate(rows):
        np.testing.assert_array_equal(
            np.frombuffer(row["flow_cam_high"], "<f2").reshape(4, 5, 2), flow["flow"][t]
        )
        png = cv2.imdecode(
            np.frombuffer(row["flow_rgb_cam_high"]["bytes"], np.uint8), cv2.IMREAD_COLOR
        )
        np.testing.assert_array_equal(png[..., ::-1], flow["rgb"][t])
        assert row["flow_scale_cam_high"] == flow["scale"][t] and row[
            "flow_previous_cam_high"
        ] == max(t - 4, 0)
        for k, name in enumerate(("target", "other")):
            got = row["masks_cam_high"][k]
            assert got["object"] == name and got["area"] == mask[t, k].sum()
            np.testing.assert_array_equal(
                coco_decode(got["counts"], got["height"], got["width"]), mask[t, k]
            )
    others = table.filter(pa.compute.greater(table["episode_index"], 0))
    assert (
        others["masks_cam_high"].null_count
        == others["flow_rgb_cam_high"].null_count
        == len(others)
        == 9
    )
    changed = annotation_path(tmp_path, "flow@00000001", first.relative_to(tmp_path / "episodes"))
    changed.write_bytes(changed.read_bytes() + b"x")
    assert check_export(tmp_path, out, episodes) == [f"{out}: {changed} has changed since"]
    (tmp_path / "annotations" / "masks@00000002" / "stage.json").unlink()
    assert "flow_cam_high" not in pq.read_schema(_without(tmp_path, episodes)).names
    write_entry(
        annotation_path(tmp_path, "flow@00000001", second.relative_to(tmp_path / "episodes")),
        "key",
        flow,
        {},
    )
    with pytest.raises(ExportError, match=r"flow@00000001.*not of the 6 frames"):
        run("parquet", tmp_path, out, episodes)


def test_an_annotation_of_other_images_is_not_joined(tmp_path, episodes):
    first = sorted(episodes)[0]
    annotated(tmp_path, first, 5)
    out = tmp_path / "out"
    run("parquet", tmp_path, out, [first])
    with h5py.File(first, "r+") as f:
        jpegs = f["observation/head_camera/rgb"][()]
        f["observation/head_camera/rgb"][...] = jpegs[::-1]
    with pytest.raises(
        ExportError,
        match=(
            r"flow@00000001/.*\.h5: is out of date, it was made from other images; run domino-data"
        ),
    ) as error:
        run("parquet", tmp_path, out, [first])
    assert f"annotate {tmp_path} " in str(error.value)
    run("parquet", tmp_path, out, [first], annotations="none")


def test_annotations_of_the_simulators_truth_are_compared_with_the_state_log_and_features_with_their_masks(  # noqa: E501
    tmp_path,
):
    path = make_episode(episode_path(tmp_path), frames=3, segmentation=True, depth=True)
    with open_episode(path) as e:
        late = e.meta.drawing.model_copy(update={"sensors": Sensors(latency=1)})
        e.meta = e.meta.model_copy(update={"drawing": late})
        facts = read_facts(e, tmp_path)
        inputs = json.loads(json.dumps(sim_reading(e, "head_camera", True, None)[0]))
        assert inputs["scene"]["latency"] == 1
        stage = {"stage": "flow", "parameters": {"camera": "head_camera"}}
        assert stale(Entry("", {}, {"inputs": inputs}, ""), stage, e, facts, tmp_path) is None
        moved = inputs | {"scene": inputs["scene"] | {"state": "another"}}
        assert (
            stale(Entry("", {}, {"inputs": moved}, ""), stage, e, facts, tmp_path)
            == "it was made from other physics"
        )
        seen = inputs | {"stored": "another"}
        assert (
            stale(Entry("", {}, {"inputs": seen}, ""), stage, e, facts, tmp_path)
            == "it was made from other truth"
        )
        features = {
            "stage": "features",
            "parameters": {"camera": "head_camera", "masks": "masks@1", "mask_source": "sim"},
        }
        place = annotation_path(tmp_path, "masks@1", path.relative_to(tmp_path / "episodes"))
        made = write_entry(place, "key", {"mask": np.zeros(3)}, {})
        of_masks = images(path) | {"masks": made.checksum}
        assert stale(Entry("", {}, {"inputs": of_masks}, ""), features, e, facts, tmp_path) is None
        write_entry(place, "key", {"mask": np.ones(3)}, {})
        assert (
            stale(Entry("", {}, {"inputs": of_masks}, ""), features, e, facts, tmp_path)
            == "it was made from other masks"
        )
        assert (
            stale(Entry("", {}, {}, ""), features, e, facts, tmp_path)
            == "it does not name what it was made from"
        )


def _without(tmp_path, episodes):
    run("parquet", tmp_path, tmp_path / "plain", episodes, annotations="none")
    return tmp_path / "plain" / "data-00000.parquet"


def test_two_annotations_of_one_kind_carry_their_digits(tmp_path, episodes):
    annotated(tmp_path, episodes[0], 3)
    write_stage(
        tmp_path,
        "flow@000000ff",
        {"stage": "flow", "version": 1, "parameters": {"camera": "head_camera"}},
    )
    run("parquet", tmp_path, tmp_path / "out", episodes)
    names = set(pq.read_schema(tmp_path / "out" / "data-00000.parquet").names)
    assert {"flow_cam_high_00000001", "flow_rgb_cam_high_000000ff", "masks_cam_high"} <= names
    with pytest.raises(ExportError, match="there is no flow@11111111; there are: flow@00000001"):
        run("parquet", tmp_path, tmp_path / "out", episodes, annotations="flow@11111111")


def test_a_large_episode_is_several_row_groups(tmp_path, episodes):
    out = tmp_path / "out"
    run("parquet", tmp_path, out, episodes, group_bytes=30_000)
    assert pq.read_metadata(out / "data-00000.parquet").num_row_groups > 3
