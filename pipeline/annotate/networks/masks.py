"""Masks: SAM 2 in GroundingDINO's best box, or exact from a segmentation. A row without a box is
not valid.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.annotate.options import MaskOptions
from pipeline.poses import Bools, Floats32, Pixels

from .models import ModelFiles, image_settings, inference, load_model, pixels


@dataclass(eq=False)
class Masks:
    """T frames, K objects: mask (T,K,H,W), box (T,K,4) px x0 y0 x1 y1, score and valid (T,K);
    phrases [K][T].
    """

    mask: Bools
    box: Floats32
    score: Floats32
    valid: Bools
    phrases: list[list[str]]

    @property
    def area(self) -> NDArray[np.int32]:
        return self.mask.sum((2, 3)).astype(np.int32)


@dataclass(eq=False)
class Detector:
    """GroundingDINO; `short` and `long` bound its image's sides, px."""

    model: Any
    tokenizer: Any
    settings: dict[str, Any]
    short: int
    long: int
    device: str


@dataclass(eq=False)
class Segmenter:
    """SAM 2 on one device; images are squashed to `side` px square."""

    model: Any
    settings: dict[str, Any]
    side: int
    device: str


def load_detector(files: ModelFiles, device: str) -> Detector:
    from transformers import AutoTokenizer, GroundingDinoForObjectDetection

    model = load_model(GroundingDinoForObjectDetection, files, device)
    tokenizer = AutoTokenizer.from_pretrained(files.path, local_files_only=True)
    settings = image_settings(files)
    size = settings["size"]
    short, long = size.get("shortest_edge", 800), size.get("longest_edge", 1333)
    return Detector(model, tokenizer, settings, short, long, device)


def load_segmenter(files: ModelFiles, device: str) -> Segmenter:
    from transformers import Sam2Model

    model = load_model(Sam2Model, files, device)
    side = model.config.prompt_encoder_config.image_size
    return Segmenter(model, image_settings(files), side, device)


def detector_size(height: int, width: int, short: int, long: int) -> tuple[int, int]:
    """Fit (height, width) so that the shorter side is `short` and the longer at most `long`."""
    low, high = min(height, width), max(height, width)
    exact: float = short if high / low * short <= long else long * low / high
    side, other = round(exact), int(exact * high / low)
    return (side, other) if height <= width else (other, side)


def detect(
    detector: Detector, frames: Pixels, caption: str, box_threshold: float, text_threshold: float
) -> tuple[Floats32, Floats32, list[str]]:
    """Best box (N,4) px x0 y0 x1 y1, its score (N,), 0 if none passes, and its words, for frames
    (N,H,W,3).
    """
    import torch

    n, height, width = frames.shape[:3]
    most = detector.model.config.max_text_len
    text = detector.tokenizer([caption], return_tensors="pt", truncation=True, max_length=most)
    text = {k: v.to(detector.device).expand(n, -1) for k, v in text.items()}
    size = detector_size(height, width, detector.short, detector.long)
    with inference(detector.device):
        x = pixels(frames, size, detector.settings, detector.device)
        seen = torch.ones_like(x[:, 0], dtype=torch.long)
        out = detector.model(pixel_values=x, pixel_mask=seen, **text)
        probability = out.logits.float().sigmoid()
        score, query = probability.amax(-1).max(-1)
        rows = torch.arange(n, device=score.device)
        cx, cy, w, h = out.pred_boxes.float()[rows, query].unbind(-1)
        matched = (probability[rows, query] > text_threshold).cpu().numpy()
        scale = torch.tensor([width, height, width, height], device=score.device)
        corners = torch.stack([cx - w / 2, cy - h / 2, cx + w / 2, cy + h / 2], -1) * scale
        corners = torch.minimum(corners.clamp(min=0), scale)
    boxes, scores = (each.cpu().numpy().astype(np.float32) for each in (corners, score))
    ids, detected, phrases = text["input_ids"][0].tolist(), scores > box_threshold, list[str]()
    for row, is_detected in zip(matched, detected, strict=True):
        # the first and last tokens are the tokenizer's own marks
        words = [ids[j] for j in np.flatnonzero(row[: len(ids)]) if 0 < j < len(ids) - 1]
        phrase = detector.tokenizer.decode(words).replace(".", "").strip()
        phrases.append(phrase if is_detected else "")
    return boxes * detected[:, None], scores * detected, phrases


def segment(segmenter: Segmenter, frames: Pixels, boxes: Floats32) -> Bools:
    """Masks (N,K,H,W) of boxes (N,K,4) px in frames (N,H,W,3)."""
    import torch
    import torch.nn.functional as functional

    size, side = frames.shape[1:3], segmenter.side
    scale = np.array([side / size[1], side / size[0]] * 2, np.float32)
    with inference(segmenter.device):
        x = pixels(frames, (side, side), segmenter.settings, segmenter.device)
        asked = torch.from_numpy(boxes * scale).to(segmenter.device)
        out = segmenter.model(pixel_values=x, input_boxes=asked, multimask_output=False)
        logits = functional.interpolate(
            out.pred_masks[:, :, 0].float(), size, mode="bilinear", align_corners=False
        )
    return (logits > 0).cpu().numpy()


def model_masks(
    detector: Detector,
    segmenter: Segmenter,
    frames: Pixels,
    captions: tuple[str, ...],
    options: MaskOptions,
) -> Masks:
    """Masks of frames (T,H,W,3) for K captions; valid ones are within `max_area`."""
    (t, height, width), k = frames.shape[:3], len(captions)
    thresholds = options.box_threshold, options.text_threshold
    mask = np.zeros((t, k, height, width), bool)
    box, score = np.zeros((t, k, 4), np.float32), np.zeros((t, k), np.float32)
    phrases: list[list[str]] = [[] for _ in captions]
    for start in range(0, t, options.batch):
        part = slice(start, start + options.batch)
        for j, caption in enumerate(captions):
            made = detect(detector, frames[part], caption, *thresholds)
            box[part, j], score[part, j] = made[:2]
            phrases[j] += made[2]
        if (found := score[part] > 0).any():
            mask[part] = segment(segmenter, frames[part], box[part]) & found[..., None, None]
    fraction = mask.mean((2, 3))
    valid = (score > 0) & (fraction > 0) & (fraction <= options.max_area)
    mask[~valid] = False
    return Masks(mask, box, score, valid, phrases)


def exact_masks(segmentation: Pixels, bodies: list[str], objects: tuple[str, ...]) -> Masks:
    """Masks of objects and their parts ("cabinet/drawer") from a segmentation (T,H,W). Boxes are
    tight, scores 1.
    """
    shape = (len(segmentation), len(objects), *segmentation.shape[1:])
    mask = np.zeros(shape, bool)
    for k, name in enumerate(objects):
        labels = [i + 1 for i, b in enumerate(bodies) if b == name or b.startswith(f"{name}/")]
        mask[:, k] = np.isin(segmentation, labels)
    valid = mask.any((2, 3))
    return Masks(mask, tight_boxes(mask), np.asarray(valid, np.float32), np.asarray(valid), [])


def tight_boxes(mask: Bools) -> Floats32:
    """Smallest boxes (...,4) px x0 y0 x1 y1 around masks (...,H,W), upper ends exclusive; zeros
    if empty.
    """
    height, width = mask.shape[-2:]
    box = np.zeros((*mask.shape[:-2], 4), np.float32)
    for axis, (i, size) in enumerate(((0, width), (1, height))):
        line = np.asarray(mask.any(-2 + axis))
        box[..., i] = line.argmax(-1)
        box[..., i + 2] = size - line[..., ::-1].argmax(-1)
    return box * np.asarray(mask.any((-2, -1)))[..., None]


def pack(mask: Bools) -> Pixels:
    """Masks (T,K,H,W) -> bits (T,K,ceil(H W / 8)) uint8."""
    return np.packbits(mask.reshape(*mask.shape[:2], -1), axis=-1)
