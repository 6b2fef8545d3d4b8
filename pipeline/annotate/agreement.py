"""How well the detector's masks agree with the simulator's, where a dataset has both."""

import json
import os
from collections import defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.annotate.keys import AnnotateError
from pipeline.annotate.masks import unpack
from pipeline.annotate.store import CorruptAnnotation, Entry, annotation_path, find_stage, read_entry

GOOD_IOU = 0.5


def iou(a: NDArray[np.bool_], b: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Intersection over union (...) of masks (...,H,W); 0 where both are empty."""
    both, either = (a & b).sum((-2, -1)), (a | b).sum((-2, -1))
    return both / np.maximum(either, 1)


def agreement(dataset: Path, episodes: Iterable[Path], camera: str = "head_camera", **model_parameters: Any) -> dict[str, Any]:
    """Agreement of model masks with exact masks over the episodes (relative paths) that have both, of objects named by both.

    Returns {"camera", "model", "sim", "episodes", "all": row, "objects": {name: row}, "tasks": {task: row}}; a row has "visible"
    (frames in which the object is seen), "found" (share of them with a valid model mask), "iou" (mean over visible frames, a
    missed one counts 0), "iou_found" (mean where found), "good" (share of visible frames with IoU >= 0.5) and "false" (valid
    masks in frames where the object is not seen, as a share of those frames). It is also written to
    annotations/agreement-<camera>.json. Raises AnnotateError where either source is missing or ambiguous.
    """
    model = find_stage(dataset, "masks", source="model", camera=camera, **model_parameters)
    sim = find_stage(dataset, "masks", source="sim", camera=camera)
    rows: dict[str, dict[str, list[NDArray[np.float64]]]] = {"objects": defaultdict(list), "tasks": defaultdict(list)}
    counted = 0
    for episode in episodes:
        try:
            pair = [read_entry(annotation_path(dataset, d, episode)) for d in (model, sim)]
        except (FileNotFoundError, CorruptAnnotation):
            continue
        counted += 1
        for name in pair[0].attributes["objects"]:
            if name in pair[1].attributes["objects"]:
                row = _compare(pair[0], pair[1], name)
                rows["objects"][name].append(row)
                rows["tasks"][episode.parts[0]].append(row)
    if not rows["objects"]:
        raise AnnotateError(f"{dataset} has no episode with both model and sim masks of {camera}; annotate masks with both sources")
    report: dict[str, Any] = {"camera": camera, "model": model, "sim": sim, "episodes": counted}
    report["all"] = _row([r for found in rows["objects"].values() for r in found])
    for kind, groups in rows.items():
        report[kind] = {name: _row(found) for name, found in sorted(groups.items())}
    path = Path(dataset) / "annotations" / f"agreement-{camera}.json"
    temporary = path.with_suffix(f".{os.getpid()}.tmp")
    temporary.write_text(json.dumps(report, indent=2) + "\n")
    os.replace(temporary, path)
    return report


def _compare(model: Entry, sim: Entry, name: str) -> NDArray[np.float64]:
    """Columns per frame: seen by the simulator, valid by the model, IoU."""
    valid, masks = [], []
    for entry in (sim, model):
        k = entry.attributes["objects"].index(name)
        valid.append(entry.arrays["valid"][:, k])
        masks.append(unpack(entry.arrays["mask"][:, k], entry.attributes["height"], entry.attributes["width"]))
    return np.stack([*valid, iou(*masks)], 1).astype(float)


def _row(parts: Sequence[NDArray[np.float64]]) -> dict[str, float | int | None]:
    seen, valid, score = np.concatenate(parts).T
    visible, found = seen > 0, (seen > 0) & (valid > 0)

    def mean(values: NDArray[Any]) -> float | None:
        return round(float(values.mean()), 4) if values.size else None

    return {
        "visible": int(visible.sum()),
        "found": mean(valid[visible]),
        "iou": mean(score[visible]),
        "iou_found": mean(score[found]),
        "good": mean(score[visible] >= GOOD_IOU),
        "false": mean(valid[~visible]),
    }
