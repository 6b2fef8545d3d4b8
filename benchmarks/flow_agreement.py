"""How well measured flow on moving targets agrees with the exact one, where a dataset has both."""

from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.annotate.networks.features import area_weights
from pipeline.annotate.store import find_stage
from pipeline.data.episode.file import open_episode
from pipeline.data.slots.annotations import CorruptAnnotation, Entry, annotation_path, read_entry

MOVING_PX = 0.05
"""Least mean exact displacement (px of the map) of the target in a pair that counts as moving."""


def flow_agreement(
    dataset: Path, episodes: Iterable[Path], camera: str = "head_camera", **flow_parameters: Any
) -> dict[str, Any]:
    """Farneback against exact flow on the target, by level, while it moves on its own (until the
    meeting).

    Pairs count in which the target is seen and moves by MOVING_PX or more. Needs flow from both
    sources with the same stride and size, and exact masks. Returns {"camera", "levels": {"L1":
    row}}; a row has "pairs", mean displacement of the target "exact" and "measured" (px of the
    map), mean end-point "error" on it (px), median "angle" between the two mean displacements
    (degrees), and "error_still", the mean error where the exact flow is zero (px). Raises
    AnnotateError where one of the three is missing or ambiguous.
    """
    names = [
        find_stage(dataset, "flow", source=s, camera=camera, **flow_parameters)
        for s in ("farneback", "sim")
    ]
    names.append(find_stage(dataset, "masks", source="sim", camera=camera))
    rows: dict[str, list[list[float]]] = defaultdict(list)
    for episode in episodes:
        try:
            measured, exact, masks = (
                read_entry(annotation_path(dataset, n, episode)) for n in names
            )
        except (FileNotFoundError, CorruptAnnotation):
            continue
        with open_episode(dataset / "episodes" / episode) as e:
            level, log = f"L{e.spec.level}", e.read().log
        meeting = log.time_of("meeting")
        free = len(log) if meeting is None else int((log.times <= meeting).sum())
        if "target" in masks.attributes["roles"]:
            rows[level] += _flow_rows(measured, exact, masks, free)
    columns = ("exact", "measured", "error", "angle", "error_still")
    report: dict[str, Any] = {"camera": camera, "levels": {}}
    for level, found in sorted(rows.items()):
        summary: dict[str, float | int] = {"pairs": len(found)}
        for name, values in zip(columns, np.array(found).reshape(-1, len(columns)).T, strict=True):
            if found:
                summary[name] = round(
                    float(np.median(values) if name == "angle" else values.mean()), 4
                )
        report["levels"][level] = summary
    return report


def _flow_rows(measured: Entry, exact: Entry, masks: Entry, free: int) -> list[list[float]]:
    a, b = (x.arrays["flow"].astype(float) for x in (measured, exact))
    mask = masks.masks(np.s_[:, masks.attributes["roles"]["target"]])
    target = area_weights(mask, (a.shape[1], a.shape[2])) > 0.5
    rows = []
    for t, before in enumerate(exact.arrays["previous"][:free]):
        here, still = target[before], (b[t] == 0).all(-1)
        if not here.any() or not still.any():
            continue
        truth, seen = b[t][here].mean(0), a[t][here].mean(0)
        lengths = np.linalg.norm(truth), np.linalg.norm(seen)
        if lengths[0] < MOVING_PX:
            continue
        cosine = truth @ seen / (lengths[0] * max(lengths[1], 1e-9))
        error = np.linalg.norm(a[t] - b[t], axis=-1)
        angle = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
        rows.append([float(x) for x in (*lengths, error[here].mean(), angle, error[still].mean())])
    return rows
