"""What a person looks at first: frames with the target's path, contact sheets, short H.264
films.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.data.cameras import CameraType, project
from pipeline.data.episode.events import by_role
from pipeline.data.episode.file import Episode, EpisodeError, EpisodeFile, open_episode
from pipeline.data.episode.frames import encode_mp4
from pipeline.data.names import HEAD
from pipeline.data.recipe.model import Cell
from pipeline.data.spec import EpisodeSpec
from pipeline.poses import Bools, Floats, Pixels

MEETING_COLOR = (255, 196, 0)
NEAREST = 0.05  # m in front of the camera; nearer points project to nonsense
BETWEEN = "  |  "
TITLE, GAP = 28, 6  # pixels of a sheet above a row and between frames
_SUBPIXEL = 4  # bits: cv2 draws at 1/16 pixel


@dataclass(frozen=True, eq=False)
class Shot:
    """One frame (H,W,3) uint8 RGB with the path, at a time in s."""

    rgb: Pixels
    time: float
    meeting: bool
    caption: str


@dataclass(frozen=True, eq=False)
class Film:
    spec: EpisodeSpec
    shots: tuple[Shot, ...]


def film(path: Path, columns: int = 6, width: int = 320) -> Film:
    """Up to `columns` frames, `width` px wide, from the head or first camera. Raises
    EpisodeError.
    """
    with open_episode(path) as e:
        _check_cameras(e)
        episode, camera = e.read(), HEAD if HEAD in e.cameras else e.cameras[0]
        kind = e.meta.drawing.cameras[camera].camera(camera).type
        poses = e.array(f"observation/{camera}/pose")
        target = by_role(episode.log, e.meta.events, e.meta.target).pose(e.meta.target)
        pixels, in_front = path_pixels(kind, poses, target)
        meeting, shots = meeting_frame(episode), list[Shot]()
        for i in pick_frames(len(e), columns, meeting):
            rgb = e.rgb(camera, i)
            scale = width / rgb.shape[1]
            size = width, round(rgb.shape[0] * scale)
            method = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
            scaled = np.asarray(cv2.resize(rgb, size, interpolation=method), np.uint8)
            draw_path(scaled, pixels * scale, in_front, i, meeting)
            time, words = float(episode.log.times[i]), "meeting, " if i == meeting else ""
            shots.append(Shot(scaled, time, i == meeting, f"{words}{time:.2f} s"))
    return Film(episode.spec, tuple(shots))


def _check_cameras(e: EpisodeFile) -> None:
    if not e.cameras:
        raise EpisodeError(f"{e.path}: has no camera")


def contact_sheet(paths: Sequence[Path], columns: int = 6, width: int = 240) -> Pixels:
    """An image (H,W,3) uint8 RGB with a titled row an episode; meeting frames are underlined.
    Raises EpisodeError.
    """
    rows = list[Pixels]()
    for path in paths:
        strip = film(path, columns, width)
        height = strip.shots[0].rgb.shape[0]
        row = np.full((TITLE + height + GAP, columns * (width + GAP), 3), 250, np.uint8)
        words = BETWEEN.join((strip.spec.task.replace("_", " "), subtitle(strip.spec)))
        font = cv2.FONT_HERSHEY_SIMPLEX
        cv2.putText(row, words, (0, TITLE - 9), font, 0.5, (28, 30, 34), 1, cv2.LINE_AA)
        for i, shot in enumerate(strip.shots):
            span = slice(i * (width + GAP), i * (width + GAP) + width)
            row[TITLE : TITLE + height, span] = shot.rgb
            if shot.meeting:
                row[TITLE + height :, span] = MEETING_COLOR
        rows.append(row)
    return np.concatenate(rows)


def subtitle(of: EpisodeSpec | Cell) -> str:
    motion = f"level {of.level}, {of.alpha:g} m/s" if of.level and of.alpha else "static"
    return BETWEEN.join((motion, of.embodiment, of.domain))


def encode(rgb: Pixels, suffix: str = ".jpg", quality: int = 88) -> bytes:
    """Picture (H,W,3) uint8 RGB -> JPEG or PNG bytes."""
    png = suffix == ".png"
    options = [cv2.IMWRITE_PNG_COMPRESSION, 9] if png else [cv2.IMWRITE_JPEG_QUALITY, quality]
    return cv2.imencode(suffix, cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), options)[1].tobytes()


def clip(path: Path, height: int = 180) -> bytes:
    """The mp4 of an episode, cameras side by side, at most `height` px high. Raises
    EpisodeError.
    """
    with open_episode(path) as e:
        _check_cameras(e)
        shapes = {camera: e.rgb(camera, 0).shape for camera in e.cameras}
        height = min(height, 2 * round(max(shape[0] for shape in shapes.values()) / 2))
        sizes = {
            camera: (2 * round(wide * height / high / 2), height)
            for camera, (high, wide, _) in shapes.items()
        }

        def row(i: int) -> Pixels:
            images = (
                cv2.resize(e.rgb(camera, i), size, interpolation=cv2.INTER_AREA)
                for camera, size in sizes.items()
            )
            return np.ascontiguousarray(np.hstack(list(images)), np.uint8)

        return encode_mp4(map(row, range(len(e))), e.fps)


def pick_frames(count: int, columns: int, meeting: int | None) -> list[int]:
    """Indices of at most `columns` of `count` frames, half up to the meeting, half after it."""
    last = count - 1
    if meeting is None or not 0 < meeting < last or columns < 3:
        picks = np.linspace(0, last, columns)
    else:
        before = (columns + 1) // 2
        after = np.linspace(meeting, last, columns - before + 1)[1:]
        picks = np.concatenate([np.linspace(0, meeting, before), after])
    return sorted({int(i) for i in picks.round()})


def meeting_frame(episode: Episode) -> int | None:
    """Index of the frame nearest the meeting, or None if no meeting was recorded."""
    time = episode.log.time_of("meeting")
    return None if time is None else int(np.abs(episode.log.times - time).argmin())


def path_pixels(
    kind: CameraType, cameras: NDArray[np.floating], poses: Floats
) -> tuple[Floats, Bools]:
    """Pixels (T,2) of a body's origin, and which (T,) are in front of the camera; poses (T,7) in
    the world.
    """
    seen = [project(kind, world, point) for world, point in zip(cameras, poses[:, :3], strict=True)]
    return np.array([uv for uv, _ in seen]), np.array([depth > NEAREST for _, depth in seen])


def draw_path(rgb: Pixels, pixels: Floats, in_front: Bools, now: int, meeting: int | None) -> None:
    """Draw the path (T,2) px on an image (H,W,3), in place: coloured up to `now`, thin until the
    meeting.
    """
    unit = max(rgb.shape[1] / 320, 0.5)
    ramp = _plasma()[np.linspace(40, 255, len(pixels)).astype(np.uint8)].tolist()
    fixed = np.clip(np.rint(np.nan_to_num(pixels) * 2**_SUBPIXEL), -(2**20), 2**20)
    points = fixed.astype(int).tolist()
    for i in range(now if meeting is None else max(now, meeting)):
        if in_front[i] and in_front[i + 1]:
            color, thick = (ramp[i], 2.2 * unit) if i < now else ((235, 235, 235), 0.8 * unit)
            width = max(1, round(thick))
            cv2.line(rgb, points[i], points[i + 1], color, width, cv2.LINE_AA, _SUBPIXEL)
    dark = (20, 20, 20)
    rings = [(now, 3.2, dark, -1), (now, 2.2, (255, 255, 255), -1)]
    if meeting is not None:
        wide, narrow = (max(1, round(width * unit)) for width in (3.2, 1.6))
        rings = [(meeting, 7.0, dark, wide), (meeting, 7.0, MEETING_COLOR, narrow), *rings]
    for i, radius, color, thick in rings:
        if in_front[i]:
            size = round(radius * unit * 2**_SUBPIXEL)
            cv2.circle(rgb, points[i], size, color, thick, cv2.LINE_AA, _SUBPIXEL)


@cache
def _plasma() -> Pixels:
    """RGB (256,3) of the color map, cached: OpenCV takes milliseconds."""
    ramp = cv2.applyColorMap(np.arange(256, dtype=np.uint8)[:, None], cv2.COLORMAP_PLASMA)
    return np.asarray(ramp, np.uint8)[:, 0, ::-1]
