"""Masks and features by the real model classes with tiny random weights, against the libraries' own
processors and plain loops."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pipeline.annotate.networks.features import (
    area_weights,
    features_of,
    load_encoder,
    overlap,
    patch_tokens,
    pool,
)
from pipeline.annotate.networks.masks import (
    Detector,
    Segmenter,
    detect,
    detector_size,
    exact_masks,
    load_detector,
    load_segmenter,
    model_masks,
    pack,
    segment,
    tight_boxes,
)
from pipeline.annotate.networks.models import image_settings, pixels, resolve
from pipeline.annotate.options import MaskOptions
from pipeline.annotate.stage import AnnotateError
from pipeline.data.slots.annotations import Entry
from tests.annotate import tiny


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    torch.set_num_threads(1)
    root = tmp_path_factory.mktemp("models")
    return {
        "detector": tiny.save_detector(root / "detector"),
        "segmenter": tiny.save_segmenter(root / "segmenter"),
        "dinov2": tiny.save_encoder(root / "dinov2"),
        "dinov3": tiny.save_encoder(root / "dinov3", "dinov3"),
    }


@pytest.fixture(scope="module")
def detector(models: dict[str, Path]) -> Detector:
    return load_detector(resolve(str(models["detector"])), "cpu")


@pytest.fixture(scope="module")
def segmenter(models: dict[str, Path]) -> Segmenter:
    return load_segmenter(resolve(str(models["segmenter"])), "cpu")


@pytest.fixture(scope="module")
def frames() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (5, 60, 80, 3), dtype=np.uint8)


def test_digest_follows_content_not_path(models: dict[str, Path], tmp_path: Path):
    here = resolve(str(models["dinov2"]))
    shutil.copytree(models["dinov2"], tmp_path / "elsewhere")
    assert resolve(str(tmp_path / "elsewhere")).digest == here.digest
    tiny.save_encoder(tmp_path / "elsewhere", seed=1)
    assert resolve(str(tmp_path / "elsewhere")).digest != here.digest


def test_missing_weights_get_one_line_that_says_how(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    import huggingface_hub.constants

    monkeypatch.setattr(huggingface_hub.constants, "HF_HUB_OFFLINE", True)
    monkeypatch.setattr(huggingface_hub.constants, "HF_HUB_CACHE", str(tmp_path))
    with pytest.raises(
        AnnotateError, match=r"run `hf download IDEA-Research/grounding-dino-tiny`"
    ) as caught:
        resolve("grounding-dino-tiny")
    assert "\n" not in str(caught.value) and "sim" in str(caught.value)
    with pytest.raises(AnnotateError, match="does not exist"):
        resolve(str(tmp_path / "nothing"))
    with pytest.raises(AnnotateError, match="is no model directory"):
        resolve(str(tmp_path))


def test_wrong_weights_are_refused_not_filled_with_noise(models: dict[str, Path]):
    with pytest.raises(AnnotateError, match=r"is no Sam2Model|cannot be loaded as Sam2Model"):
        load_segmenter(resolve(str(models["dinov2"])), "cpu")
    with pytest.raises(AnnotateError, match="no patch encoder"):
        load_encoder(resolve(str(models["detector"])), 224, "cpu")
    with pytest.raises(AnnotateError, match=r"no multiple of the patch size 14 .* use 210"):
        load_encoder(resolve(str(models["dinov2"])), 215, "cpu")


@pytest.mark.parametrize("shape", [(240, 320), (480, 640), (180, 320), (320, 100), (64, 64)])
def test_detector_sees_what_the_library_would_show_it(
    shape: tuple[int, int], models: dict[str, Path]
):
    from transformers import GroundingDinoImageProcessor

    processor = GroundingDinoImageProcessor.from_pretrained(models["detector"])
    frame = np.random.default_rng(1).integers(0, 256, (1, *shape, 3), dtype=np.uint8)
    expected = processor(images=[frame[0]], return_tensors="pt")["pixel_values"]
    ours = pixels(
        frame,
        detector_size(*shape, 64, 100),
        image_settings(resolve(str(models["detector"]))),
        "cpu",
    )
    assert ours.shape == expected.shape
    # half a grey level or one, from integer against float interpolation
    assert (ours - expected).abs().max() < 2.1 / 255 / 0.224


def test_best_box_is_the_librarys_best_box(
    detector: Detector, models: dict[str, Path], frames: np.ndarray
):
    from transformers import GroundingDinoProcessor

    processor = GroundingDinoProcessor.from_pretrained(models["detector"])
    boxes, scores, phrases = detect(detector, frames, "red bell.", 0.35, 0.25)
    text = processor.tokenizer(["red bell."], return_tensors="pt")
    for i in range(len(frames)):
        x = pixels(frames[i : i + 1], detector_size(60, 80, 64, 100), detector.settings, "cpu")
        with torch.no_grad():
            out = detector.model(pixel_values=x, **text)
        found = processor.post_process_grounded_object_detection(
            out, text["input_ids"], threshold=0.35, text_threshold=0.25, target_sizes=[(60, 80)]
        )[0]
        best = int(found["scores"].argmax())
        assert scores[i] == pytest.approx(float(found["scores"][best]), abs=1e-5)
        expected = np.clip(found["boxes"][best].numpy(), 0, [80, 60, 80, 60])
        np.testing.assert_allclose(boxes[i], expected, atol=1e-3)
        # the library leaves the closing mark in where it passes the threshold
        assert (
            phrases[i] == found["text_labels"][best].replace("[SEP]", "").replace(".", "").strip()
        )
        assert set(phrases[i].split()) <= {"red", "bell"}


def test_nothing_above_the_threshold_is_nothing(
    detector: Detector, segmenter: Segmenter, frames: np.ndarray
):
    boxes, scores, phrases = detect(detector, frames, "bell.", 1.0, 0.25)
    assert (boxes == 0).all() and (scores == 0).all() and phrases == [""] * 5
    masks = model_masks(
        detector, segmenter, frames, ("bell.", "block."), MaskOptions(box_threshold=1, batch=2)
    )
    assert not masks.valid.any() and not masks.mask.any() and (masks.area == 0).all()


def test_masks_are_the_librarys_masks(segmenter: Segmenter, frames: np.ndarray):
    from transformers import Sam2ImageProcessor, Sam2Processor

    processor = Sam2Processor(Sam2ImageProcessor(size={"height": tiny.SIDE, "width": tiny.SIDE}))
    boxes = np.array([[[10, 10, 40, 50], [5, 20, 70, 30]]] * 5, np.float32)
    ours = segment(segmenter, frames, boxes)
    assert ours.shape == (5, 2, 60, 80) and ours.dtype == bool
    for i in range(5):
        inputs = processor(images=frames[i], input_boxes=[boxes[i].tolist()], return_tensors="pt")
        with torch.no_grad():
            out = segmenter.model(
                pixel_values=inputs["pixel_values"],
                input_boxes=inputs["input_boxes"],
                multimask_output=False,
            )
        expected = processor.post_process_masks(out.pred_masks, inputs["original_sizes"])[0][
            :, 0
        ].numpy()
        assert (ours[i] == expected).mean() > 0.995


def test_batching_does_not_change_masks(
    detector: Detector, segmenter: Segmenter, frames: np.ndarray
):
    one, four = (
        model_masks(
            detector, segmenter, frames, ("bell.", "block."), MaskOptions(max_area=0.99, batch=n)
        )
        for n in (1, 4)
    )
    np.testing.assert_allclose(one.box, four.box, atol=1e-3)
    np.testing.assert_allclose(one.score, four.score, atol=1e-5)
    assert (one.mask == four.mask).mean() > 0.999 and (one.valid == four.valid).all()
    assert one.phrases == four.phrases and [len(p) for p in one.phrases] == [5, 5]
    assert one.valid.any()
    assert (one.area[one.valid] > 0).all()


def test_a_mask_of_nearly_everything_is_refused(
    detector: Detector, segmenter: Segmenter, frames: np.ndarray
):
    free = model_masks(detector, segmenter, frames, ("bell.",), MaskOptions(max_area=1, batch=4))
    limit = float(np.median(free.mask.mean((2, 3))))
    options = MaskOptions(max_area=limit, batch=4)
    strict = model_masks(detector, segmenter, frames, ("bell.",), options)
    fraction = free.mask.mean((2, 3))
    np.testing.assert_array_equal(strict.valid, free.valid & (fraction <= limit))
    assert strict.valid.sum() < free.valid.sum()
    assert not strict.mask[~strict.valid].any()


@settings(max_examples=25, deadline=None)
@given(arrays(bool, st.tuples(*[st.integers(1, n) for n in (3, 2, 9, 13)])))
def test_packing_and_tight_boxes(mask: np.ndarray):
    size = dict(zip(("height", "width"), mask.shape[2:], strict=True))
    np.testing.assert_array_equal(Entry("", {"mask": pack(mask)}, size, "").masks(), mask)
    boxes = tight_boxes(mask)
    for t, k in np.ndindex(*mask.shape[:2]):
        ys, xs = np.nonzero(mask[t, k])
        expected = [xs.min(), ys.min(), xs.max() + 1, ys.max() + 1] if len(xs) else [0, 0, 0, 0]
        assert boxes[t, k].tolist() == expected


def test_exact_masks_by_body_name():
    seg = np.random.default_rng(0).integers(0, 5, (4, 6, 8)).astype(np.uint8)
    seg[3] = 4
    masks = exact_masks(
        seg, ["cabinet", "cabinet/drawer", "cabinet2", "table"], ("cabinet", "cabinet2", "ghost")
    )
    np.testing.assert_array_equal(masks.mask[:, 0], (seg == 1) | (seg == 2))
    np.testing.assert_array_equal(masks.mask[:, 1], seg == 3)
    assert masks.valid.tolist() == [[True, True, False]] * 3 + [[False] * 3]


@given(st.integers(1, 40), st.integers(1, 20))
def test_overlap_partitions_area(pixels_along: int, patches: int):
    matrix = overlap(pixels_along, patches)
    np.testing.assert_allclose(matrix.sum(1), 1, atol=1e-5)
    np.testing.assert_allclose(matrix.sum(0), patches / pixels_along, atol=1e-5)


@pytest.mark.parametrize(("shape", "grid"), [((60, 80), 4), ((45, 80), 16), ((7, 5), 3)])
def test_pooling_against_a_slow_loop_over_a_fine_mesh(shape: tuple[int, int], grid: int):
    rng = np.random.default_rng(3)
    mask = rng.random((2, 3, *shape)) < 0.3
    mask[1, 2] = False
    tokens = rng.normal(size=(2, grid, grid, 5)).astype(np.float32)
    feature, coverage = pool(tokens, mask)
    # nearest repeat to a common multiple of pixels and patches: there every cell lies in one pixel
    # and in one patch
    fine = np.repeat(np.repeat(mask, grid, 2), grid, 3)
    for n in range(2):
        for k in range(3):
            total, weight = np.zeros(5), 0.0
            for i in range(grid):
                for j in range(grid):
                    h, w = shape
                    w_ij = fine[n, k, i * h : (i + 1) * h, j * w : (j + 1) * w].mean()
                    total += w_ij * tokens[n, i, j]
                    weight += w_ij
            np.testing.assert_allclose(coverage[n, k], weight, atol=1e-4)
            np.testing.assert_allclose(
                feature[n, k], total / weight if weight else np.zeros(5), atol=1e-4
            )


def test_one_pixel_is_enough_where_nearest_would_lose_it():
    mask = np.zeros((1, 1, 240, 320), bool)
    mask[0, 0, 101, 203] = True
    weights = area_weights(mask, (16, 16))[0, 0]
    assert weights[101 // 15, 203 // 20] == pytest.approx(1 / 300)
    assert weights.sum() == pytest.approx(1 / 300)


@pytest.mark.parametrize(("kind", "grid", "prefix"), [("dinov2", 16, 1), ("dinov3", 14, 5)])
def test_features_of_the_real_encoders(
    kind: str, grid: int, prefix: int, models: dict[str, Path], frames: np.ndarray
):
    encoder = load_encoder(resolve(str(models[kind])), 224, "cpu")
    assert (encoder.grid, encoder.prefix) == (grid, prefix)
    tokens = patch_tokens(encoder, frames[:2])
    with torch.no_grad():
        x = pixels(frames[:2], (224, 224), encoder.settings, "cpu")
        hidden = encoder.model(pixel_values=x).last_hidden_state
    assert hidden.shape[1] == prefix + grid * grid
    np.testing.assert_allclose(tokens[:, 1, 2], hidden[:, prefix + grid + 2], atol=1e-5)
    mask = np.zeros((5, 2, 60, 80), bool)
    mask[:4, 0, 10:30, 20:50] = True
    mask[:, 1] = True
    feature, coverage = features_of(encoder, frames, mask, 2)
    again, _ = features_of(encoder, frames, mask, 5)
    assert feature.dtype == np.float16 and feature.shape == (5, 2, 32)
    np.testing.assert_allclose(feature.astype(float), again.astype(float), atol=2e-3)
    assert coverage[4, 0] == 0 and (feature[4, 0] == 0).all()
    np.testing.assert_allclose(coverage[:, 1], grid * grid, rtol=1e-4)
    np.testing.assert_allclose(feature[:2, 1].astype(float), tokens.mean((1, 2)), atol=5e-3)
