"""Annotations of a dataset as columns, one value a frame; nulls for episodes without them."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from pipeline.data.episode.file import EpisodeError, EpisodeFile
from pipeline.data.keys import arrays_digest, frames_digest
from pipeline.data.names import EXPORTED_CAMERAS
from pipeline.data.slots.annotations import (
    CorruptAnnotation,
    Entry,
    annotation_path,
    read_entry,
    scene_input,
    stages_of,
)
from pipeline.poses import Bools

from .episodes import ExportError, Facts
from .images import IMAGE, image_column, png

_FLOATS, _NUMBER, _FLAG = pa.list_(pa.float32()), pa.int32(), pa.bool_()
MASK = pa.struct(
    {
        **{"object": pa.string(), "height": _NUMBER, "width": _NUMBER},
        **{"counts": pa.list_(_NUMBER), "box": _FLOATS, "score": pa.float32()},
        **{"area": _NUMBER, "valid": _FLAG},
    }
)
FEATURE = pa.struct(
    {"object": pa.string(), "feature": _FLOATS, "valid": _FLAG, "coverage": pa.float32()}
)
COLUMNS: dict[str, dict[str, pa.DataType]] = {
    "flow": {
        **{"flow": pa.binary(), "flow_rgb": IMAGE},
        **{"flow_scale": pa.float32(), "flow_previous": pa.int64()},
    },
    "masks": {"masks": pa.list_(MASK)},
    "features": {"features": pa.list_(FEATURE)},
}

TRUTH = {"flow": ("actor_segmentation", "depth"), "masks": ("actor_segmentation",)}
"""Arrays of a camera that a stage reads where it is computed from the simulator's truth."""


@dataclass(frozen=True)
class Joined:
    directory: str
    stage: str
    parameters: Mapping[str, Any]
    suffix: str

    @property
    def columns(self) -> dict[str, pa.DataType]:
        return {f"{name}_{self.suffix}": kind for name, kind in COLUMNS[self.stage].items()}

    def file(self, dataset: Path, source: str) -> Path:
        return annotation_path(dataset, self.directory, Path(source.removeprefix("episodes/")))


def joined_of(dataset: Path, chosen: str, names: Mapping[str, str]) -> list[Joined]:
    """ "all", "none" or names separated by commas. Raises ExportError."""
    there = {d: s for d, s in stages_of(dataset).items() if s["stage"] in COLUMNS}
    wanted = {"all": list(there), "none": []}.get(chosen, chosen.split(","))
    if missing := sorted(set(wanted) - set(there)):
        known = ", ".join(there) or "none"
        raise ExportError(f"--annotations: there is no {missing[0]}; there are: {known}")
    cameras, plain = EXPORTED_CAMERAS | dict(names), dict[str, str]()
    for d in wanted:
        camera = str(there[d]["parameters"]["camera"])
        plain[d] = cameras.get(camera, camera)
    twice = Counter((there[d]["stage"], camera) for d, camera in plain.items())
    joined = []
    for d in sorted(wanted):
        stage = there[d]["stage"]
        suffix = plain[d] if twice[stage, plain[d]] == 1 else f"{plain[d]}_{d.split('@')[1]}"
        joined.append(Joined(d, stage, there[d]["parameters"], suffix))
    return joined


def annotation_columns(
    joined: Sequence[Joined], dataset: Path, file: EpisodeFile, facts: Facts
) -> dict[str, pa.Array]:
    """Columns of an open episode. Raises ExportError for a damaged or stale annotation."""
    columns: dict[str, pa.Array] = {}
    again = f"run domino-data annotate {dataset} with the options of its stage.json"
    for one in joined:
        path, stage = one.file(dataset, facts.source), vars(one)
        try:
            entry = read_entry(path)
        except FileNotFoundError:
            columns |= {name: pa.nulls(len(facts), kind) for name, kind in one.columns.items()}
            continue
        except CorruptAnnotation as error:
            raise ExportError(str(error)) from error
        if {len(a) for a in entry.arrays.values()} != {len(facts)}:
            raise ExportError(f"{path}: is not of the {len(facts)} frames of its episode; {again}")
        if why := stale(entry, stage, file, facts, dataset):
            raise ExportError(f"{path}: is out of date, {why}; {again}")
        made = {"flow": _flow, "masks": _masks, "features": _features}[one.stage](entry)
        for (name, kind), values in zip(one.columns.items(), made, strict=True):
            columns[name] = values if isinstance(values, pa.Array) else pa.array(values, kind)
    return columns


def _flow(entry: Entry) -> list[Any]:
    a = entry.arrays
    maps = [flow.astype("<f2").tobytes() for flow in a["flow"]]
    images = image_column([png(rgb[..., ::-1]) for rgb in a["rgb"]])
    return [maps, images, a["scale"].astype(np.float32), a["previous"].astype(np.int64)]


def _masks(entry: Entry) -> list[Any]:
    a, size = entry.arrays, {key: entry.attributes[key] for key in ("height", "width")}
    rows = list[list[dict[str, Any]]]()
    for t in range(len(a["mask"])):
        counts = [{"counts": run_lengths(mask)} for mask in entry.masks(t)]
        numbers = _objects(entry, t, ("box", "score", "area", "valid"))
        pairs = zip(numbers, counts, strict=True)
        rows.append([{**number, **size, **count} for number, count in pairs])
    return [rows]


def _features(entry: Entry) -> list[Any]:
    keys, frames = ("feature", "valid", "coverage"), range(len(entry.arrays["feature"]))
    return [[_objects(entry, t, keys) for t in frames]]


def _objects(entry: Entry, t: int, keys: Sequence[str]) -> list[dict[str, Any]]:
    return [
        {"object": name} | {key: entry.arrays[key][t, k].tolist() for key in keys}
        for k, name in enumerate(entry.attributes["objects"])
    ]


def run_lengths(mask: Bools) -> list[int]:
    """COCO's uncompressed run lengths of a mask (H,W)."""
    flat = mask.ravel(order="F")
    edges = np.flatnonzero(np.diff(flat)) + 1
    runs = np.diff(np.concatenate([[0], edges, [flat.size]])).tolist()
    return [0, *runs] if flat[0] else runs


def stale(
    entry: Entry, stage: Mapping[str, Any], file: EpisodeFile, facts: Facts, dataset: Path
) -> str | None:
    """Which input is not the open episode's, or None; `stage` is stage.json."""
    inputs = entry.attributes.get("inputs")
    if not isinstance(inputs, Mapping):
        return "it does not name what it was made from"
    known = {"frames": "images", "scene": "physics", "stored": "truth"}
    for name, value in _inputs(stage, file, facts, dataset):
        if name in inputs and inputs[name] != value():
            return f"it was made from other {known.get(name, name)}"
    return None


def _inputs(
    stage: Mapping[str, Any], file: EpisodeFile, facts: Facts, dataset: Path
) -> Iterator[tuple[str, Callable[[], Any]]]:
    camera = str(stage["parameters"]["camera"])
    there, group = camera in facts.cameras, f"observation/{camera}"

    def stored() -> Any:
        with suppress(EpisodeError):
            names = TRUTH[stage["stage"]]
            return arrays_digest({name: file.array(f"{group}/{name}") for name in names})

    def masks() -> Any:
        with suppress(FileNotFoundError, CorruptAnnotation):
            directory = str(stage["parameters"]["masks"])
            relative = Path(facts.source.removeprefix("episodes/"))
            return read_entry(annotation_path(dataset, directory, relative)).checksum

    yield "frames", lambda: there and frames_digest(file.array(f"{group}/rgb").tolist())
    yield "scene", lambda: there and scene_input(file, facts.log, camera)
    yield "assets", lambda: dict(facts.meta.drawing.assets)
    yield "stored", stored
    yield "masks", masks
