"""What a person looks at first: a few frames of an episode with the target's path drawn in, and a
short film of it, an H.264 mp4 that any browser plays."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.data.cameras import CameraType, project
from pipeline.data.episode.file import Episode, EpisodeError, open_episode
from pipeline.data.episode.mp4 import encode_mp4
from pipeline.data.names import HEAD
from pipeline.data.recipe.model import Cell
from pipeline.data.spec import EpisodeSpec

MEETING_COLOR = (255, 196, 0)
NEAREST = 0.05  # m in front of the camera; nearer points project to nonsense
BETWEEN = "  |  "
_SUBPIXEL = 4  # bits: cv2 draws at 1/16 pixel


@dataclass(frozen=True, eq=False)
class Shot:
    """One frame (H,W,3) uint8 RGB with the path drawn in, at a time in s, which may be the
    meeting."""

    rgb: NDArray[np.uint8]
    time: float
    meeting: bool
    caption: str


@dataclass(frozen=True, eq=False)
class Film:
    """The shots of one episode in order of time."""

    spec: EpisodeSpec
    shots: tuple[Shot, ...]


def film(path: Path, columns: int = 6, width: int = 320) -> Film:
    """Up to `columns` frames of an episode file, as `pick_frames` chooses them, scaled to `width`
    pixels, from the head camera or the first one. Raises EpisodeError for a file that is no
    episode or has no camera."""
    with open_episode(path) as e:
        if not e.cameras:
            raise EpisodeError(f"{path}: has no camera")
        episode, camera = e.read(), HEAD if HEAD in e.cameras else e.cameras[0]
        pixels, in_front = path_pixels(
            e.meta.drawing.cameras[camera].camera(camera).type,
            e.array(f"observation/{camera}/pose"),
            episode.log.pose(episode.meta.target),
        )
        meeting = meeting_frame(episode)
        shots = []
        for i in pick_frames(len(e), columns, meeting):
            rgb = e.rgb(camera, i)
            scale = width / rgb.shape[1]
            kind = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
            scaled = np.asarray(
                cv2.resize(rgb, (width, round(rgb.shape[0] * scale)), interpolation=kind), np.uint8
            )
            draw_path(scaled, pixels * scale, in_front, i, meeting)
            time, words = float(episode.log.times[i]), "meeting, " if i == meeting else ""
            shots.append(Shot(scaled, time, i == meeting, f"{words}{time:.2f} s"))
    return Film(episode.spec, tuple(shots))


def title(spec: EpisodeSpec) -> str:
    """What a person calls an episode: its task in words."""
    return spec.task.replace("_", " ")


def subtitle(of: EpisodeSpec | Cell) -> str:
    """Level, speed, robot and domain in words."""
    motion = f"level {of.level}, {of.alpha:g} m/s" if of.level and of.alpha else "static"
    return BETWEEN.join((motion, of.embodiment, of.domain))


def encode(rgb: NDArray[np.uint8], suffix: str = ".jpg", quality: int = 88) -> bytes:
    """Picture (H,W,3) uint8 RGB -> JPEG or PNG bytes."""
    png = suffix == ".png"
    options = [cv2.IMWRITE_PNG_COMPRESSION, 9] if png else [cv2.IMWRITE_JPEG_QUALITY, quality]
    return cv2.imencode(suffix, cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), options)[1].tobytes()


def clip(path: Path, height: int = 180) -> bytes:
    """The mp4 of an episode, its cameras side by side, `height` pixels high, or less if none
    reaches that. Raises EpisodeError for a file that is no episode or has no camera."""
    with open_episode(path) as e:
        if not e.cameras:
            raise EpisodeError(f"{path}: has no camera")
        height = min(height, 2 * round(max(e.rgb(c, 0).shape[0] for c in e.cameras) / 2))
        sizes = {
            camera: (2 * round(wide * height / high / 2), height)
            for camera in e.cameras
            for high, wide in [e.rgb(camera, 0).shape[:2]]
        }
        rows = (
            np.hstack(
                [cv2.resize(e.rgb(c, i), sizes[c], interpolation=cv2.INTER_AREA) for c in sizes]
            )
            for i in range(len(e))
        )
        return encode_mp4((np.ascontiguousarray(row, np.uint8) for row in rows), e.fps)


def pick_frames(count: int, columns: int, meeting: int | None) -> list[int]:
    """Indices of at most `columns` of `count` frames, from first to last: half of them up to the
    meeting, the rest after it.

    Both halves are spread evenly, so that the approach is visible however long the episode is.
    Raises ValueError for fewer than two columns.
    """
    if columns < 2:
        raise ValueError(f"a film needs two columns or more, not {columns}")
    last = count - 1
    if meeting is None or not 0 < meeting < last or columns < 3:
        picks = np.linspace(0, last, columns)
    else:
        before = (columns + 1) // 2
        picks = np.concatenate(
            [np.linspace(0, meeting, before), np.linspace(meeting, last, columns - before + 1)[1:]]
        )
    return sorted({int(i) for i in picks.round()})


def meeting_frame(episode: Episode) -> int | None:
    """Index of the frame nearest the meeting, or None if no meeting was recorded."""
    time = episode.log.time_of("meeting")
    return None if time is None else int(np.abs(episode.log.times - time).argmin())


def path_pixels(
    kind: CameraType, cameras: NDArray[np.floating], poses: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Pixels (T,2) of a body's origin as a camera saw it at each frame, and which (T,) of them lie
    in front of it.

    `cameras` and `poses` are the world poses (T,7) of camera and body."""
    seen = [project(kind, world, point) for world, point in zip(cameras, poses[:, :3], strict=True)]
    return np.array([uv for uv, _ in seen]), np.array([depth > NEAREST for _, depth in seen])


def draw_path(
    rgb: NDArray[np.uint8],
    pixels: NDArray[np.float64],
    in_front: NDArray[np.bool_],
    now: int,
    meeting: int | None,
) -> None:
    """Draw the path (T,2) on an image (H,W,3), in place, with a ring at the meeting point and a dot
    at the target's present position.

    It is coloured by time up to `now` (violet early, yellow late), then a thin line to the meeting.
    """
    unit = max(rgb.shape[1] / 320, 0.5)
    last = len(pixels) - 1
    ramp = _plasma()[np.linspace(40, 255, last + 1).astype(np.uint8)].tolist()
    fixed = np.clip(np.rint(np.nan_to_num(pixels) * 2**_SUBPIXEL), -(2**20), 2**20)
    points = fixed.astype(int).tolist()
    for i in range(now if meeting is None else max(now, meeting)):
        if in_front[i] and in_front[i + 1]:
            color, thick = (ramp[i], 2.2 * unit) if i < now else ((235, 235, 235), 0.8 * unit)
            ends, width = (points[i], points[i + 1]), max(1, round(thick))
            cv2.line(rgb, *ends, color, width, cv2.LINE_AA, _SUBPIXEL)
    dark = (20, 20, 20)
    rings = [(now, 3.2, dark, -1), (now, 2.2, (255, 255, 255), -1)]
    if meeting is not None:
        widths = [max(1, round(width * unit)) for width in (3.2, 1.6)]
        around = zip((dark, MEETING_COLOR), widths, strict=True)
        rings = [*((meeting, 7.0, *each) for each in around), *rings]
    for i, radius, color, thick in rings:
        if in_front[i]:
            size = round(radius * unit * 2**_SUBPIXEL)
            cv2.circle(rgb, points[i], size, color, thick, cv2.LINE_AA, _SUBPIXEL)


@cache
def _plasma() -> NDArray[np.uint8]:
    """RGB (256,3) of the color map, kept because OpenCV takes milliseconds to make it."""
    return np.asarray(
        cv2.applyColorMap(np.arange(256, dtype=np.uint8), cv2.COLORMAP_PLASMA), np.uint8
    )[:, 0, ::-1]
