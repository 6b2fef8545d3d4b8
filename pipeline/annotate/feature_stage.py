"""The feature stage: per episode feature (T,K,D) fp16, valid (T,K), coverage (T,K) in patches;
objects as in its masks."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.annotate.mask_stage import MaskStage
from pipeline.annotate.networks.features import features_of, load_encoder
from pipeline.annotate.networks.masks import unpack
from pipeline.annotate.networks.models import ModelFiles, pick_device, resolve
from pipeline.annotate.options import FeatureOptions
from pipeline.annotate.stage import (
    NotReady,
    Reading,
    StageResult,
    decode_frames,
    directory_of,
    encoded_frames,
    frames_inputs,
)
from pipeline.annotate.stage_key import annotation_key
from pipeline.annotate.store import entry_header
from pipeline.data.episode.file import EpisodeFile
from pipeline.data.slots.annotations import CorruptAnnotation, annotation_path, read_entry


@dataclass(frozen=True)
class FeatureStage:
    """See pipeline.annotate.stage.Stage; made by `resolve`."""

    options: FeatureOptions
    masks: MaskStage
    encoder: ModelFiles
    device: str = "auto"

    name = "features"
    version = 1
    uses_models = True

    @classmethod
    def resolve(
        cls, options: FeatureOptions, masks: MaskStage, device: str, download: bool = True
    ) -> "FeatureStage":
        """Find the encoder. Raises NoWeights if it is missing."""
        return cls(options, masks, resolve(options.encoder, options.revision, download), device)

    @property
    def camera(self) -> str:
        return self.masks.camera

    def parameters(self) -> dict[str, Any]:
        o = self.options
        return {
            "camera": self.camera,
            "masks": directory_of(self.masks),
            "mask_source": self.masks.options.source,
            "encoder": self.encoder.digest,
            "size": o.size,
            "precision": o.precision,
        }

    def read(self, episode: EpisodeFile, dataset: Path, relative: Path) -> Reading:
        path = annotation_path(dataset, directory_of(self.masks), relative)
        key_of_masks = annotation_key(
            self.masks.name,
            self.masks.version,
            self.masks.parameters(),
            self.masks.read(episode, dataset, relative).inputs,
        )
        try:
            key, checksum = entry_header(path)
        except (FileNotFoundError, CorruptAnnotation) as error:
            raise NotReady("its masks are missing: annotate stage masks first") from error
        if key != key_of_masks:
            raise NotReady("its masks are stale: annotate stage masks first")
        frames = encoded_frames(episode, self.camera)

        def decode() -> Any:
            entry = read_entry(path)
            size = entry.attributes["height"], entry.attributes["width"]
            return decode_frames(frames), unpack(entry.arrays["mask"], *size), entry.attributes

        return Reading(frames_inputs(frames) | {"masks": checksum}, decode)

    def start(self) -> Callable[[Any], StageResult]:
        o = self.options
        encoder = load_encoder(self.encoder, o.size, pick_device(self.device), o.precision)

        def compute(data: tuple[Any, Any, Any]) -> StageResult:
            frames, mask, attributes = data
            feature, coverage = features_of(encoder, frames, mask, o.batch)
            arrays = {"feature": feature, "valid": coverage > 0, "coverage": coverage}
            return StageResult(
                arrays,
                {k: attributes[k] for k in ("objects", "roles")}
                | {"mask_source": attributes["source"]},
            )

        return compute
