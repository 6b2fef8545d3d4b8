"""A few frames of an episode, spread in time, with the target's path drawn in: what a person looks
at first."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.data.cameras import CameraType, View, project
from pipeline.data.episode.file import Episode, EpisodeFile, open_episode
from pipeline.data.names import HEAD
from pipeline.data.spec import EpisodeSpec

MEETING_COLOR = (255, 196, 0)
NEAREST = 0.05  # m in front of the camera; nearer points project to nonsense
_SUBPIXEL = 4  # bits: cv2 draws at 1/16 pixel


@dataclass(frozen=True, eq=False)
class Shot:
    """One frame (H,W,3) uint8 RGB with the path drawn in, its time in s, and whether it is the
    frame of the meeting."""

    rgb: NDArray[np.uint8]
    time: float
    meeting: bool

    @property
    def caption(self) -> str:
        """Its time, and whether it is the meeting."""
        return f"{'meeting, ' if self.meeting else ''}{self.time:.2f} s"


@dataclass(frozen=True, eq=False)
class Film:
    """The shots of one episode in order of time."""

    spec: EpisodeSpec
    shots: tuple[Shot, ...]


def film(path: Path, columns: int = 6, width: int = 320, camera: str | None = None) -> Film:
    """Up to `columns` frames of an episode file, as `pick_frames` chooses them, scaled to `width`
    pixels.

    `camera` is by default the head camera, or the first one if the file has no head camera. Raises
    EpisodeError for a file that is no episode or has no such camera."""
    with open_episode(path) as e:
        episode = e.read()
        if camera is None:
            camera = HEAD if HEAD in e.cameras else next(iter(e.cameras), HEAD)
        pixels, in_front = target_path(e, episode, camera)
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
            shots.append(Shot(scaled, float(episode.log.times[i]), i == meeting))
    return Film(episode.spec, tuple(shots))


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


def target_path(
    e: EpisodeFile, episode: Episode, camera: str
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """`path_pixels` (T,2) of the target's origin, as a stored camera saw it."""
    focal = e.array(f"observation/{camera}/intrinsic_cv")[0]
    height, width = e.rgb(camera, 0).shape[:2]
    kind = CameraType(width, height, float(np.degrees(2 * np.arctan(height / 2 / focal[1, 1]))))
    return path_pixels(
        kind, e.array(f"observation/{camera}/pose"), episode.log.pose(episode.meta.target)
    )


def path_pixels(
    kind: CameraType, cameras: NDArray[np.floating], poses: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Pixels (T,2) of a body's origin as a camera saw it at each frame, and which (T,) of them lie
    in front of it.

    `cameras` and `poses` are the world poses (T,7) of camera and body."""
    seen = [project(kind, world, point) for world, point in zip(cameras, poses[:, :3], strict=True)]
    return np.array([uv for uv, _ in seen]), np.array([depth > NEAREST for _, depth in seen])


def with_path(view: View, episode: Episode) -> NDArray[np.uint8]:
    """The images (T,H,W,3) of a view of an episode, a copy, with the target's path drawn in."""
    pixels, in_front = path_pixels(
        view.camera.type, view.poses, episode.log.pose(episode.meta.target)
    )
    images, meeting = view.rgb.copy(), meeting_frame(episode)
    for i, image in enumerate(images):
        draw_path(image, pixels, in_front, i, meeting)
    return images


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
    ramp = _plasma()[np.linspace(40, 255, last + 1).astype(np.uint8)]
    until = now if meeting is None else max(now, meeting)
    for i in range(until):
        if in_front[i] and in_front[i + 1]:
            color, thick = (ramp[i], 2.2 * unit) if i < now else ((235, 235, 235), 0.8 * unit)
            _line(rgb, pixels[i], pixels[i + 1], color, thick)
    if meeting is not None and in_front[meeting]:
        _ring(rgb, pixels[meeting], 7 * unit, (20, 20, 20), 3.2 * unit)
        _ring(rgb, pixels[meeting], 7 * unit, MEETING_COLOR, 1.6 * unit)
    if in_front[now]:
        _ring(rgb, pixels[now], 3.2 * unit, (20, 20, 20), -1)
        _ring(rgb, pixels[now], 2.2 * unit, (255, 255, 255), -1)


@cache
def _plasma() -> NDArray[np.uint8]:
    """RGB (256,3) of the color map, kept because OpenCV takes milliseconds to make it."""
    return np.asarray(
        cv2.applyColorMap(np.arange(256, dtype=np.uint8), cv2.COLORMAP_PLASMA), np.uint8
    )[:, 0, ::-1]


def _fixed(point: NDArray[np.float64]) -> tuple[int, int]:
    x, y = np.clip(np.rint(point * 2**_SUBPIXEL), -(2**20), 2**20).astype(int)
    return int(x), int(y)


def _color(color: NDArray[np.uint8] | tuple[int, ...]) -> tuple[int, int, int]:
    return int(color[0]), int(color[1]), int(color[2])


def _line(
    rgb: NDArray[np.uint8],
    a: NDArray[np.float64],
    b: NDArray[np.float64],
    color: NDArray[np.uint8] | tuple[int, ...],
    thick: float,
):
    cv2.line(rgb, _fixed(a), _fixed(b), _color(color), max(1, round(thick)), cv2.LINE_AA, _SUBPIXEL)


def _ring(
    rgb: NDArray[np.uint8],
    centre: NDArray[np.float64],
    radius: float,
    color: tuple[int, ...],
    thick: float,
):
    width = -1 if thick < 0 else max(1, round(thick))
    cv2.circle(
        rgb,
        _fixed(centre),
        round(radius * 2**_SUBPIXEL),
        _color(color),
        width,
        cv2.LINE_AA,
        _SUBPIXEL,
    )
