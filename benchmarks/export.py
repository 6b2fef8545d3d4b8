"""Seconds an episode costs in each export format, against bare encoding of the same frames (codecs: benchmarks/video_codecs.py).

    python -m benchmarks.export [--episodes 6] [--frames 200] [--episode FILE ...]

Without --episode it exports drawn episodes: three cameras of 320x240, a textured room, an arm and a target in motion.
"""

import argparse
import os
import platform
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.data.cameras import CAMERA_TYPES, Camera, View
from pipeline.data.episode import Episode, open_episode
from pipeline.data.episode_writer import write_episode
from pipeline.data.meta import CameraInfo, EpisodeMeta
from pipeline.data.spec import EpisodeSpec
from pipeline.data.state_log import CONTACT_DTYPE, Event, StateLog
from pipeline.export import EXPORTERS, Job
from pipeline.export.video import Codec, encode
from pipeline.motion.target_motion import TargetMotion
from pipeline.poses import pose
from pipeline.world.visuals import CLEAN

FPS = 15
NAMES = tuple(f"{side}_{n}" for side in ("left", "right") for n in (*(f"joint{i}" for i in range(1, 7)), "gripper"))
REQUIRED = {"robotwin": {"jpeg_order": "rgb"}}


def drawn_frames(count: int, seed: int) -> list[NDArray[np.uint8]]:
    """Pictures (240,320,3) of a lit, textured table with a target that slides 1.6 pixels a frame and an arm that swings."""
    rng = np.random.default_rng(seed)
    noise = [cv2.GaussianBlur(rng.normal(size=(240, 320, 3)).astype(np.float32), (0, 0), s) for s in (2.0, 1.5)]
    rows, columns = np.mgrid[:240, :320]
    table = np.stack([150 + rows / 8, 140 + columns / 16, 120 + rows / 10], -1) + 6 * noise[0] / noise[0].std()
    target = (12 * noise[1] / noise[1].std() + (200, 60, 50))[:60, :60].astype(np.float32)
    out = []
    for t in range(count):
        swing = 40 * np.sin(t / 30)
        shift = np.array([[1, 0, 100 + 1.6 * (t % 60)], [0, 1, 100 + 0.4 * (t % 60)]], np.float32)
        placed = cv2.warpAffine(target, shift, (320, 240))
        mask = cv2.warpAffine(np.ones((60, 60), np.float32), shift, (320, 240))[..., None]
        picture = np.ascontiguousarray(np.clip(table * (1 - mask) + placed * mask, 0, 255).astype(np.uint8))
        cv2.line(picture, (300, 0), (round(220 - swing), round(90 + swing / 2)), (40, 40, 45), 14, cv2.LINE_AA)
        out.append(picture)
    return out


def drawn_episode(path: Path, frames: int, slot: int) -> Path:
    """An episode file of drawn pictures."""
    times = np.arange(frames) / FPS
    wave = np.sin(times[:, None] + np.arange(14))
    moving = np.repeat(pose((0, 0, 0.74))[None], frames, 0)
    moving[:, 0] += 0.1 * times
    log = StateLog(
        times=times,
        bodies=("target", "left_hand", "right_hand", "table"),
        poses=np.repeat(moving[:, None], 4, 1),
        joints=NAMES,
        qpos=wave,
        qvel=wave,
        vector_names=NAMES,
        state=wave,
        action=wave,
        tcp=np.repeat(moving[:, None], 2, 1),
        target_velocity=np.repeat([[0.1, 0, 0]], frames, 0),
        contacts=np.zeros(0, CONTACT_DTYPE),
        events=[Event("meeting", float(times[frames // 2]))],
    )
    cameras = [Camera(n, CAMERA_TYPES["D435"], None, pose()) for n in ("head_camera", "left_camera", "right_camera")]
    views = [View(c, moving, np.stack(drawn_frames(frames, 3 * slot + i))) for i, c in enumerate(cameras)]
    meta = EpisodeMeta.model_validate(
        {
            "fps": FPS,
            "target": "target",
            "manipulated": "target",
            "category": "tracking",
            "arms": {"arm": "left"},
            "objects": {"target": {}},
            "meeting_time": float(times[frames // 2]),
            "average_speed": 0.1,
            "maximum_speed": 0.1,
            "drawing": {"preset": "raster", "visuals": CLEAN, "cameras": {c.name: CameraInfo.of(c) for c in cameras}},
        }
    )
    texts = {"seen": [f"instruction {i}" for i in range(20)], "unseen": []}
    motion = TargetMotion.still(moving[0], float(times[frames // 2])).to_json()
    spec = EpisodeSpec("benchmark", "aloha-agilex", 1, 0.1, "clean", slot, 0)
    write_episode(path, Episode(spec, log, motion, texts, meta), views)
    return path


def seconds(call: Callable[[], object]) -> tuple[float, float]:
    """Wall and CPU seconds of a call."""
    wall, cpu = time.perf_counter(), time.process_time()
    call()
    return time.perf_counter() - wall, time.process_time() - cpu


def read_pictures(paths: list[Path]) -> list[list[NDArray[np.uint8]]]:
    """Decoded frames, one list per episode and camera."""
    out = []
    for path in paths:
        with open_episode(path) as e:
            out += [list(e.frames(camera)) for camera in e.cameras]
    return out


def formats(paths: list[Path], root: Path) -> list[tuple[str, float, float, float]]:
    """(name, wall s, CPU s, megabytes) for each format, its check and its floor; totals over all episodes."""
    pictures = read_pictures(paths)
    jpegs = []
    for path in paths:
        with open_episode(path) as e:
            jpegs += [e.array(f"observation/{camera}/rgb").tobytes() for camera in e.cameras]

    def bare_encode() -> None:
        for frames in pictures:
            encode(frames, FPS, Codec())

    def write_raw() -> None:
        for frames in pictures:
            (root / "floor").write_bytes(np.stack(frames).tobytes())

    def write_jpegs() -> None:
        for data in jpegs:
            (root / "floor").write_bytes(data)

    encoding = ("encode alone", bare_encode)
    copying = ("write JPEG bytes", write_jpegs)
    floors = {
        "lerobot": encoding,
        "lerobot-v2.1": encoding,
        "aloha": ("write raw images", write_raw),
        "parquet": copying,
        "robotwin": copying,
        "dynamicwam": copying,
    }
    rows = []
    for name, exporter in EXPORTERS.items():
        out = root / "exports" / name
        job = Job(root, out, paths, exporter.options(**REQUIRED.get(name, {})))
        exporter.export(replace(job, episodes=paths[:1]))  # imports and encoder start-up are no cost of an episode
        rows.append((name, *seconds(lambda: exporter.export(job)), _megabytes(out)))  # noqa: B023
        if name in floors:
            said, floor = floors[name]
            rows.append((f"{name}: floor, {said}", *seconds(floor), 0.0))
        rows.append((f"{name}: check", *seconds(lambda: exporter.check(root, out, paths)), 0.0))  # noqa: B023
    return rows


def _megabytes(folder: Path) -> float:
    return sum(p.stat().st_size for p in folder.rglob("*") if p.is_file()) / 1e6


def processor() -> str:
    """Name of the processor."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    return next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), platform.machine())


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=6)
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--episode", type=Path, nargs="*", help="episode files to export instead of drawn ones")
    args = parser.parse_args()
    load = os.getloadavg()[0]
    print(f"{processor()}, {os.cpu_count()} cores, one process, load {load:.1f} at the start; Python {platform.python_version()}\n")
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        where = root / "episodes" / "benchmark"
        paths = args.episode or [drawn_episode(where / f"episode_{i:07d}.hdf5", args.frames, i) for i in range(args.episodes)]
        with open_episode(paths[0]) as e:
            size = "x".join(map(str, e.rgb(e.cameras[0], 0).shape[:2]))
            print(f"{len(paths)} episodes; the first has {len(e)} frames of {len(e.cameras)} cameras, {size} pixels")
        print(f"{'format':34} {'s/episode':>10} {'CPU s/episode':>14} {'episodes/h':>11} {'MB/episode':>11}")
        for name, wall, cpu, size in formats(paths, root):
            n = len(paths)
            written = f"{size / n:11.2f}" if size else ""
            print(f"{name:34} {wall / n:10.3f} {cpu / n:14.3f} {3600 * n / wall:11.0f} {written}")


if __name__ == "__main__":
    main()
