"""robomimic HDF5, which Diffusion Policy reads, too (docs/exports.md)."""

import hashlib
import json
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pipeline.data.actions import Representation
from pipeline.data.episode.file import EpisodeFile
from pipeline.data.episode.hdf5 import new_hdf5
from pipeline.data.slots.select import VALIDATION
from pipeline.export.exporter import register
from pipeline.export.options import ImageOptions
from pipeline.export.shared.episodes import Facts, described_action
from pipeline.export.shared.images import DEPTH, resize
from pipeline.export.shared.tables import PROVENANCE
from pipeline.poses import Floats32

from .hdf5_files import Contents, Hdf5Exporter

INDEX, DEMOS = "demos.hdf5", "demos"
GYM_TYPE = 2
"""robomimic's number for environments that are not robosuite's."""

HELD_OUT = 10
"""One of so many values of `physics_id` is for validation."""


@dataclass(frozen=True)
class RobomimicOptions(ImageOptions):
    @property
    def representations(self) -> tuple[Representation, ...]:
        chosen = self.representation
        return (chosen, replace(chosen, actions=chosen.kind))


@register
class Robomimic(Hdf5Exporter[RobomimicOptions]):
    name = "robomimic"
    options = RobomimicOptions
    written = (DEPTH,)

    def file(self, directory: Path, index: int) -> Path:
        return directory / DEMOS / f"demo_{index}.hdf5"

    def contents(
        self, file: EpisodeFile, facts: Facts, options: RobomimicOptions, shared: None
    ) -> Contents:
        log, last = facts.log, np.arange(len(facts)) == len(facts) - 1
        spin = [] if log.target_angular_velocity is None else [log.target_angular_velocity]
        vectors: dict[str, NDArray[Any]] = {
            "joint_pos": log.state,
            **{f"{side}_eef_pose": log.tcp[:, i] for i, side in enumerate(log.sides)},
            "object": np.hstack([facts.target, log.target_velocity, *spin]),
        }
        obs: dict[str, NDArray[Any]] = {
            f"obs/{name}": value.astype(np.float32) for name, value in vectors.items()
        }
        for camera, name in self.cameras(facts, options).items():
            images = (resize(image, options.size) for image in file.frames(camera))
            obs[f"obs/{name}_image"] = np.stack(list(images))
            if file.has(f"observation/{camera}/depth"):
                depth = file.array(f"observation/{camera}/depth") / np.float32(1000)
                maps = [_nearest(image, options.size) for image in depth]
                obs[f"obs/{name}_depth"] = np.stack(maps)[..., None]
        values = {
            "actions": facts.action.astype(np.float32),
            "rewards": (last & (facts.meta.failure is None)).astype(np.float32),
            "dones": last.astype(np.int64),
            "states": np.zeros((len(facts), 0), np.float32),
            **obs,
        }
        if facts.representation.reference != "absolute":
            target = replace(facts.representation, actions=facts.representation.kind)
            values["abs_actions"] = facts.written(log.action, target).astype(np.float32)
        attributes = {
            "num_samples": len(facts),
            "task": facts.spec.task,
            "embodiment": facts.spec.embodiment,
            "instruction": facts.instruction,
            "names": list(log.vector_names),
            **described_action(facts),
            "fps": facts.fps,
            "spec": facts.spec.to_json(),
        }
        return Contents(values, attributes, {f"next_{key}": key for key in obs})

    def finish(self, directory: Path, validation: float, notes: Sequence[Any]) -> None:
        columns = ["length", "task", "level", "physics_id", "source", "split"]
        rows = pq.read_table(directory / PROVENANCE, columns=columns).to_pylist()
        masks: dict[str, list[str]] = defaultdict(list)
        for index, row in enumerate(rows):
            task = row["task"]
            for name in (_split(row, validation), task, f"{task}_L{row['level']}"):
                masks[name].append(f"demo_{index}")
        tasks = sorted({row["task"] for row in rows})
        environment = {"env_name": "+".join(tasks), "type": GYM_TYPE, "env_kwargs": {}}
        with new_hdf5(directory / INDEX) as f:
            data, mask = f.create_group("data"), f.create_group("mask")
            data.attrs["total"] = sum(row["length"] for row in rows)
            data.attrs["env_args"] = json.dumps(environment)
            for index in range(len(rows)):
                data[f"demo_{index}"] = h5py.ExternalLink(f"{DEMOS}/demo_{index}.hdf5", "/")
            for name in sorted(masks):
                mask[name] = np.array(masks[name], "S")


def _split(row: Mapping[str, Any], validation: float) -> str:
    """Every tenth `physics_id` by hash, or the --validation split."""
    if validation != VALIDATION:
        return "valid" if row["split"] == "validation" else "train"
    identity = row["physics_id"] or row["source"]
    return "train" if int(hashlib.sha256(identity.encode()).hexdigest(), 16) % HELD_OUT else "valid"


def _nearest(depth: Floats32, size: tuple[int, int] | None) -> Floats32:
    """Depth (H,W), without mixing near and far values."""
    if size is None:
        return depth
    rows, columns = (np.arange(n) * m // n for n, m in zip(size, depth.shape, strict=True))
    return depth[np.ix_(rows, columns)]
