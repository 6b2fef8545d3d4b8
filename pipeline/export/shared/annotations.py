"""Annotations of a dataset as columns, one value a frame: flow maps, masks as run lengths,
features.

Columns are named by stage and camera; the eight digits of <stage>@<key8> follow where two
directories would get the same. Episodes without the annotation have nulls.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.data.episode.file import EpisodeError, EpisodeFile
from pipeline.data.keys import arrays_digest, frames_digest
from pipeline.data.names import EXPORTED_CAMERAS
from pipeline.data.slots.annotations import (
    CorruptAnnotation,
    Entry,
    annotation_path,
    read_entry,
    stages_of,
)
from pipeline.export.shared.episodes import ExportError, Facts
from pipeline.export.shared.sensors import IMAGE, image_column, png

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
"""Columns of each stage, before the camera is added to their names."""


@dataclass(frozen=True)
class Joined:
    """A directory of annotations: its name, stage, parameters, and the ending of its columns."""

    directory: str
    stage: str
    parameters: Mapping[str, Any]
    suffix: str

    @property
    def columns(self) -> dict[str, pa.DataType]:
        """Column -> Arrow type."""
        return {f"{name}_{self.suffix}": kind for name, kind in COLUMNS[self.stage].items()}

    def file(self, dataset: Path, source: str) -> Path:
        """The annotation file of an episode."""
        relative = (
            Path(source).relative_to("episodes") if source.startswith("episodes/") else Path(source)
        )
        return annotation_path(dataset, self.directory, relative)


def joined_of(dataset: Path, chosen: str, names: Mapping[str, str]) -> list[Joined]:
    """The annotations to join: "all", "none" or names separated by commas. Raises ExportError."""
    there = {d: s for d, s in stages_of(dataset).items() if s["stage"] in COLUMNS}
    wanted = {"all": list(there), "none": []}.get(chosen, chosen.split(","))
    if missing := sorted(set(wanted) - set(there)):
        raise ExportError(
            f"--annotations: there is no {missing[0]}; there are: {', '.join(there) or 'none'}"
        )
    cameras = EXPORTED_CAMERAS | dict(names)
    plain = {}
    for d in wanted:
        camera = str(there[d]["parameters"]["camera"])
        plain[d] = cameras.get(camera, camera)
    twice = Counter((there[d]["stage"], camera) for d, camera in plain.items())
    out = []
    for d in sorted(wanted):
        stage = there[d]["stage"]
        suffix = plain[d] if twice[stage, plain[d]] == 1 else f"{plain[d]}_{d.split('@')[1]}"
        out.append(Joined(d, stage, there[d]["parameters"], suffix))
    return out


def annotation_columns(
    joined: Sequence[Joined], dataset: Path, file: EpisodeFile, facts: Facts
) -> dict[str, pa.Array]:
    """Columns of an open episode. Raises ExportError for an annotation that is damaged or stale."""
    columns: dict[str, pa.Array] = {}
    source, frames = facts.source, len(facts)
    for one in joined:
        path, stage = one.file(dataset, source), {"stage": one.stage, "parameters": one.parameters}
        try:
            entry = read_entry(path)
        except FileNotFoundError:
            columns |= {name: pa.nulls(frames, kind) for name, kind in one.columns.items()}
            continue
        except CorruptAnnotation as error:
            raise ExportError(str(error)) from error
        lengths = {len(a) for a in entry.arrays.values()}
        if lengths != {frames}:
            raise ExportError(
                f"{path}: is not of the {frames} frames of {source}; run {command(dataset, stage)}"
            )
        if why := stale(entry, stage, file, facts, dataset):
            raise ExportError(f"{path}: is out of date, {why}; run {command(dataset, stage)}")
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
    for t, packed in enumerate(a["mask"]):
        bits = np.unpackbits(packed, axis=-1, count=size["height"] * size["width"]).astype(bool)
        numbers = {key: a[key][t] for key in ("box", "score", "area", "valid")}
        rows.append(
            [
                {"object": name, **size, "counts": run_lengths(bits[k].reshape(*size.values()))}
                | {key: values[k].tolist() for key, values in numbers.items()}
                for k, name in enumerate(entry.attributes["objects"])
            ]
        )
    return [rows]


def _features(entry: Entry) -> list[Any]:
    a, names = entry.arrays, entry.attributes["objects"]
    numbers = {key: a[key] for key in ("feature", "valid", "coverage")}
    return [
        [
            [
                {"object": name} | {key: values[t, k].tolist() for key, values in numbers.items()}
                for k, name in enumerate(names)
            ]
            for t in range(len(a["feature"]))
        ]
    ]


def run_lengths(mask: NDArray[np.bool_]) -> list[int]:
    """COCO's uncompressed run lengths of a mask (H,W)."""
    flat = mask.ravel(order="F")
    edges = np.flatnonzero(np.diff(flat)) + 1
    runs = np.diff(np.concatenate([[0], edges, [flat.size]])).tolist()
    return [0, *runs] if flat[0] else runs


TRUTH = {"flow": ("actor_segmentation", "depth"), "masks": ("actor_segmentation",)}
"""Arrays of a camera that a stage reads where it is computed from the simulator's truth."""


def stale(
    entry: Entry, stage: Mapping[str, Any], file: EpisodeFile, facts: Facts, dataset: Path
) -> str | None:
    """Which input of an annotation is not the open episode's, or None; `stage` is stage.json.
    Sentences are not compared."""
    inputs = entry.attributes.get("inputs")
    if not isinstance(inputs, Mapping):
        return "it does not name what it was made from"
    now = dict(_inputs(inputs, stage, file, facts, dataset))
    changed = [name for name, value in now.items() if inputs[name] != value]
    known = {"frames": "images", "scene": "physics", "stored": "truth"}
    return f"it was made from other {known.get(changed[0], changed[0])}" if changed else None


def _inputs(
    inputs: Mapping[str, Any],
    stage: Mapping[str, Any],
    file: EpisodeFile,
    facts: Facts,
    dataset: Path,
) -> Iterator[tuple[str, Any]]:
    camera = str(stage["parameters"]["camera"])
    if camera not in facts.cameras:
        yield next(name for name in ("frames", "scene") if name in inputs), None
        return
    if "frames" in inputs:
        yield "frames", frames_digest(file.array(f"observation/{camera}/rgb").tolist())
    if "scene" in inputs:
        k = file.array(f"observation/{camera}/intrinsic_cv")[0]
        state = {"poses": facts.log.poses, "camera": facts.camera_poses[camera], "k": k}
        yield "scene", {"bodies": list(facts.log.bodies), "state": arrays_digest(state)}
    if "assets" in inputs:
        yield "assets", dict(facts.meta.drawing.assets)
    if "stored" in inputs:
        yield "stored", _read_hash(file, camera, TRUTH[stage["stage"]])
    if "masks" in inputs:
        yield "masks", _masks_hash(dataset, str(stage["parameters"]["masks"]), facts)


def _read_hash(file: EpisodeFile, camera: str, names: tuple[str, ...]) -> str | None:
    try:
        return arrays_digest({name: file.array(f"observation/{camera}/{name}") for name in names})
    except EpisodeError:
        return None


def _masks_hash(dataset: Path, directory: str, facts: Facts) -> str | None:
    try:
        return read_entry(
            annotation_path(dataset, directory, Path(facts.source).relative_to("episodes"))
        ).checksum
    except (FileNotFoundError, CorruptAnnotation, ValueError):
        return None


def command(dataset: Path, stage: Mapping[str, Any]) -> str:
    """The command that annotates again as a stage.json says."""
    name, said = stage["stage"], stage["parameters"]
    stages = "masks,features" if name == "features" else name
    options = {"--stages": stages, "--cameras": said["camera"]}
    if name == "flow":
        size = said.get("size")
        options |= {"--flow-source": said.get("source"), "--flow-stride": said.get("stride")}
        options["--flow-size"] = f"{size[1]}x{size[0]}" if size else None
    else:
        source = "mask_source" if name == "features" else "source"
        options |= {"--mask-source": said.get(source), "--prompt": said.get("prompt")}
    return f"domino-data annotate {dataset} " + " ".join(
        f"{o} {value}" for o, value in options.items() if value is not None
    )
