"""What the page shows of a dataset and of one episode, as plain JSON data; all images of an episode
are one film."""

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.data.episode.events import ENDED, FIRED, WITHHELD
from pipeline.data.episode.file import EpisodeFile, open_episode
from pipeline.data.episode.meta import EpisodeMeta, FailureInfo
from pipeline.data.episode.mp4 import encode_mp4
from pipeline.data.episode.state_log import Event, SkillRun, StateLog
from pipeline.data.names import HEAD, SIDES
from pipeline.data.slots.annotations import (
    CorruptAnnotation,
    Entry,
    annotation_path,
    read_entry,
    stages_of,
)
from pipeline.html import mp4_uri
from pipeline.motion.models import motion_from_json
from pipeline.motion.recorded import Interception, track
from pipeline.report.film_strip import encode, meeting_frame

WIDTH, THUMBNAIL, FLOW = 320, 224, 100
"""Widths (pixels) of a camera's images, of an episode's image on the wall, and of flow maps."""

FILM = {"preset": "medium", "tune": "animation", "g": "30"}
"""Options of the film: about the error of JPEG at quality 82 in a twelfth of the bytes, and a short
way to any frame."""


def thumbnail(path: Path) -> bytes:
    """The JPEG of an episode at its meeting, THUMBNAIL pixels wide. Raises EpisodeError."""
    with open_episode(path) as e:
        camera = HEAD if HEAD in e.cameras else e.cameras[0]
        rgb = e.rgb(camera, min(round(e.meta.meeting_time * e.fps), len(e) - 1))
    return encode(_fitting(rgb[None], THUMBNAIL)[0], quality=78)


def episode_data(path: Path, dataset: Path) -> dict[str, Any]:
    """Everything that is shown of one episode. Raises EpisodeError if it cannot be read."""
    with open_episode(path) as e:
        episode = e.read()
        log, meta = episode.log, e.meta
        derived = Interception(meta, log, motion_from_json(episode.motion), log.pose(meta.target))
        annotated = {camera: _annotations(camera, dataset, path) for camera in e.cameras}
        cameras = {
            camera: _camera(e, camera, derived, annotated[camera][0]) for camera in e.cameras
        }
        tracks = {camera: _fitting(list(e.frames(camera)), WIDTH) for camera in e.cameras}
        flows = {
            f"{camera} flow": _fitting(flow, FLOW)
            for camera, (_, flow) in annotated.items()
            if len(flow)
        }
    times = np.linspace(-derived.motion.lead, derived.motion.duration, 60)
    planned, target = derived.motion.pose(times)[:, :3], derived.target[:, :3]
    meeting, file = meeting_frame(episode), path.relative_to(dataset).as_posix()
    again = ["domino-data", "verify", str(dataset), "--episode", file]
    return {
        "file": file,
        "again": "" if meta.failure else shlex.join(again),
        "fps": meta.fps,
        "frames": len(log),
        "failure": _why(meta.failure),
        "instruction": episode.instructions["seen"][:1],
        "meeting": meeting,
        "place": derived.planned_position.tolist(),
        "events": [
            {"name": _label(event), "time": event.time, "by": event.by} for event in log.events
        ],
        "spans": _spans(derived, meta.fps) + _policy(meta, log),
        "skills": skill_rows(log.skills, meta.physics_hz),
        "joints": list(log.vector_names),
        "state": _round(log.state.T),
        "action": _round(log.action.T),
        "speed": _round(np.linalg.norm(log.target_velocity, axis=1)),
        "path": {"planned": _round(planned.T), "target": _round(target.T)},
        "hands": {side: _round(log.tcp[:, i, :3].T) for i, side in enumerate(log.sides)},
        "distance": {
            side: _round(np.linalg.norm(log.tcp[:, i, :3] - target, axis=1))
            for i, side in enumerate(log.sides)
        },
        "cameras": cameras,
        **_film(tracks | flows, meta.fps),
    }


def _why(failure: FailureInfo | None) -> str:
    """Why an attempt failed, in words; "" for an episode."""
    if failure is None:
        return ""
    return f"{failure.stage}: {failure.reason}" + (
        f" ({', '.join(failure.conditions)})" if failure.conditions else ""
    )


def _film(tracks: Mapping[str, NDArray[np.uint8]], fps: int) -> dict[str, Any]:
    """All images (T,H,W,3), by name, as one film in which they are beside each other: its data URI,
    and the box (x, y, width, height) of each in it."""
    boxes, x = dict[str, list[int]](), 0
    for name, images in tracks.items():
        boxes[name] = [x, 0, images.shape[2], images.shape[1]]
        x += images.shape[2] + images.shape[2] % 2
    height = max(images.shape[1] for images in tracks.values())
    sheets = np.zeros((max(map(len, tracks.values())), height + height % 2, x, 3), np.uint8)
    for name, images in tracks.items():
        left, _, width, high = boxes[name]
        sheets[: len(images), :high, left : left + width] = images
    return {"film": mp4_uri(encode_mp4(sheets, fps, FILM)), "boxes": boxes}


def _camera(
    e: EpisodeFile, camera: str, derived: Interception, outlines: list[Any]
) -> dict[str, Any]:
    info = e.meta.drawing.cameras[camera]
    scale = min(1.0, WIDTH / info.width)
    seen = track(
        info.camera(camera).type, e.array(f"observation/{camera}/pose"), derived.target[:, :3]
    )
    return {
        "track": [
            [round(u * scale, 1), round(v * scale, 1)] if inside else None
            for u, v, _, inside in seen.tolist()
        ],
        "outlines": [
            [[[round(x * scale, 1), round(y * scale, 1)] for x, y in line] for line in frame]
            for frame in outlines
        ],
    }


def _annotations(camera: str, dataset: Path, path: Path) -> tuple[list[Any], NDArray[np.uint8]]:
    """Outlines of the masks of every frame (frames, lines, points) and the flow as images
    (T,H,W,3); empty if not annotated."""
    outlines: list[Any] = []
    flows = np.empty((0, 0, 0, 3), np.uint8)
    if not path.is_relative_to(dataset / "episodes"):  # failed attempts are not annotated
        return outlines, flows
    for directory, stage in stages_of(dataset).items():
        if stage["parameters"].get("camera") != camera:
            continue
        try:
            entry = read_entry(
                annotation_path(dataset, directory, path.relative_to(dataset / "episodes"))
            )
        except (FileNotFoundError, CorruptAnnotation):
            continue
        if stage["stage"] == "masks" and not outlines:
            outlines = _outlines(entry)
        if stage["stage"] == "flow" and not len(flows):
            flows = entry.arrays["rgb"]
    return outlines, flows


def _outlines(entry: Entry) -> list[Any]:
    height, width = entry.attributes["height"], entry.attributes["width"]
    out = []
    for packed in entry.arrays["mask"]:
        bits = np.unpackbits(packed, axis=-1, count=height * width).reshape(-1, height, width)
        outlines = [
            cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)[0] for mask in bits
        ]
        out.append([line[:, 0].tolist() for lines in outlines for line in lines if len(line) > 2])
    return out


def _label(event: Event) -> str:
    """Of an event of the recipe its kind, of others their name."""
    after = {FIRED: "", ENDED: " ends", WITHHELD: " withheld"}
    return event.by + after[event.name] if event.name in after else event.name


def _spans(derived: Interception, fps: int) -> list[dict[str, Any]]:
    """Intervals (s) in which the arms touch the target, and in which they hold it."""
    spans = []
    for name, flags in (("touches", derived.contact_pairs > 0), ("holds", derived.held)):
        for i, side in enumerate(SIDES):
            edges = np.flatnonzero(np.diff(np.concatenate([[0], flags[:, i].astype(int), [0]])))
            spans += [
                {"name": f"{side} {name}", "start": a / fps, "end": b / fps}
                for a, b in edges.reshape(-1, 2).tolist()
            ]
    return spans


def _policy(meta: EpisodeMeta, log: StateLog) -> list[dict[str, Any]]:
    """The interval (s) in which a policy acts before the expert corrects it, if it does."""
    if log.intervention is None:
        return []
    return [
        {
            "name": f"policy {meta.corrects} acts",
            "start": 0.0,
            "end": int((~log.intervention).sum()) / meta.fps,
        }
    ]


def skill_rows(runs: Sequence[SkillRun], hz: int) -> list[dict[str, Any]]:
    """The skills of the script (s), a row an arm; those within another one of that arm are named
    with it."""
    rows: list[dict[str, Any]] = []
    for run in runs:
        for side in run.arms:
            about = " ".join(part for part in (run.part.replace("_", " "), run.body) if part)
            outer = next(
                (
                    r
                    for r in rows
                    if r["arm"] == side and r["steps"][0] <= run.start and run.end <= r["steps"][1]
                ),
                None,
            )
            if outer is not None:
                outer["said"] += f", {run.skill}"
                continue
            row = {
                "name": run.skill,
                "arm": side,
                "said": f"{run.skill} {about}".strip(),
                "half": run.half,
            }
            rows.append(
                row | {"steps": (run.start, run.end), "start": run.start / hz, "end": run.end / hz}
            )
    return [{key: value for key, value in row.items() if key != "steps"} for row in rows]


def _fitting(
    images: Sequence[NDArray[np.uint8]] | NDArray[np.uint8], width: int
) -> NDArray[np.uint8]:
    """Images (T,H,W,3) that are at most `width` wide."""
    if images[0].shape[1] <= width:
        return np.asarray(images, np.uint8)
    size = width, round(images[0].shape[0] * width / images[0].shape[1])
    return np.stack(
        [
            np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), np.uint8)
            for rgb in images
        ]
    )


def _round(values: NDArray[np.float64] | Sequence[float]) -> Any:
    return np.round(values, 4).tolist()
