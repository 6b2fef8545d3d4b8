"""Annotations as images."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from pipeline.data.episode.file import open_episode
from pipeline.data.names import HEAD
from pipeline.data.slots.annotations import Entry, annotation_path, read_entry, stages_of
from pipeline.poses import Bools, Pixels

from .flow import Colour, colour_flow

WIDTH = 200  # pixels of a frame
COLOURS = ((255, 196, 0), (0, 200, 255), (255, 64, 160), (120, 255, 80))


def mask_overlay(rgb: Pixels, masks: Bools) -> Pixels:
    tinted = rgb.copy()
    for mask, colour in zip(masks, COLOURS * (1 + len(masks) // len(COLOURS)), strict=False):
        tinted[mask] = (0.55 * tinted[mask] + 0.45 * np.array(colour)).astype(np.uint8)
        bits = mask.astype(np.uint8)
        outline, _ = cv2.findContours(bits, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(tinted, outline, -1, colour, 1)
    return tinted


def annotation_sheet(
    dataset: Path, episode: Path, camera: str = HEAD, frames: Sequence[int] | None = None
) -> Pixels | None:
    """Frames with masks and flow, (H,W,3), by default six; None if that camera has neither."""
    entries: dict[str, list[tuple[str, Entry]]] = {"flow": [], "masks": []}
    for directory, stage in stages_of(dataset).items():
        path, parameters = annotation_path(dataset, directory, episode), stage["parameters"]
        if stage["stage"] in entries and parameters["camera"] == camera and path.is_file():
            entries[stage["stage"]].append((str(parameters["source"]), read_entry(path)))
    if not entries["flow"] and not entries["masks"]:
        return None
    with open_episode(dataset / "episodes" / episode) as e:
        spread = np.linspace(0, len(e) - 1, 7)[1:].round().astype(int).tolist()
        chosen = spread if frames is None else list(frames)
        images = [e.rgb(camera, t) for t in chosen]
    size = (WIDTH, round(WIDTH * images[0].shape[0] / images[0].shape[1]))
    rows = list[Pixels]()
    for source, entry in entries["masks"]:
        shown = [mask_overlay(p, m) for p, m in zip(images, entry.masks(chosen), strict=True)]
        rows.append(
            _row(f"masks: {source} ({', '.join(entry.attributes['objects'])})", shown, size)
        )
    rows = rows or [_row("frames", images, size)]
    for source, entry in sorted(entries["flow"], key=lambda x: x[0]):
        rgb, scale = colour_flow(entry.arrays["flow"][chosen], Colour("shared"))
        title = f"flow: {source} (bright = {scale[0]:.2f} px of {rgb.shape[2]})"
        rows.append(_row(title, list(rgb), size))
    return np.concatenate(rows)


def _row(title: str, images: Sequence[Pixels], size: tuple[int, int]) -> Pixels:
    row = np.hstack([cv2.resize(p, size, interpolation=cv2.INTER_AREA) for p in images])
    head, font = np.full((18, row.shape[1], 3), 30, np.uint8), cv2.FONT_HERSHEY_SIMPLEX
    cv2.putText(head, title, (6, 13), font, 0.42, (235, 235, 235), 1, cv2.LINE_AA)
    return np.concatenate([head, row]).astype(np.uint8)
