"""The page's plain JSON data; all images of an episode are one film."""

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from pipeline.data.episode.events import ENDED, FIRED, WITHHELD
from pipeline.data.episode.file import EpisodeFile, open_episode
from pipeline.data.episode.frames import encode_mp4
from pipeline.data.episode.meta import EpisodeMeta, FailureInfo
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
from pipeline.poses import Floats
from pipeline.report.film_strip import Pixels, encode, meeting_frame

WIDTH, THUMBNAIL, FLOW = 320, 224, 100
"""Widths (pixels) of a camera's images, of an episode's image on the wall, and of flow maps."""

FILM = {"preset": "medium", "tune": "animation", "g": "30"}
"""Options of the film: about the error of JPEG at quality 82 in a twelfth of the bytes, and a short
way to any frame."""


def thumbnail(path: Path) -> bytes:
    """The JPEG of the meeting, THUMBNAIL px wide. Raises EpisodeError."""
    with open_episode(path) as e:
        camera = HEAD if HEAD in e.cameras else e.cameras[0]
        rgb = e.rgb(camera, min(round(e.meta.meeting_time * e.fps), len(e) - 1))
    return encode(_fitting([rgb], THUMBNAIL)[0], quality=78)


def episode_data(path: Path, dataset: Path) -> dict[str, Any]:
    """What is shown of one episode. Raises EpisodeError."""
    cameras, images, flows = dict[str, Any](), dict[str, Pixels](), dict[str, Pixels]()
    with open_episode(path) as e:
        episode = e.read()
        log, meta = episode.log, e.meta
        derived = Interception(meta, log, motion_from_json(episode.motion))
        for camera in e.cameras:
            outlines, flow = _annotations(camera, dataset, path)
            cameras[camera] = _camera(e, camera, derived, outlines)
            images[camera] = _fitting(list(e.frames(camera)), WIDTH)
            if len(flow):
                flows[f"{camera} flow"] = _fitting(flow, FLOW)
    times = np.linspace(-derived.motion.lead, derived.motion.duration, 60)
    planned, target = derived.motion.pose(times)[:, :3], derived.target[:, :3]
    hands = {side: log.tcp[:, i, :3] for i, side in enumerate(log.sides)}
    apart = {side: np.linalg.norm(hand - target, axis=1) for side, hand in hands.items()}
    file = path.relative_to(dataset).as_posix()
    again = shlex.join(["domino-data", "verify", str(dataset), "--episode", file])
    events = [{"name": _label(event), "time": event.time, "by": event.by} for event in log.events]
    return {
        "file": file,
        "again": "" if meta.failure else again,
        "fps": meta.fps,
        "frames": len(log),
        "failure": _why(meta.failure),
        "instruction": episode.instructions["seen"][:1],
        "meeting": meeting_frame(episode),
        "place": derived.planned_position.tolist(),
        "events": events,
        "spans": _spans(derived, meta.fps) + _policy(meta, log),
        "skills": skill_rows(log.skills, meta.physics_hz),
        "joints": list(log.vector_names),
        "state": _round(log.state.T),
        "action": _round(log.action.T),
        "speed": _round(np.linalg.norm(log.target_velocity, axis=1)),
        "path": {"planned": _round(planned.T), "target": _round(target.T)},
        "hands": {side: _round(hand.T) for side, hand in hands.items()},
        "distance": {side: _round(values) for side, values in apart.items()},
        "cameras": cameras,
        **_film(images | flows, meta.fps),
    }


def _why(failure: FailureInfo | None) -> str:
    if failure is None:
        return ""
    unmet = f" ({', '.join(failure.conditions)})" if failure.conditions else ""
    return f"{failure.stage}: {failure.reason}{unmet}"


def _film(tracks: Mapping[str, Pixels], fps: int) -> dict[str, Any]:
    """All images (T,H,W,3) in one film: its data URI, and each one's box (x, y, width, height)."""
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
    info, poses = e.meta.drawing.cameras[camera], e.array(f"observation/{camera}/pose")
    seen = track(info.camera(camera).type, poses, derived.target[:, :3]).tolist()
    scale = min(1.0, WIDTH / info.width)

    def point(x: float, y: float) -> list[float]:
        return [round(x * scale, 1), round(y * scale, 1)]

    places = [point(u, v) if inside else None for u, v, _, inside in seen]
    lines = [[[point(*xy) for xy in line] for line in frame] for frame in outlines]
    return {"track": places, "outlines": lines}


def _annotations(camera: str, dataset: Path, path: Path) -> tuple[list[Any], Pixels]:
    """Mask outlines of every frame (frames, lines, points) and flow images (T,H,W,3); empty if
    not annotated.
    """
    outlines: list[Any] = []
    flows = np.empty((0, 0, 0, 3), np.uint8)
    if not path.is_relative_to(dataset / "episodes"):  # failed attempts are not annotated
        return outlines, flows
    relative = path.relative_to(dataset / "episodes")
    for directory, stage in stages_of(dataset).items():
        if stage["parameters"].get("camera") != camera:
            continue
        try:
            entry = read_entry(annotation_path(dataset, directory, relative))
        except (FileNotFoundError, CorruptAnnotation):
            continue
        if stage["stage"] == "masks" and not outlines:
            outlines = _outlines(entry)
        if stage["stage"] == "flow" and not len(flows):
            flows = entry.arrays["rgb"]
    return outlines, flows


def _outlines(entry: Entry) -> list[Any]:
    frames = []
    for t in range(len(entry.arrays["mask"])):
        lines = [
            line
            for mask in entry.masks(t).view(np.uint8)
            for line in cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)[0]
        ]
        frames.append([line[:, 0].tolist() for line in lines if len(line) > 2])
    return frames


def _label(event: Event) -> str:
    """Of an event of the recipe its kind, of others their name."""
    after = {FIRED: "", ENDED: " ends", WITHHELD: " withheld"}
    return event.by + after[event.name] if event.name in after else event.name


def _spans(derived: Interception, fps: int) -> list[dict[str, Any]]:
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
    if log.intervention is None:
        return []
    end = int((~log.intervention).sum()) / meta.fps
    return [{"name": f"policy {meta.corrects} acts", "start": 0.0, "end": end}]


def skill_rows(runs: Sequence[SkillRun], hz: int) -> list[dict[str, Any]]:
    """The script's skills (s), a row an arm; nested ones are named with the outer."""
    rows = list[tuple[SkillRun, dict[str, Any]]]()
    for run in runs:
        about = " ".join(part for part in (run.part.replace("_", " "), run.body) if part)
        for side in run.arms:
            for outer, row in rows:
                if row["arm"] == side and outer.start <= run.start and run.end <= outer.end:
                    row["said"] += f", {run.skill}"
                    break
            else:
                row = {"name": run.skill, "arm": side, "said": f"{run.skill} {about}".strip()}
                row |= {"half": run.half, "start": run.start / hz, "end": run.end / hz}
                rows.append((run, row))
    return [row for _, row in rows]


def _fitting(images: Sequence[Pixels] | Pixels, width: int) -> Pixels:
    """Images (T,H,W,3) that are at most `width` wide."""
    if images[0].shape[1] <= width:
        return np.asarray(images, np.uint8)
    size = width, round(images[0].shape[0] * width / images[0].shape[1])
    scaled = [cv2.resize(rgb, size, interpolation=cv2.INTER_AREA) for rgb in images]
    return np.asarray(scaled, np.uint8)


def _round(values: Floats) -> Any:
    return np.round(values, 4).tolist()
