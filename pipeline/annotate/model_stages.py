"""The stages that need networks. Masks: mask (T,K,bits), box (T,K,4), score, area, valid (T,K).
Features: feature (T,K,D) fp16, valid (T,K), coverage (T,K) in patches.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pipeline.data.episode.file import EpisodeFile
from pipeline.data.episode.meta import EpisodeMeta
from pipeline.data.names import HEAD
from pipeline.data.slots.annotations import CorruptAnnotation, annotation_path, read_entry

from .networks.features import features_of, load_encoder
from .networks.masks import Masks, exact_masks, load_detector, load_segmenter, model_masks, pack
from .networks.models import ModelFiles, pick_device, resolve
from .options import FeatureOptions, MaskOptions
from .stage import (
    AnnotateError,
    NotReady,
    Reading,
    Render,
    StageResult,
    annotation_key,
    decode_frames,
    directory_of,
    encoded_frames,
    frames_inputs,
    sim_reading,
)
from .store import entry_header

ROLES = ("target", "manipulated")
_LABELLED = re.compile(
    r"\b(?:target|object|item|goal|subject)\b\s*(?::|=|\bis\b)\s*([^,.;:!?\n]+)", re.IGNORECASE
)
# a single quote counts only where it cannot be an apostrophe
_QUOTED = re.compile(r"\"([^\"]+)\"|“([^”]+)”|(?<!\w)'([^']+)'(?!\w)")


@dataclass(frozen=True)
class Prompts:
    """Objects to mask; `roles` maps "target" and "manipulated" to their index."""

    objects: tuple[str, ...]
    prompts: tuple[str, ...]
    roles: Mapping[str, int]


def parse_instruction(text: str) -> str:
    """Object phrase: after "target:", "object is", ...; else the longest quoted text; else all."""
    if labelled := _LABELLED.search(text):
        return labelled[1].strip()
    quoted = [next(g for g in m.groups() if g).strip() for m in _QUOTED.finditer(text)]
    return max(quoted, key=len) if quoted else text.strip()


def caption(phrase: str) -> str:
    """A phrase as GroundingDINO wants it: lower case, one closing dot."""
    return phrase.lower().strip().rstrip(".").strip() + "."


def ask(meta: EpisodeMeta, instruction: str, requested: Sequence[str], source: str) -> Prompts:
    """Objects and captions of an episode. Raises AnnotateError for an unknown object."""
    if source == "instruction":
        return Prompts(("instruction",), (caption(parse_instruction(instruction)),), {})
    by_request = {want: getattr(meta, want) if want in ROLES else want for want in requested}
    names = list(dict.fromkeys(by_request.values()))
    if odd := [name for name in names if name not in meta.objects]:
        known = ", ".join(meta.objects)
        raise AnnotateError(f"there is no object {odd[0]!r} in this episode: it has {known}")
    roles = {want: names.index(name) for want, name in by_request.items() if want in ROLES}
    word = "noun" if source == "metadata" else "description"
    phrases = [getattr(meta.objects[n], word) or n.replace("_", " ") for n in names]
    return Prompts(tuple(names), tuple(map(caption, phrases)), roles)


@dataclass(frozen=True)
class MaskStage:
    options: MaskOptions
    camera: str = HEAD
    render: Render | None = None
    device: str = "auto"
    detector: ModelFiles | None = None
    segmenter: ModelFiles | None = None

    name = "masks"
    version = 1

    def resolve(self, download: bool = True) -> "MaskStage":
        if not self.uses_models:
            return self
        names = (self.options.detector, self.options.segmenter)
        detector, segmenter = (resolve(name, download) for name in names)
        return replace(self, detector=detector, segmenter=segmenter)

    @property
    def uses_models(self) -> bool:
        return self.options.source == "model"

    def parameters(self) -> dict[str, Any]:
        o = self.options
        plain = {"camera": self.camera, "source": o.source, "objects": list(o.objects)}
        if not self.uses_models:
            return plain
        assert self.detector is not None and self.segmenter is not None
        names = ("prompt", "box_threshold", "text_threshold", "max_area")
        digests = {"detector": self.detector.digest, "segmenter": self.segmenter.digest}
        given = {name: getattr(o, name) for name in names}
        return plain | given | {"precision": "auto"} | digests

    def read(self, episode: EpisodeFile, dataset: Path, relative: Path) -> Reading:
        source = self.options.prompt if self.uses_models else "metadata"
        asked = ask(episode.meta, episode.instructions()[0], self.options.objects, source)
        named = {"objects": list(asked.objects), "roles": dict(asked.roles)}
        if not self.uses_models:
            inputs, view, bodies = sim_reading(episode, self.camera, False, self.render)
            return Reading(inputs | named, lambda: (asked, view().segmentation, bodies))
        frames = encoded_frames(episode, self.camera)
        inputs = frames_inputs(frames) | named | {"prompts": list(asked.prompts)}
        return Reading(inputs, lambda: (asked, decode_frames(frames)))

    def start(self) -> Callable[[Any], StageResult]:
        o = self.options
        if not self.uses_models:
            return lambda data: self._result(
                exact_masks(data[1], data[2], data[0].objects), data[0]
            )
        assert self.detector is not None and self.segmenter is not None
        device = pick_device(self.device)
        detector = load_detector(self.detector, device)
        segmenter = load_segmenter(self.segmenter, device)

        def compute(data: tuple[Prompts, Any]) -> StageResult:
            asked, frames = data
            return self._result(model_masks(detector, segmenter, frames, asked.prompts, o), asked)

        return compute

    def _result(self, masks: Masks, asked: Prompts) -> StageResult:
        height, width = masks.mask.shape[2:]
        arrays = {name: getattr(masks, name) for name in ("box", "score", "area", "valid")}
        attributes: dict[str, Any] = {
            "source": self.options.source,
            "objects": list(asked.objects),
            "roles": dict(asked.roles),
            "height": height,
            "width": width,
        }
        if self.uses_models:
            attributes |= {"prompts": list(asked.prompts), "phrases": masks.phrases}
        mask = {"mask": pack(masks.mask)}
        return StageResult(arrays | mask, attributes, compressed=("mask",))


@dataclass(frozen=True)
class FeatureStage:
    options: FeatureOptions
    masks: MaskStage
    encoder: ModelFiles
    device: str = "auto"

    name = "features"
    version = 1
    uses_models = True

    @property
    def camera(self) -> str:
        return self.masks.camera

    def parameters(self) -> dict[str, Any]:
        return {
            "camera": self.camera,
            "masks": directory_of(self.masks),
            "mask_source": self.masks.options.source,
            "encoder": self.encoder.digest,
            "size": self.options.size,
            "precision": "auto",
        }

    def read(self, episode: EpisodeFile, dataset: Path, relative: Path) -> Reading:
        masks, again = self.masks, "annotate stage masks first"
        path = annotation_path(dataset, directory_of(masks), relative)
        inputs = masks.read(episode, dataset, relative).inputs
        try:
            key, checksum = entry_header(path)
        except (FileNotFoundError, CorruptAnnotation) as error:
            raise NotReady(f"its masks are missing: {again}") from error
        if key != annotation_key(masks.name, masks.version, masks.parameters(), inputs):
            raise NotReady(f"its masks are stale: {again}")
        frames = encoded_frames(episode, self.camera)

        def decode() -> Any:
            entry = read_entry(path)
            return decode_frames(frames), entry.masks(), entry.attributes

        return Reading(frames_inputs(frames) | {"masks": checksum}, decode)

    def start(self) -> Callable[[Any], StageResult]:
        o = self.options
        encoder = load_encoder(self.encoder, o.size, pick_device(self.device))

        def compute(data: tuple[Any, Any, Any]) -> StageResult:
            frames, mask, of_masks = data
            feature, coverage = features_of(encoder, frames, mask, o.batch)
            arrays = {"feature": feature, "valid": coverage > 0, "coverage": coverage}
            attributes = {"objects": of_masks["objects"], "roles": of_masks["roles"]}
            return StageResult(arrays, attributes | {"mask_source": of_masks["source"]})

        return compute
