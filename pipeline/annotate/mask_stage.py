"""The mask stage: per episode mask (T,K,bits), box (T,K,4), score, area and valid (T,K); attributes
name objects and prompts."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pipeline.annotate.networks.masks import (
    Masks,
    exact_masks,
    load_detector,
    load_segmenter,
    model_masks,
    pack,
)
from pipeline.annotate.networks.models import ModelFiles, pick_device, resolve
from pipeline.annotate.networks.prompts import Prompts, ask
from pipeline.annotate.options import MaskOptions
from pipeline.annotate.stage import (
    Reading,
    Render,
    StageResult,
    decode_frames,
    encoded_frames,
    frames_inputs,
    sim_reading,
)
from pipeline.data.episode.file import EpisodeFile
from pipeline.data.names import HEAD


@dataclass(frozen=True)
class MaskStage:
    """See pipeline.annotate.stage.Stage; made by `resolve`."""

    options: MaskOptions
    camera: str = HEAD
    render: Render | None = None
    device: str = "auto"
    detector: ModelFiles | None = None
    segmenter: ModelFiles | None = None

    name = "masks"
    version = 1

    @classmethod
    def resolve(
        cls,
        options: MaskOptions,
        camera: str,
        render: Render | None,
        device: str,
        download: bool = True,
    ) -> "MaskStage":
        """Find the models. Raises NoWeights if one is missing."""
        stage = cls(options, camera, render, device)
        if options.source == "sim":
            return stage
        detector = resolve(options.detector, options.detector_revision, download)
        return replace(
            stage,
            detector=detector,
            segmenter=resolve(options.segmenter, options.segmenter_revision, download),
        )

    @property
    def uses_models(self) -> bool:
        return self.options.source == "model"

    def parameters(self) -> dict[str, Any]:
        o = self.options
        plain: dict[str, Any] = {
            "camera": self.camera,
            "source": o.source,
            "objects": list(o.objects),
        }
        if o.source == "sim":
            return plain
        assert self.detector is not None and self.segmenter is not None
        return plain | {
            "prompt": o.prompt,
            "box_threshold": o.box_threshold,
            "text_threshold": o.text_threshold,
            "max_area": o.max_area,
            "precision": o.precision,
            "detector": self.detector.digest,
            "segmenter": self.segmenter.digest,
        }

    def read(self, episode: EpisodeFile, dataset: Path, relative: Path) -> Reading:
        o = self.options
        source = "metadata" if o.source == "sim" else o.prompt
        asked = ask(episode.meta, episode.instructions()[0], o.objects, source)
        if o.source == "sim":
            inputs, view, bodies = sim_reading(episode, self.camera, False, self.render)
            named = inputs | {"objects": list(asked.objects), "roles": dict(asked.roles)}
            return Reading(named, lambda: (asked, view().segmentation, bodies))
        frames = encoded_frames(episode, self.camera)
        named = frames_inputs(frames) | {
            "objects": list(asked.objects),
            "roles": dict(asked.roles),
            "prompts": list(asked.prompts),
        }
        return Reading(named, lambda: (asked, decode_frames(frames)))

    def start(self) -> Callable[[Any], StageResult]:
        o = self.options
        if o.source == "sim":
            return lambda data: _result(
                exact_masks(data[1], data[2], data[0].objects), data[0], "sim"
            )
        assert self.detector is not None and self.segmenter is not None
        device = pick_device(self.device)
        detector = load_detector(self.detector, device, o.precision)
        segmenter = load_segmenter(self.segmenter, device, o.precision)

        def compute(data: tuple[Prompts, Any]) -> StageResult:
            asked, frames = data
            masks = model_masks(
                detector,
                segmenter,
                frames,
                asked.prompts,
                o.box_threshold,
                o.text_threshold,
                o.max_area,
                o.batch,
            )
            return _result(masks, asked, "model")

        return compute


def _result(masks: Masks, asked: Prompts, source: str) -> StageResult:
    height, width = masks.mask.shape[2:]
    arrays = {
        "mask": pack(masks.mask),
        "box": masks.box,
        "score": masks.score,
        "area": masks.area,
        "valid": masks.valid,
    }
    attributes: dict[str, Any] = {
        "source": source,
        "objects": list(asked.objects),
        "roles": dict(asked.roles),
        "height": height,
        "width": width,
    }
    if source == "model":
        attributes |= {"prompts": list(asked.prompts), "phrases": masks.phrases}
    return StageResult(arrays, attributes, compressed=("mask",))
