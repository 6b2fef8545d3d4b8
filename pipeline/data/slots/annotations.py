"""Annotations: OUT/annotations/<stage>@<key8>/<episode path>.h5 and stage.json, arrays by
absolute frame.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from pipeline.data.episode.file import INFLATION, EpisodeFile
from pipeline.data.episode.hdf5 import check_dataset, open_hdf5
from pipeline.data.episode.state_log import StateLog
from pipeline.data.errors import DAMAGE
from pipeline.data.keys import arrays_digest, canonical
from pipeline.data.parsing import parse_json
from pipeline.data.reading import read_regular
from pipeline.poses import Bools


class CorruptAnnotation(Exception):
    """An annotation that cannot be read, or is not what was written."""


@dataclass(frozen=True, eq=False)
class Entry:
    """One annotation file."""

    key: str
    arrays: Mapping[str, NDArray[Any]]
    attributes: Mapping[str, Any]
    checksum: str

    def masks(self, at: Any = ...) -> Bools:
        """Masks (...,H,W) that are stored as bits: (T,K,...), or those `at` an index."""
        height, width = self.attributes["height"], self.attributes["width"]
        bits = np.unpackbits(self.arrays["mask"][at], axis=-1, count=height * width)
        return bits.reshape(*bits.shape[:-1], height, width).astype(bool)


def annotation_path(dataset: Path, directory: str, episode: Path) -> Path:
    """An episode's file in a directory such as "flow@0a1b2c3d". Raises ValueError."""
    if "/" in directory or directory.startswith("."):
        raise ValueError(f"{directory[:80]!r} is no directory of annotations")
    return Path(dataset) / "annotations" / directory / episode.with_suffix(".h5")


def scene_input(episode: EpisodeFile, log: StateLog, camera: str) -> dict[str, Any]:
    """The physics that images of a camera show, and how late, as an input of annotations."""
    camera, sensors = f"observation/{camera}", episode.meta.drawing.sensors
    k = episode.array(f"{camera}/intrinsic_cv")[0]
    state = {"poses": log.poses, "camera": episode.array(f"{camera}/pose"), "k": k}
    late = {"latency": sensors.latency} if sensors and sensors.latency else {}
    return {"bodies": list(log.bodies), "state": arrays_digest(state), **late}


def checksum(arrays: Mapping[str, NDArray[Any]], attributes: Mapping[str, Any]) -> str:
    """sha256 of arrays and attributes."""
    text = canonical(dict(attributes)).decode()
    return hashlib.sha256(canonical([arrays_digest(arrays), text])).hexdigest()


def read_entry(path: Path) -> Entry:
    """A checked annotation. Raises FileNotFoundError, CorruptAnnotation."""
    if not path.is_file():
        raise FileNotFoundError(path)
    try:
        with open_hdf5(path) as f:
            items = [item for item in f.values() if isinstance(item, h5py.Dataset)]
            for item in items:
                check_dataset(item.id)
            if (claimed := sum(item.nbytes for item in items)) > INFLATION * path.stat().st_size:
                raise ValueError(f"claims {claimed} bytes, more than the file can hold")
            arrays = {str(name): np.asarray(f[name]) for name in f}
            attributes = json.loads(str(f.attrs["attributes"]))
            entry = Entry(str(f.attrs["key"]), arrays, attributes, str(f.attrs["checksum"]))
        if checksum(arrays, attributes) != entry.checksum:
            raise ValueError("its content does not match its checksum")
    except DAMAGE as error:
        raise CorruptAnnotation(
            f"{path}: cannot be read ({error}); run annotate again to recompute it"
        ) from error
    return entry


def stages_of(dataset: Path) -> dict[str, dict[str, Any]]:
    """The stage.json of every stage directory by its name, sorted."""
    found = sorted((Path(dataset) / "annotations").glob("*@*/stage.json"))
    return {path.parent.name: parse_json(read_regular(path)) for path in found}
