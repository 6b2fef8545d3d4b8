"""Checks that a LeRobot export agrees with its episodes: every number exactly, every image within the loss of the codec."""

import json
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice, pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pipeline.data.episode.file import EpisodeFile
from pipeline.export.formats.lerobot.depth import depth_columns, depth_images
from pipeline.export.formats.lerobot.format import (
    CLOCK_FEATURES,
    DATA_PATH,
    VIDEO_PATH,
    data_columns,
    described_cameras,
    image_key,
    modality,
    widen,
)
from pipeline.export.formats.lerobot.language import EVENTS, PERSISTENT, language_columns
from pipeline.export.formats.lerobot.options import LerobotV3Options
from pipeline.export.shared.common import Facts, exported_cameras, judging, read_facts, reading
from pipeline.export.shared.provenance import check_provenance, scalars
from pipeline.export.shared.video import frames_of

IMAGE_TOLERANCE = 8.0  # mean absolute difference of 0-255 that AV1 at crf 30 stays well below
CLEAR = 32  # of 255: more than the codec loses
MOVED_PIXELS = 20


def check_v3(dataset: Path, root: Path, paths: Sequence[Path], options: LerobotV3Options) -> list[str]:
    """Compare a v3.0 dataset, made with these options, with its episodes; returns the problems found, [] when all is well.

    Counts, every number, times, tasks, provenance, and each decoded image: mean absolute difference at most IMAGE_TOLERANCE,
    and where it differs clearly from the frame before or after, not closer to that one.
    Raises ExportError for episode files that cannot be read.
    """
    problems: list[str] = []
    with judging(root, problems):
        problems += _check_dataset(dataset, root, paths, options)
        problems += check_provenance(root / "meta" / "domino_episodes.parquet", dataset, paths, options.after_success)
    return problems


def _check_dataset(dataset: Path, root: Path, paths: Sequence[Path], options: LerobotV3Options) -> list[str]:
    info = json.loads((root / "meta/info.json").read_text())
    width = len(info["features"]["action"]["names"])
    files = sorted((root / "meta/episodes").rglob("*.parquet"))
    rows = [row for f in files for row in pq.read_table(f).to_pylist()]
    table = pq.read_table(root / "meta/tasks.parquet").to_pydict()
    tasks = dict(zip(table["task"], table["task_index"], strict=True))
    problems = []
    for what, got, want in (("episodes", info["total_episodes"], len(paths)), ("episode rows", len(rows), len(paths))):
        if got != want:
            problems.append(f"{root}: has {got} {what} for {want} episodes")
    stats = json.loads((root / "meta/stats.json").read_text())
    numbers = {name for name, feature in info["features"].items() if feature["dtype"] not in ("string", "language")}
    problems += [f"{root}: has no statistics of {name}" for name in sorted(numbers - set(stats))]
    problems += check_features(root, info)
    with reading(paths[0]) as file:
        first = widen(read_facts(file, dataset), width)
    with judging(root / "meta", problems):
        problems += check_described(root, first, options.camera_names, len(paths))
    start = 0
    videos = _Videos(root)
    for index, (path, row) in enumerate(zip(paths, rows, strict=False)):
        where = f"{root}: episode {index} ({path.name})"
        with reading(path) as file:
            facts = widen(read_facts(file, dataset, options.after_success), width)
            names = exported_cameras(facts, options.camera_names)
            with judging(root, problems):
                problems += [f"{where}: {p}" for p in _check_row(facts, index, start, row, tasks, info)]
                at = root / DATA_PATH.format(chunk_index=row["data/chunk_index"], file_index=row["data/file_index"])
                columns = data_columns(facts, names, index, start, tasks.get(facts.instruction, -1))
                columns |= language_columns(facts, names, pq.read_schema(at)) if options.language else {}
                columns |= depth_columns(depth_images(file, facts.kept), names) if options.depth else {}
                problems += [f"{where}: {at.name}: {p}" for p in check_columns(at, index, columns)]
                for camera, name in names.items():
                    problems += [f"{where}: {camera} {p}" for p in _check_video(file, camera, image_key(name), row, videos)]
        start += facts.kept
    if info["total_frames"] != start:
        problems.append(f"{root}: has {info['total_frames']} frames, the episodes {start}")
    videos.close()
    return problems + videos.leftover


def check_described(root: Path, first: Facts, given: Mapping[str, str], episodes: int) -> list[str]:
    """meta/modality.json and meta/domino.json must describe a dataset whose first episode this is."""
    names, problems = exported_cameras(first, given), []
    if json.loads((root / "meta/modality.json").read_text()) != json.loads(json.dumps(modality(first, names))):
        problems.append(f"{root}/meta/modality.json: is not that of the episodes")
    said = json.loads((root / "meta/domino.json").read_text())
    wanted = {"names": list(first.log.vector_names), "episodes": episodes, "fps": first.fps, "embodiment": first.spec.embodiment}
    wanted["cameras"] = json.loads(json.dumps(described_cameras(first, names)))
    return problems + [f"{root}/meta/domino.json: {key} is not that of the episodes" for key in wanted if said[key] != wanted[key]]


def check_features(root: Path, info: Mapping[str, Any]) -> list[str]:
    """Every feature but the clock and lerobot's own language columns must have names."""
    unnamed = (*CLOCK_FEATURES, PERSISTENT, EVENTS)
    return [f"{root}: feature {n} has no names" for n, f in info["features"].items() if n not in unnamed and not f["names"]]


def _check_row(facts: Facts, index: int, start: int, row: dict[str, Any], tasks: dict[str, int], info: dict[str, Any]) -> list[str]:
    wanted: dict[str, Any] = {"episode_index": index, "length": facts.kept, "tasks": [facts.instruction]}
    wanted |= {"dataset_from_index": start, "dataset_to_index": start + facts.kept}
    wanted |= {f"domino.{name}": value for name, value in scalars(facts).items()}
    problems = [f"{name} is {row.get(name)!r}, not {value!r}" for name, value in wanted.items() if row.get(name) != value]
    if facts.instruction not in tasks:
        problems.append("its instruction is no task")
    if info["fps"] != facts.fps:
        problems.append(f"fps is {info['fps']}, not {facts.fps}")
    if info["features"]["action"]["names"] != list(facts.log.vector_names):
        problems.append("joint names differ")
    return problems


def check_columns(path: Path, index: int, columns: Mapping[str, Any]) -> list[str]:
    """Compare the rows of episode `index` in a data file with its columns (T,) or (T,d) or Arrow arrays, which must be equal."""
    got = pq.read_table(path, filters=[("episode_index", "==", index)])
    length = len(columns["index"])
    if len(got) != length:
        return [f"{len(got)} rows for {length} frames"]
    problems = []
    for name, want in columns.items():
        column = got[name].combine_chunks()
        if isinstance(want, pa.Array):
            problems += [f"column {name} differs"] * (column.to_pylist() != want.to_pylist())
            continue
        values = column.flatten().to_numpy().reshape(want.shape) if want.ndim == 2 else column.to_numpy(zero_copy_only=False)
        if not np.array_equal(values, want):
            problems.append(f"column {name} differs")
    return problems


class _Videos:
    """Reads the videos of a dataset forward only, each once; episodes must be asked for in order."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.leftover: list[str] = []
        self._open: dict[str, tuple[Path, Iterator[tuple[float, NDArray[np.uint8]]]]] = {}

    def read(self, key: str, chunk: int, file: int, count: int) -> list[tuple[float, NDArray[np.uint8]]]:
        """The next `count` (time, image) of a video file, fewer at its end."""
        path = self.root / VIDEO_PATH.format(video_key=key, chunk_index=chunk, file_index=file)
        current, frames = self._open.get(key, (None, iter(())))
        if current != path:
            self._finish(key)
            frames = frames_of(path)
            self._open[key] = path, frames
        return [frame for _, frame in zip(range(count), frames, strict=False)]

    def _finish(self, key: str) -> None:
        if key in self._open:
            path, frames = self._open.pop(key)
            extra = sum(1 for _ in frames)
            if extra:
                self.leftover.append(f"{path}: has {extra} images of no episode")

    def close(self) -> None:
        """Read the rest of the open files."""
        for key in list(self._open):
            self._finish(key)


def _check_video(file: EpisodeFile, camera: str, key: str, row: dict[str, Any], videos: _Videos) -> list[str]:
    place = {name: row[f"videos/{key}/{name}"] for name in ("chunk_index", "file_index", "from_timestamp", "to_timestamp")}
    got = videos.read(key, place["chunk_index"], place["file_index"], row["length"])
    if abs(place["to_timestamp"] - place["from_timestamp"] - row["length"] / file.fps) > 1e-4:
        return ["to_timestamp is not the end of the episode"]
    return check_images(file, camera, row["length"], got, place["from_timestamp"])


def check_images(file: EpisodeFile, camera: str, count: int, got: list[tuple[float, NDArray[np.uint8]]], start: float) -> list[str]:
    """Compare decoded (time, image) pairs with the first `count` frames of a camera, the first at `start` s: count, times, colors,
    order."""
    if len(got) != count:
        return [f"video holds {len(got)} images for {count} frames"]
    if np.abs(np.array([t for t, _ in got]) - start - np.arange(count) / file.fps).max() > 1e-4:
        return ["video times are not those of the frames"]
    source = list(islice(file.frames(camera), count))
    changes = [_mark_changes(a, b) for a, b in pairwise(source)]
    for t, (_, image) in enumerate(got):
        error = _distance(image, source[t], None)
        if error > IMAGE_TOLERANCE:
            return [f"image {t} is off by {error:.1f} of 255 on average"]
        for other in (t - 1, t + 1):
            if 0 <= other < count:
                where = changes[min(t, other)]
                moved = cv2.countNonZero(where) >= MOVED_PIXELS
                if moved and _distance(image, source[other], where) < _distance(image, source[t], where) / 2:
                    return [f"image {t} shows frame {other}"]
    return []


def _mark_changes(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Mask (H,W), 255 where two images differ by more than CLEAR in any channel."""
    highest = np.full(3, CLEAR, np.float64)
    return np.asarray(cv2.bitwise_not(cv2.inRange(cv2.absdiff(a, b), np.zeros(3), highest)), np.uint8)


def _distance(a: NDArray[np.uint8], b: NDArray[np.uint8], where: Any) -> float:
    """Mean absolute difference of two images (H,W,3), 0-255, over a mask (H,W) or all of them."""
    return float(np.mean(cv2.mean(cv2.absdiff(a, b), where)[:3]))
