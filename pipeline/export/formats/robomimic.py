"""robomimic HDF5, also for Diffusion Policy and MimicGen's tools; docs/exports.md has the layout.

demos.hdf5 links to demos/demo_{i}.hdf5. `next_obs` is a reference to `obs` a frame later. `object`
is pose, linear and angular velocity of the target; (T,10) without the last in old episodes. Masks:
`train`, `valid` (every tenth `physics_id` by hash, or the --validation split), each task and level.
"""

import hashlib
import json
from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
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
from pipeline.export.formats.hdf5_files import Contents, Hdf5Exporter
from pipeline.export.options import ActionOptions, camera_names_option, image_size, option
from pipeline.export.shared.episodes import (
    Facts,
    by_embodiment,
    described_action,
    exported_cameras,
)
from pipeline.export.shared.images import resize
from pipeline.export.shared.provenance import PROVENANCE

INDEX, DEMOS = "demos.hdf5", "demos"
GYM_TYPE = 2
"""robomimic's number for environments that are not robosuite's."""

HELD_OUT = 10
"""One of so many values of `physics_id` is for validation."""


@dataclass(frozen=True)
class RobomimicOptions(ActionOptions):
    """Options of the format; `size` is (height, width) in pixels."""

    size: tuple[int, int] | None = option(
        "WIDTHxHEIGHT in pixels to resize images to, like 84x84", image_size, None
    )
    camera_names: Mapping[str, str] = camera_names_option()

    @property
    def representations(self) -> tuple[Representation, ...]:
        """With that of `abs_actions`."""
        chosen = self.representation
        return (chosen, replace(chosen, actions=chosen.kind))


@register
class Robomimic(Hdf5Exporter[RobomimicOptions]):
    """One dataset a robot."""

    name = "robomimic"
    options = RobomimicOptions

    def sensors(self, options: RobomimicOptions) -> Collection[str]:
        return ("depth",)

    def directories(self, episodes: Sequence[Path], out: Path) -> dict[Path, list[Path]]:
        return dict(by_embodiment(episodes, out).values())

    def file(self, directory: Path, index: int) -> Path:
        return directory / DEMOS / f"demo_{index}.hdf5"

    def cameras(self, facts: Facts, options: RobomimicOptions) -> dict[str, str]:
        return exported_cameras(facts, options.camera_names)

    def contents(
        self, file: EpisodeFile, facts: Facts, options: RobomimicOptions, shared: None
    ) -> Contents:
        log, last = facts.log, np.arange(len(facts)) == len(facts) - 1
        spin = [] if log.target_angular_velocity is None else [log.target_angular_velocity]
        obs: dict[str, NDArray[Any]] = {
            "joint_pos": log.state,
            **{f"{side}_eef_pose": log.tcp[:, i] for i, side in enumerate(log.sides)},
            "object": np.hstack([facts.target, log.target_velocity, *spin]),
        }
        obs = {f"obs/{name}": value.astype(np.float32) for name, value in obs.items()}
        for camera, name in self.cameras(facts, options).items():
            obs[f"obs/{name}_image"] = np.stack(
                [resize(image, options.size) for image in file.frames(camera)]
            )
            if file.has(f"observation/{camera}/depth"):
                depth = file.array(f"observation/{camera}/depth") / np.float32(1000)
                obs[f"obs/{name}_depth"] = np.stack(
                    [_nearest(image, options.size) for image in depth]
                )[..., None]
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

    def finish(self, directory: Path, validation: float) -> None:
        """Write demos.hdf5."""
        attributes, masks, count = index_of(directory / PROVENANCE, validation)
        with new_hdf5(directory / INDEX) as f:
            data, mask = f.create_group("data"), f.create_group("mask")
            data.attrs.update(attributes)
            for index in range(count):
                data[f"demo_{index}"] = h5py.ExternalLink(f"{DEMOS}/demo_{index}.hdf5", "/")
            for name, demos in masks.items():
                mask[name] = np.array(demos, "S")


def index_of(
    provenance: Path, validation: float
) -> tuple[dict[str, Any], dict[str, list[str]], int]:
    """Attributes, demos by mask, and the number of demos, from an episodes.parquet."""
    rows = pq.read_table(
        provenance, columns=["length", "task", "level", "physics_id", "source", "split"]
    ).to_pylist()
    masks: dict[str, list[str]] = defaultdict(list)
    for index, row in enumerate(rows):
        for name in (_split(row, validation), row["task"], f"{row['task']}_L{row['level']}"):
            masks[name].append(f"demo_{index}")
    tasks = sorted({row["task"] for row in rows})
    environment = {"env_name": "+".join(tasks), "type": GYM_TYPE, "env_kwargs": {}}
    attributes = {"total": sum(row["length"] for row in rows), "env_args": json.dumps(environment)}
    return attributes, {name: masks[name] for name in sorted(masks)}, len(rows)


def _split(row: Mapping[str, Any], validation: float) -> str:
    if validation != VALIDATION:
        return "valid" if row["split"] == "validation" else "train"
    identity = row["physics_id"] or row["source"]
    return "train" if int(hashlib.sha256(identity.encode()).hexdigest(), 16) % HELD_OUT else "valid"


def _nearest(depth: NDArray[np.float32], size: tuple[int, int] | None) -> NDArray[np.float32]:
    """Depth (H,W) at another size, without mixing near and far values."""
    if size is None:
        return depth
    rows, columns = (np.arange(n) * m // n for n, m in zip(size, depth.shape, strict=True))
    return depth[np.ix_(rows, columns)]
