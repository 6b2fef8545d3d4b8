"""The labels of the stage `world` drawn on frames of one episode, as the picture of docs/labels.md.

    domino-data annotate OUT --stages world --where "task=adjust_bottle"
    python -m benchmarks.label_sheet OUT docs/labels.jpg [--episode PATH] [--frames 12,30,45,60]

Columns are frames, rows are TITLES.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.annotate.flow import Colour, colour_flow
from pipeline.annotate.store import episode_paths, find_stage
from pipeline.annotate.world_stage import project_points
from pipeline.data.cameras import CameraType
from pipeline.data.episode.file import EpisodeFile
from pipeline.data.names import HEAD
from pipeline.data.slots.annotations import Entry, annotation_path, read_entry

EDGES = [(a, b) for a in range(8) for b in range(a) if (a ^ b).bit_count() == 1]
"""Pairs of the corners of a box that an edge joins."""

WHITE, YELLOW, RED, CYAN = (255, 255, 255), (255, 210, 0), (255, 70, 60), (0, 220, 255)
TRAIL = 15

TITLES = (
    "boxes (yellow 2-D, blue 3-D), visible share, meeting point (red), time to contact",
    "tracks of surface points over the last second; rings are hidden points",
    "optical flow to the next frame (colour: direction)",
    "depth",
    "normals",
    "contact forces on the object",
)

type Image = NDArray[np.uint8]


def text(image: Image, words: str, at: tuple[int, int]) -> None:
    """Words with a dark rim."""
    for colour, width in (((20, 20, 20), 3), (WHITE, 1)):
        cv2.putText(image, words, at, cv2.FONT_HERSHEY_SIMPLEX, 0.42, colour, width, cv2.LINE_AA)


def pixel(xy: NDArray[Any]) -> tuple[int, int]:
    """A pixel as OpenCV takes it."""
    return int(xy[0]), int(xy[1])


def boxes(image: Image, entry: Entry, kind: CameraType, t: int) -> None:
    """2-D and 3-D boxes of the objects, the meeting point and the time to it."""
    a, names = entry.arrays, entry.attributes["objects"]
    for n, name in enumerate(names):
        x0, y0, x1, y1 = map(int, a["box_2d"][t, n])
        cv2.rectangle(image, (x0, y0), (x1, y1), YELLOW, 1, cv2.LINE_AA)
        corners = project_points(kind, a["box_3d"][t, n].astype(float))
        for i, j in EDGES:
            cv2.line(image, pixel(corners[i]), pixel(corners[j]), CYAN, 1, cv2.LINE_AA)
        share = 100 * a["visible_share"][t, n]
        text(image, f"{name} {share:.0f} % visible", (max(2, x0 - 20), max(12, y0 - 6)))
    cv2.drawMarker(image, pixel(a["meeting_XY"][t]), RED, cv2.MARKER_CROSS, 14, 2)
    text(image, f"contact in {a['time_to_contact'][t]:+.2f} s", (6, image.shape[0] * 7 // 8 - 8))


def tracks(image: Image, entry: Entry, objects: Sequence[int], t: int) -> None:
    """Tracks of the last second of the objects' points, coloured by point."""
    a = entry.arrays
    hues = np.linspace(0, 179, len(objects), endpoint=False).astype(np.uint8)
    hsv = np.stack([hues, np.full_like(hues, 220), np.full_like(hues, 255)], -1)[None]
    colours = cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB)[0].tolist()
    for n, colour in zip(objects, colours, strict=True):
        path = a["tracks_XY"][max(0, t - TRAIL) : t + 1, n]
        cv2.polylines(image, [path.round().astype(np.int32)], False, colour, 1, cv2.LINE_AA)
        filled = -1 if a["visibility"][t, n] else 1
        cv2.circle(image, pixel(path[-1]), 2, colour, filled, cv2.LINE_AA)


def forces(image: Image, entry: Entry, kind: CameraType, t: int) -> None:
    """Contacts of the objects: a disc whose area is the force, and its size in N."""
    a, bodies = entry.arrays, entry.attributes["bodies"]
    objects = {bodies.index(name) for name in entry.attributes["objects"]}
    world_to_camera = a["extrinsics"][t].astype(float)
    y = 16
    for row in np.flatnonzero(a["contact_frame"] == t):
        pair = a["contact_bodies"][row].tolist()
        if not objects & set(pair):
            continue
        point = world_to_camera[:3, :3] @ a["contact_point"][row] + world_to_camera[:3, 3]
        force = float(a["contact_force"][row])
        at = pixel(project_points(kind, point))
        cv2.circle(image, at, max(2, int(2.2 * np.sqrt(force))), RED, 2, cv2.LINE_AA)
        text(image, f"{bodies[pair[0]]} - {bodies[pair[1]]}: {force:.1f} N", (6, y))
        y += 16


def sheet(path: Path, entry: Entry, frames: Sequence[int], width: int) -> Image:
    """The picture (H,W,3) of these frames."""
    a, attributes = entry.arrays, entry.attributes
    per_body = a["tracks_XY"].shape[1] // len(attributes["tracked"])
    objects = [
        attributes["tracked"].index(name) * per_body + i
        for name in attributes["objects"]
        for i in range(0, per_body, 2)
    ]
    flow, _ = colour_flow(a["flow_forward"][list(frames)], Colour())
    columns = list[list[Image]]()
    with EpisodeFile(path) as file:
        info = file.meta.drawing.cameras[HEAD]
        kind = CameraType(info.width, info.height, info.fovy)
        for i, t in enumerate(frames):
            parts = [file.rgb(HEAD, t) for _ in range(3)]
            boxes(parts[0], entry, kind, t)
            tracks(parts[1], entry, objects, t)
            forces(parts[2], entry, kind, t)
            near, far = np.percentile(a["depth"][list(frames)], (0.5, 99.5))
            grey = np.clip((far - a["depth"][t]) / (far - near) * 255, 0, 255).astype(np.uint8)
            depth = cv2.cvtColor(cv2.applyColorMap(grey, cv2.COLORMAP_VIRIDIS), cv2.COLOR_BGR2RGB)
            normals = ((1 - a["normals"][t].astype(np.float32)) * 127.5).astype(np.uint8)
            columns.append([parts[0], parts[1], flow[i], depth, normals, parts[2]])
    rows = [titled(title, row) for title, *row in zip(TITLES, *columns, strict=True)]
    whole = np.concatenate(rows)
    height = round(width * whole.shape[0] / whole.shape[1])
    return np.asarray(cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


def titled(title: str, images: Sequence[Image]) -> Image:
    """Images side by side, cut above and below, with a title over them."""
    cut = images[0].shape[0] // 8
    row = np.concatenate([image[:-cut] for image in images], 1)
    head = np.full((26, row.shape[1], 3), 30, np.uint8)
    cv2.putText(head, title, (8, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.55, WHITE, 1, cv2.LINE_AA)
    return np.concatenate([head, row])


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("dataset", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--episode", type=Path)
    parser.add_argument("--frames", default="")
    parser.add_argument("--width", type=int, default=1600)
    options = parser.parse_args()
    episode = options.episode or episode_paths(options.dataset)[0]
    stage = find_stage(options.dataset, "world", camera=HEAD, dense=True)
    entry = read_entry(annotation_path(options.dataset, stage, episode))
    met = int(np.argmin(np.abs(entry.arrays["time_to_contact"])))
    last = len(entry.arrays["pose"]) - 1
    frames = [met - 24, met - 9, min(met + 4, last), min(met + 20, last)]
    if options.frames:
        frames = [int(word) for word in options.frames.split(",")]
    picture = sheet(options.dataset / "episodes" / episode, entry, frames, options.width)
    cv2.imwrite(str(options.out), picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 82])
    print(f"{options.out}: frames {frames} of {episode}, {options.out.stat().st_size // 1000} kB")


if __name__ == "__main__":
    main()
