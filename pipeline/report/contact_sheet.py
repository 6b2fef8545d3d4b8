"""A contact sheet: one row of frames an episode, as a single image for a README or a paper."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.report.film_strip import BETWEEN, MEETING_COLOR, Film, encode, film, subtitle, title


@dataclass(frozen=True)
class Style:
    """Colours (RGB) and measures (pixels) of a sheet."""

    paper: tuple[int, int, int] = (250, 250, 248)
    ink: tuple[int, int, int] = (28, 30, 34)
    faint: tuple[int, int, int] = (118, 122, 130)
    gap: int = 6
    margin: int = 18
    caption: int = 30


def contact_sheet(
    episode_paths: Sequence[Path], columns: int = 6, frame_width: int = 240
) -> NDArray[np.uint8]:
    """An image (H,W,3) uint8 RGB with one labelled row an episode, in the order given.

    Raises ValueError for no episodes or fewer than two columns, EpisodeError for a file that is no
    episode.
    """
    if not episode_paths:
        raise ValueError("a contact sheet needs at least one episode")
    style = Style()
    films = [film(path, columns, frame_width) for path in episode_paths]
    width = 2 * style.margin + columns * frame_width + (columns - 1) * style.gap
    rows = [_row(f, width, style) for f in films]
    blank = np.full((style.margin // 2, width, 3), style.paper, np.uint8)
    return np.concatenate([blank, *rows, blank])


def save_contact_sheet(
    path: Path, episode_paths: Sequence[Path], columns: int = 6, frame_width: int = 240
) -> Path:
    """Write `contact_sheet` to a .png or .jpg file and return its path. Raises ValueError for
    another suffix."""
    if path.suffix not in (".png", ".jpg", ".jpeg"):
        raise ValueError(f"{path}: a contact sheet is a .png or a .jpg")
    sheet = contact_sheet(episode_paths, columns, frame_width)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(encode(sheet, path.suffix))
    return path


def _row(f: Film, width: int, style: Style) -> NDArray[np.uint8]:
    height, frame_width = f.shots[0].rgb.shape[:2]
    row = np.full((style.caption + height + style.margin, width, 3), style.paper, np.uint8)
    pen = _text(row, title(f.spec), (style.margin, 20), 0.56, style.ink)
    parts = subtitle(f.spec).split(BETWEEN)
    while parts and pen + 14 + _wide(BETWEEN.join(parts), 0.44) > width - style.margin:
        parts.pop()
    _text(row, BETWEEN.join(parts), (pen + 14, 20), 0.44, style.faint)
    for i, shot in enumerate(f.shots):
        left, top = style.margin + i * (frame_width + style.gap), style.caption
        row[top : top + height, left : left + frame_width] = shot.rgb
        _stamp(
            row[top : top + height, left : left + frame_width], f"{shot.time:.2f} s", shot.meeting
        )
        if shot.meeting:
            cv2.rectangle(
                row,
                (left - 1, top - 1),
                (left + frame_width, top + height),
                MEETING_COLOR,
                2,
                cv2.LINE_AA,
            )
    return row


def _stamp(image: NDArray[np.uint8], text: str, meeting: bool) -> None:
    text = f"meeting  {text}" if meeting else text
    box = np.full((18, image.shape[1], 3), (24, 26, 30), np.uint8)
    wide = _text(box, text, (6, 13), 0.36, MEETING_COLOR if meeting else (240, 240, 240)) + 6
    corner = image[-18:, :wide]
    corner[:] = (0.3 * corner + 0.7 * box[:, :wide]).astype(np.uint8)


def _wide(text: str, size: float) -> int:
    """Pixels that a text of a size takes."""
    return cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, size, 1)[0][0]


def _text(
    image: NDArray[np.uint8],
    text: str,
    origin: tuple[int, int],
    size: float,
    color: tuple[int, ...],
) -> int:
    """Draw text with its baseline at `origin` (column, row), in place; returns the column where it
    ends."""
    cv2.putText(image, text, origin, cv2.FONT_HERSHEY_SIMPLEX, size, color, 1, cv2.LINE_AA)
    return origin[0] + _wide(text, size) + 1
