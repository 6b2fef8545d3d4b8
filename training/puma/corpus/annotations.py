"""The annotations of a dataset that a configuration needs; the command that makes missing or stale
ones."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.annotate.stage import AnnotateError
from pipeline.annotate.store import entry_header, find_stage
from pipeline.data.slots.annotations import CorruptAnnotation, annotation_path, read_entry
from training.puma.config import Config
from training.puma.errors import TrainError


@dataclass(frozen=True)
class NeededAnnotations:
    """The annotations of `dataset` that a configuration needs. Raises TrainError, one line with the
    command that makes them."""

    dataset: Path
    config: Config

    @cached_property
    def directories(self) -> dict[str, str]:
        """Stage -> directory of the annotations that are read."""
        model, data = self.config.model, self.config.data
        camera, found = data.cameras[0], dict[str, str]()
        wanted: dict[str, dict[str, Any]] = {}
        if model.history == "flow":
            size = [data.flow_size[1], data.flow_size[0]]
            wanted["flow"] = {
                "camera": camera,
                "stride": model.stride,
                "source": data.flow_source,
                "size": size,
            }
        if model.world == "features":
            wanted["features"] = {"camera": camera}
        if model.world == "boxes":
            wanted["masks"] = {"camera": camera}
        for stage, parameters in wanted.items():
            try:
                found[stage] = find_stage(self.dataset, stage, **parameters)
            except AnnotateError as error:
                if "several" in str(error):
                    raise TrainError(f"{error} or delete all but one") from error
                command = self.command(stage) + (" --mask-source sim" if stage == "masks" else "")
                raise TrainError(
                    f"{self.dataset} has no annotations {stage}; run: {command}"
                ) from error
        return found

    def command(self, stage: str) -> str:
        """The command that makes a stage's annotations."""
        model, data = self.config.model, self.config.data
        options = (
            f"--stages {'masks,features' if stage == 'features' else stage} --cameras"
            f" {data.cameras[0]}"
        )
        if stage == "flow":
            size = f"{data.flow_size[1]}x{data.flow_size[0]}"
            options += (
                f" --flow-stride {model.stride} --flow-size {size} --flow-source {data.flow_source}"
            )
        return f"domino-data annotate {self.dataset} {options}"

    def checksums(self, paths: Sequence[Path]) -> dict[str, list[str]]:
        """Stage -> checksums of the annotations of episode files, relative to episodes/."""
        return {
            stage: [
                self._header(stage, annotation_path(self.dataset, directory, path))
                for path in paths
            ]
            for stage, directory in self.directories.items()
        }

    def _header(self, stage: str, path: Path) -> str:
        try:
            return entry_header(path)[1]
        except (FileNotFoundError, CorruptAnnotation) as error:
            raise TrainError(
                f"{path}: is missing or damaged; run: {self.command(stage)}"
            ) from error

    def read(
        self, episode: Path, target: str, length: int, frames: str
    ) -> dict[str, dict[str, NDArray[Any]]]:
        """Stage -> arrays (T, ...) of an episode file, those by object only of the `target`.

        Raises TrainError if they have not `length` frames, or were made from images of another
        digest than `frames`."""
        found = dict[str, dict[str, NDArray[Any]]]()
        for stage, directory in self.directories.items():
            path = annotation_path(self.dataset, directory, episode)
            try:
                entry = read_entry(path)
            except (FileNotFoundError, CorruptAnnotation) as error:
                raise TrainError(
                    f"{path}: is missing or damaged; run: {self.command(stage)}"
                ) from error
            made_from = entry.attributes.get("inputs", {}).get("frames", frames)
            if made_from != frames or any(len(a) != length for a in entry.arrays.values()):
                raise TrainError(f"{path}: was made from other images; run: {self.command(stage)}")
            found[stage] = _of_target(entry.arrays, entry.attributes, target)
        return found


def _of_target(
    arrays: Mapping[str, NDArray[Any]], attributes: Mapping[str, Any], target: str
) -> dict[str, NDArray[Any]]:
    """Arrays (T, ...); those by object only of the target. Where no object is named like it, the
    first one."""
    objects = attributes.get("objects")
    if objects is None:
        return dict(arrays)
    k = int(
        attributes.get("roles", {}).get("target", objects.index(target) if target in objects else 0)
    )
    out = {key: value[:, k] for key, value in arrays.items() if key in ("box", "valid", "feature")}
    if "height" in attributes:
        out["size"] = np.repeat([[attributes["width"], attributes["height"]]], len(out["valid"]), 0)
    return out
