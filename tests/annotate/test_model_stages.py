"""Masks and features through `annotate`: keys chain from frames to masks to features; nothing found
stays marked."""

import dataclasses
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks.flow_agreement import flow_agreement
from pipeline.annotate.networks.masks import pack
from pipeline.annotate.options import AnnotateOptions, FeatureOptions, MaskOptions
from pipeline.annotate.overlays import annotation_sheet, mask_overlay
from pipeline.annotate.stage import AnnotateError
from pipeline.annotate.store import episode_paths, find_stage, write_entry, write_stage
from pipeline.data.slots.annotations import annotation_path, read_entry
from pipeline.run.annotate import annotate
from tests.annotate import tiny
from tests.synthetic import HALF, episode_path, make_episode

STAGES = ("masks", "features")


@pytest.fixture(scope="module")
def options(tmp_path_factory: pytest.TempPathFactory) -> AnnotateOptions:
    torch.set_num_threads(1)
    root = tmp_path_factory.mktemp("models")
    masks = MaskOptions(
        detector=str(tiny.save_detector(root / "detector")),
        segmenter=str(tiny.save_segmenter(root / "segmenter")),
        objects=("target", "other"),
        max_area=1.0,
    )
    return AnnotateOptions(
        masks=masks,
        features=FeatureOptions(encoder=str(tiny.save_encoder(root / "encoder")), size=56),
    )


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("dataset")
    for slot in range(2):
        path = episode_path(root, slot=slot)
        make_episode(
            path, slot=slot, seed=slot, frames=5, cameras=("head_camera",), segmentation=True
        )
    return root


@pytest.fixture
def dataset(source: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(source, tmp_path / "data"))


def sim(options: AnnotateOptions, **changes: object) -> AnnotateOptions:
    return dataclasses.replace(
        options, masks=dataclasses.replace(options.masks, source="sim", **changes)
    )


def counts(report: dict) -> dict[str, tuple[int, int]]:
    return {s["name"]: (s["computed"], s["reused"]) for s in report["stages"]}


def tree(root: Path) -> dict[str, bytes]:
    return {
        str(p.relative_to(root)): p.read_bytes()
        for p in sorted((root / "annotations").rglob("*.h5"))
    }


def entry(dataset: Path, stage: str, slot: int = 0, **parameters: object):
    return read_entry(
        annotation_path(
            dataset, find_stage(dataset, stage, **parameters), episode_paths(dataset)[slot]
        )
    )


def test_model_masks_and_features_then_nothing(dataset: Path, options: AnnotateOptions):
    plan = annotate(dataset, STAGES, options=options, dry_run=True)
    assert counts(plan) == {"masks": (2, 0), "features": (2, 0)}
    assert plan["stages"][1]["plan"][0]["reason"] == "after its masks"
    assert counts(annotate(dataset, STAGES, options=options)) == {
        "masks": (2, 0),
        "features": (2, 0),
    }
    masks, features = entry(dataset, "masks"), entry(dataset, "features")
    assert masks.attributes["objects"] == ["target", "other"]
    assert masks.attributes["prompts"] == ["bell.", "block."]
    assert masks.attributes["inputs"]["prompts"] == ["bell.", "block."]
    assert [len(p) for p in masks.attributes["phrases"]] == [5, 5]
    shapes = {k: v.shape for k, v in masks.arrays.items()}
    assert shapes == {
        "mask": (5, 2, 9600),
        "box": (5, 2, 4),
        "score": (5, 2),
        "area": (5, 2),
        "valid": (5, 2),
    }
    mask = masks.masks()
    np.testing.assert_array_equal(mask.sum((2, 3)), masks.arrays["area"])
    np.testing.assert_array_equal(masks.arrays["valid"], mask.any((2, 3)))
    assert (
        features.arrays["feature"].shape == (5, 2, 32)
        and features.arrays["feature"].dtype == np.float16
    )
    np.testing.assert_array_equal(features.arrays["valid"], masks.arrays["valid"])
    assert counts(annotate(dataset, STAGES, options=options)) == {
        "masks": (0, 2),
        "features": (0, 2),
    }


def test_changing_a_feature_parameter_leaves_masks_alone_and_the_other_way_round(
    dataset: Path, options: AnnotateOptions
):
    options = sim(options)
    annotate(dataset, STAGES, options=options)
    bigger = dataclasses.replace(options, features=dataclasses.replace(options.features, size=84))
    assert counts(annotate(dataset, STAGES, options=bigger)) == {
        "masks": (0, 2),
        "features": (2, 0),
    }
    fewer = sim(options, objects=("target",))
    assert counts(annotate(dataset, STAGES, options=fewer)) == {"masks": (2, 0), "features": (2, 0)}
    batched = dataclasses.replace(options, features=dataclasses.replace(options.features, batch=2))
    assert counts(annotate(dataset, STAGES, options=batched)) == {
        "masks": (0, 2),
        "features": (0, 2),
    }


def test_features_survive_when_masks_are_made_again_with_the_same_content(
    dataset: Path, options: AnnotateOptions
):
    options = sim(options)
    annotate(dataset, STAGES, options=options)
    before = tree(dataset)
    annotation_path(dataset, find_stage(dataset, "masks"), episode_paths(dataset)[0]).unlink()
    alone = annotate(dataset, ["features"], options=options)["stages"][0]
    assert (alone["reused"], alone["waiting"], alone["failed"]) == (1, 1, 0)
    assert "masks are missing: annotate stage masks first" in alone["problems"][0]
    assert counts(annotate(dataset, STAGES, options=options)) == {
        "masks": (1, 1),
        "features": (0, 2),
    }
    assert tree(dataset) == before


def test_features_wait_for_stale_masks(dataset: Path, options: AnnotateOptions):
    options = sim(options)
    annotate(dataset, STAGES, options=options)
    make_episode(
        episode_path(dataset, slot=1),
        slot=1,
        seed=7,
        frames=5,
        cameras=("head_camera",),
        segmentation=True,
    )
    alone = annotate(dataset, ["features"], options=options)["stages"][0]
    assert (alone["reused"], alone["waiting"]) == (1, 1) and "masks are stale" in alone["problems"][
        0
    ]
    again = annotate(dataset, STAGES, options=options)
    assert [(s["computed"], s["invalid"]) for s in again["stages"]] == [(1, 1), (1, 1)]


def test_sim_masks_are_the_square_and_never_the_whole_picture(
    dataset: Path, options: AnnotateOptions
):
    annotate(dataset, ["masks"], options=sim(options))
    masks = entry(dataset, "masks")
    assert masks.arrays["area"].tolist() == [[(2 * HALF) ** 2, 0]] * 5
    assert masks.arrays["valid"].tolist() == [[True, False]] * 5
    assert masks.attributes["roles"] == {"target": 0}
    box = masks.arrays["box"][0, 0]
    assert (box[2] - box[0], box[3] - box[1]) == (2 * HALF, 2 * HALF)
    assert (masks.arrays["box"][:, 1] == 0).all()


def test_unseen_object_has_no_feature(dataset: Path, options: AnnotateOptions):
    annotate(dataset, STAGES, options=sim(options))
    features = entry(dataset, "features").arrays
    assert features["valid"].tolist() == [[True, False]] * 5
    assert (features["feature"][:, 1] == 0).all() and (features["feature"][:, 0] != 0).any()


def test_nothing_detected_is_stored_as_invalid(dataset: Path, options: AnnotateOptions):
    none = dataclasses.replace(options, masks=dataclasses.replace(options.masks, box_threshold=1.0))
    report = annotate(dataset, STAGES, options=none)
    assert counts(report) == {"masks": (2, 0), "features": (2, 0)}
    for stage in STAGES:
        assert not entry(dataset, stage).arrays["valid"].any()
    assert not entry(dataset, "masks").arrays["mask"].any()
    assert counts(annotate(dataset, STAGES, options=none)) == {"masks": (0, 2), "features": (0, 2)}


def test_instruction_prompt(dataset: Path, options: AnnotateOptions):
    paper = dataclasses.replace(
        options, masks=dataclasses.replace(options.masks, prompt="instruction")
    )
    annotate(dataset, ["masks"], options=paper)
    masks = entry(dataset, "masks")
    assert masks.attributes["objects"] == ["instruction"]
    assert masks.attributes["prompts"] == ["click bell with the left arm."]


def test_missing_weights_stop_before_anything_and_sim_needs_no_detector(
    dataset: Path, options: AnnotateOptions, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    import huggingface_hub.constants

    monkeypatch.setattr(huggingface_hub.constants, "HF_HUB_OFFLINE", True)
    monkeypatch.setattr(huggingface_hub.constants, "HF_HUB_CACHE", str(tmp_path / "none"))
    with pytest.raises(AnnotateError, match="hf download IDEA-Research/grounding-dino-tiny"):
        annotate(dataset, ["flow", "masks"])
    assert not (dataset / "annotations").exists()
    report = annotate(dataset, ["masks"], options=AnnotateOptions(masks=MaskOptions(source="sim")))
    assert counts(report) == {"masks": (2, 0)}


def test_flow_agreement_of_known_fields(dataset: Path):
    """Farneback that sees half the motion, turned by 90 degrees, with noise of 0.25 px where
    nothing moves."""
    height, width, frames = 240, 320, 5
    previous = np.array([0, 0, 0, 0, 0])
    exact = np.zeros((frames, 64, 64, 2), np.float16)
    exact[1:, 16:32, 16:32, 0] = 2.0
    measured = np.full_like(exact, 0)
    measured[..., 1] = 0.25
    measured[:, 16:32, 16:32] = 0, 1.0
    mask = np.zeros((frames, 1, height, width), bool)
    mask[:, 0, 60:120, 80:160] = True
    about = {"objects": ["target"], "roles": {"target": 0}, "height": height, "width": width}
    written = {
        "flow@00000001": (
            {"flow": measured, "previous": previous},
            {},
            {"source": "farneback", "camera": "head_camera"},
        ),
        "flow@00000002": (
            {"flow": exact, "previous": previous},
            {},
            {"source": "sim", "camera": "head_camera"},
        ),
        "masks@00000003": ({"mask": pack(mask)}, about, {"source": "sim", "camera": "head_camera"}),
    }
    episode = episode_paths(dataset)[0]
    for directory, (arrays, attributes, parameters) in written.items():
        write_stage(
            dataset,
            directory,
            {"stage": directory.split("@")[0], "version": 1, "parameters": parameters},
        )
        write_entry(annotation_path(dataset, directory, episode), "k", arrays, attributes)
    row = flow_agreement(dataset, episode_paths(dataset))["levels"]["L1"]
    # frames 1 and 2 lie before the meeting at frame 2; frame 0 has no motion
    assert row == {
        "pairs": 2,
        "exact": 2.0,
        "measured": 1.0,
        "error": round(5**0.5, 4),
        "angle": 90.0,
        "error_still": 0.25,
    }


def test_sheet_shows_masks_and_flows(dataset: Path, options: AnnotateOptions):
    episode = episode_paths(dataset)[0]
    assert annotation_sheet(dataset, episode) is None
    annotate(dataset, ["flow", "masks"], options=sim(options))
    sheet = annotation_sheet(dataset, episode, frames=[1, 4])
    assert (
        sheet is not None
        and sheet.shape == (2 * (150 + 18), 2 * 200, 3)
        and sheet.dtype == np.uint8
    )
    frame = np.full((40, 60, 3), 100, np.uint8)
    mask = np.zeros((1, 40, 60), bool)
    mask[0, 10:30, 20:40] = True
    drawn = mask_overlay(frame, mask)
    changed = (drawn != frame).any(-1)
    np.testing.assert_array_equal(changed, mask[0])
    assert (frame == 100).all()
