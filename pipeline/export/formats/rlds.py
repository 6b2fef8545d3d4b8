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
from pipeline.export.shared.derived import label_names, label_values, labelled
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
        groups = group_episodes(job.episodes, _name)
        for name, paths in groups.items():
            directory, features, facts = draft.folder / name / VERSION, dict[str, Any](), None
            directories.append(f"{name}/{VERSION}")
            with closing(Provenance(directory / PROVENANCE, draft)) as rows:
                for path in paths:
                    with reading(path) as file:
                        facts = read_facts(file, job.dataset, None, job.options.representation)
                        described = features_of(file, facts, job.options)
                    if described != (features := features or described):
                        raise ExportError(f"{facts.source}: has other sensors than {paths[0]}")
                    cameras |= exported_cameras(facts, job.options.camera_names)
                    rows.append(facts)
            frames += rows.frames
            split = FAILURES if facts and facts.meta.failure else "train"
            write_json(directory / "features.json", features)
            sizes = _write_shards(job, directory, f"{name}-{split}", paths)
            write_json(directory / "dataset_info.json", _info(name, split, sizes))
        counts = {"episodes": len(job.episodes), "frames": frames}
        return counts | {"cameras": cameras, "directories": directories}


def _name(spec: Any) -> str:
    return "domino_" + re.sub(r"[^a-z0-9]+", "_", spec.embodiment.lower())


def _write_shards(
    job: Job[RldsOptions], directory: Path, name: str, paths: Sequence[Path]
) -> list[list[int]]:
    shards = list(batched(paths, job.options.shard_episodes))
    sizes: list[list[int]] = []
    for number, shard in enumerate(shards):
        made = directory / f"{name}.tfrecord-{number:05d}-of-{len(shards):05d}"
        sizes.append(write_records(made, _messages(job.dataset, shard, job.options)))
        for _ in shard:
            job.advance()
    return sizes


def _messages(dataset: Path, shard: Sequence[Path], options: RldsOptions) -> Iterator[bytes]:
    for path in shard:
        with reading(path) as file:
            facts = read_facts(file, dataset, representation=options.representation)
            yield example(episode_features(file, facts, options))


def episode_features(file: EpisodeFile, facts: Facts, options: RldsOptions) -> dict[str, Value]:
    """Values of an episode by feature; those of steps one after another."""
    count, frames = len(facts), np.arange(len(facts))
    last, success = frames == count - 1, facts.meta.failure is None
    values: dict[str, Value] = {
        "steps/observation/state": facts.log.state.astype(np.float32).ravel(),
        "steps/action": facts.action.astype(np.float32).ravel(),
        "steps/language_instruction": [text.encode() for text in facts.spoken],
        "steps/reward": (last & success).astype(np.float32),
        "steps/discount": np.ones(count, np.float32),
        "steps/is_first": (frames == 0).astype(np.int64),
        "steps/is_last": last.astype(np.int64),
        "steps/is_terminal": (last & success).astype(np.int64),
    }
    for name, rows in label_values(facts, options.labels).items():
        values[f"steps/{name}"] = rows.astype(np.float32).ravel()
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
            values[f"episode_metadata/{name}"] = np.array([value], dtype)
    values |= {f"episode_metadata/{name}": [text.encode()] for name, text in texts.items()}
    for camera, name in exported_cameras(facts, options.camera_names).items():
        images = file.array(f"observation/{camera}/rgb")
        coded = [reencode(bytes(image), "rgb", options.size) for image in images]
        values[f"steps/observation/{name}"] = coded
        if file.has(f"observation/{camera}/depth"):
            values[f"steps/observation/depth_{name}"] = coded_images(file, camera, DEPTH)
    return values


def features_of(file: EpisodeFile, facts: Facts, options: RldsOptions) -> dict[str, Any]:
    width, size = len(facts.log.vector_names), options.size or facts.size
    observation: dict[str, Any] = {"state": _tensor("float32", width)}
    for camera, name in exported_cameras(facts, options.camera_names).items():
        observation[name] = _image((*size, 3), "uint8", "jpeg")
        if file.has(f"observation/{camera}/depth"):
            observation[f"depth_{name}"] = _image((*facts.size, 1), "uint16", "png")
    text = {"text": {}, "pythonClassName": _class("text_feature.Text")}
    step = {
        "observation": _group(observation),
        "action": _tensor("float32", len(facts.action_names)),
        "language_instruction": text,
        **{name: _tensor("float32") for name in ("reward", "discount")},
        **{name: _tensor("bool") for name in ("is_first", "is_last", "is_terminal")},
    }
    for name, parts in label_names(options.labels).items():
        step[name] = _tensor("float32", len(parts))
    kinds = {str: text, int: _tensor("int64"), float: _tensor("float32")}
    metadata = {"file_path": text} | {name: kinds[kind] for name, kind in SCALARS.items()}
    metadata |= {"objects": text} if options.labels else {}
    metadata |= {"dataset": text} if facts.dataset else {}
    steps = {
        "sequence": {"feature": _group(step), "length": "-1"},
        "pythonClassName": _class("dataset_feature.Dataset"),
    }
    return _group({"steps": steps, "episode_metadata": _group(metadata)})


def _class(name: str) -> str:
    return f"tensorflow_datasets.core.features.{name}"


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
