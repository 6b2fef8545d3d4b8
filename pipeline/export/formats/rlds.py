"""RLDS as TensorFlow Datasets stores it, without TensorFlow (docs/exports.md)."""

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from itertools import batched
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.data.episode.file import EpisodeFile
from pipeline.export.exporter import Exporter, Job, register
from pipeline.export.options import ImageOptions, LabelOptions, option, whole
from pipeline.export.shared.derived import label_values, labelled
from pipeline.export.shared.draft import ExportDraft
from pipeline.export.shared.episodes import (
    FAILURES,
    ExportError,
    Facts,
    exported_cameras,
    group_episodes,
    read_facts,
    reading,
)
from pipeline.export.shared.images import DEPTH, coded_images, reencode
from pipeline.export.shared.record import write_json
from pipeline.export.shared.tables import PROVENANCE, Provenance

from .tfrecord import Value, example, write_records

VERSION = "1.0.0"
SCALARS = {"task": str, "embodiment": str, "level": int, "alpha": float, "domain": str, "seed": int}


@dataclass(frozen=True)
class RldsOptions(ImageOptions, LabelOptions):
    shard_episodes: int = option("episodes of a TFRecord file", whole(1), 32)


@register
class Rlds(Exporter[RldsOptions]):
    name = "rlds"
    options = RldsOptions
    written = (DEPTH,)

    def write(self, job: Job[RldsOptions], draft: ExportDraft) -> dict[str, Any]:
        frames, cameras, directories = 0, dict[str, str](), list[str]()
        for name, paths in group_episodes(job.episodes, _name).items():
            directory, kinds, sizes = draft.folder / name / VERSION, dict[str, Any](), []
            directories.append(f"{name}/{VERSION}")
            with reading(paths[0]) as file:
                split = FAILURES if file.meta.failure else "train"
                first = read_facts(file, job.dataset)
            cameras |= exported_cameras(first, job.options.camera_names)
            shards = list(batched(paths, job.options.shard_episodes))
            with closing(Provenance(directory / PROVENANCE, draft)) as rows:
                for number, shard in enumerate(shards):
                    file_name = f"{name}-{split}.tfrecord-{number:05d}-of-{len(shards):05d}"
                    messages = _messages(job, shard, rows, kinds)
                    sizes.append(write_records(directory / file_name, messages))
            frames += rows.frames
            write_json(directory / "features.json", _nested(kinds))
            write_json(directory / "dataset_info.json", _info(name, split, sizes))
        counts = {"episodes": len(job.episodes), "frames": frames}
        return counts | {"cameras": cameras, "directories": directories}


def _name(spec: Any) -> str:
    return "domino_" + re.sub(r"[^a-z0-9]+", "_", spec.embodiment.lower())


def _messages(
    job: Job[RldsOptions], shard: Sequence[Path], rows: Provenance, kinds: dict[str, Any]
) -> Iterator[bytes]:
    """Messages of episodes, which are noted in `rows`; their features must be those in `kinds`,
    which the first fills."""
    for path in shard:
        with rows.noting(job, path) as (file, facts):
            features = episode_features(file, facts, job.options)
        own = {name: kind for name, (kind, _) in features.items()}
        if kinds not in ({}, own):
            raise ExportError(f"{facts.source}: has other sensors than the episodes before it")
        kinds |= own
        yield example({name: value for name, (_, value) in features.items()})


def episode_features(
    file: EpisodeFile, facts: Facts, options: RldsOptions
) -> dict[str, tuple[dict[str, Any], Value]]:
    """Kinds and values of an episode by feature; values of steps one after another."""
    count, frames = len(facts), np.arange(len(facts))
    last, success = frames == count - 1, facts.meta.failure is None
    flags = {"is_first": frames == 0, "is_last": last, "is_terminal": last & success}
    vectors = {"observation/state": facts.log.state, "action": facts.action}
    vectors |= label_values(facts, options.labels)
    scalars = {"reward": last & success, "discount": np.ones(count)}
    features: dict[str, tuple[dict[str, Any], Value]] = {
        "steps/language_instruction": (TEXT, [text.encode() for text in facts.spoken]),
        **{f"steps/{n}": (_tensor("bool"), flag.astype(np.int64)) for n, flag in flags.items()},
    }
    for name, rows in (vectors | scalars).items():
        kind = _tensor("float32", *rows.shape[1:])
        features[f"steps/{name}"] = kind, rows.astype(np.float32).ravel()
    texts = {"file_path": facts.source}
    if options.labels:
        texts["objects"] = ",".join(labelled(facts))
    if facts.dataset:
        texts["dataset"] = facts.dataset
    for name, kind in SCALARS.items():
        value = getattr(facts.spec, name)
        if kind is str:
            texts[name] = value
        else:
            dtype: Any = np.int64 if kind is int else np.float32
            number = _tensor(np.dtype(dtype).name), np.array([value], dtype)
            features[f"episode_metadata/{name}"] = number
    for name, text in texts.items():
        features[f"episode_metadata/{name}"] = TEXT, [text.encode()]
    for camera, name in exported_cameras(facts, options.camera_names).items():
        images = file.array(f"observation/{camera}/rgb")
        coded = [reencode(bytes(image), "rgb", options.size) for image in images]
        kind = _image((*(options.size or facts.size), 3), "uint8", "jpeg")
        features[f"steps/observation/{name}"] = kind, coded
        if file.has(f"observation/{camera}/depth"):
            kind, maps = (
                _image((*facts.size, 1), "uint16", "png"),
                coded_images(file, camera, DEPTH),
            )
            features[f"steps/observation/depth_{name}"] = kind, maps
    return features


def _nested(kinds: Mapping[str, Any]) -> dict[str, Any]:
    """The features of a dataset as TensorFlow Datasets groups them."""

    def below(prefix: str) -> dict[str, Any]:
        return {n.removeprefix(prefix): kind for n, kind in kinds.items() if n.startswith(prefix)}

    step = {name: kind for name, kind in below("steps/").items() if "/" not in name}
    step["observation"] = _group(below("steps/observation/"))
    steps = {
        "sequence": {"feature": _group(step), "length": "-1"},
        "pythonClassName": _class("dataset_feature.Dataset"),
    }
    metadata = _group(below("episode_metadata/"))
    return _group({"steps": steps, "episode_metadata": metadata})


def _class(name: str) -> str:
    return f"tensorflow_datasets.core.features.{name}"


TEXT = {"text": dict[str, Any](), "pythonClassName": _class("text_feature.Text")}


def _group(features: Mapping[str, Any]) -> dict[str, Any]:
    name = _class("features_dict.FeaturesDict")
    return {"featuresDict": {"features": dict(features)}, "pythonClassName": name}


def _shape(sizes: Sequence[int]) -> dict[str, Any]:
    return {"dimensions": [str(size) for size in sizes]} if sizes else {}


def _tensor(kind: str, *sizes: int) -> dict[str, Any]:
    name = _class("tensor_feature.Tensor" if sizes else "scalar.Scalar")
    tensor = {"dtype": kind, "encoding": "none", "shape": _shape(sizes)}
    return {"tensor": tensor, "pythonClassName": name}


def _image(sizes: Sequence[int], kind: str, encoding: str) -> dict[str, Any]:
    image = {"dtype": kind, "encodingFormat": encoding, "shape": _shape(sizes)}
    return {"image": image, "pythonClassName": _class("image_feature.Image")}


def _info(name: str, split: str, sizes: Sequence[Sequence[int]]) -> dict[str, Any]:
    """`sizes` are the bytes of each record by shard."""
    described = {
        "name": split,
        "filepathTemplate": "{DATASET}-{SPLIT}.{FILEFORMAT}-{SHARD_X_OF_Y}",
        "numBytes": str(sum(map(sum, sizes))),
        "shardLengths": [str(len(shard)) for shard in sizes],
    }
    return {"name": name, "version": VERSION, "fileFormat": "tfrecord", "splits": [described]}
