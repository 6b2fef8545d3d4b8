"""Seconds an episode costs in each export format, against bare encoding of the same frames (codecs:
benchmarks/video_codecs.py).

    python -m benchmarks.export [--episodes 6] [--frames 200] [--grow 2] [--episode FILE ...]

Without --episode it exports drawn episodes: three cameras of 320x240, a textured room, an arm and a
target in motion.

The floor of the LeRobot formats is PyAV alone: RGB arrays in memory -> H.264 in an mp4 in memory,
one thread, the export's settings. It includes the conversion of RGB to YUV and nothing else: no
reading, no JPEG, no statistics, no table, no file, no check. The export begins at the episode files
and ends with the directory, in one process, too. "by lerobot" is lerobot's add_frame and
save_episode with the same encoder, given the features that the export has and the same episode
files. Rows are measured in turns, `--turns` times; medians of the CPU time count, because a machine
in use by others makes wall time longer than it is.
"""

import argparse
import os
import platform
import shutil
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.data.cameras import CAMERA_TYPES, Camera, View
from pipeline.data.episode.file import Episode, open_episode
from pipeline.data.episode.meta import CameraInfo, EpisodeMeta
from pipeline.data.episode.state_log import CONTACT_DTYPE, Event, StateLog
from pipeline.data.episode.writer import write_episode
from pipeline.data.names import SIDES
from pipeline.data.spec import EpisodeSpec
from pipeline.export import EXPORTERS, Job
from pipeline.export.formats.lerobot.format import (
    CLOCK_FEATURES,
    data_columns,
    features_of,
    image_key,
)
from pipeline.export.shared.episodes import exported_cameras, read_facts, reading
from pipeline.export.shared.record import read_record
from pipeline.export.shared.video import Codec, encode
from pipeline.motion.planar import PlanarMotion
from pipeline.poses import pose
from pipeline.world.looks.visuals import CLEAN

FPS = 15
NAMES = tuple(
    f"{side}_{n}" for side in SIDES for n in (*(f"joint{i}" for i in range(1, 7)), "gripper")
)
REQUIRED = {"robotwin": {"jpeg_order": "rgb"}}


def drawn_frames(count: int, seed: int) -> list[NDArray[np.uint8]]:
    """Pictures (240,320,3) of a lit, textured table with a target that slides 1.6 pixels a frame
    and an arm that swings."""
    rng = np.random.default_rng(seed)
    noise = [
        cv2.GaussianBlur(rng.normal(size=(240, 320, 3)).astype(np.float32), (0, 0), s)
        for s in (2.0, 1.5)
    ]
    rows, columns = np.mgrid[:240, :320]
    table = (
        np.stack([150 + rows / 8, 140 + columns / 16, 120 + rows / 10], -1)
        + 6 * noise[0] / noise[0].std()
    )
    target = (12 * noise[1] / noise[1].std() + (200, 60, 50))[:60, :60].astype(np.float32)
    out = []
    for t in range(count):
        swing = 40 * np.sin(t / 30)
        shift = np.array([[1, 0, 100 + 1.6 * (t % 60)], [0, 1, 100 + 0.4 * (t % 60)]], np.float32)
        placed = cv2.warpAffine(target, shift, (320, 240))
        mask = cv2.warpAffine(np.ones((60, 60), np.float32), shift, (320, 240))[..., None]
        picture = np.ascontiguousarray(
            np.clip(table * (1 - mask) + placed * mask, 0, 255).astype(np.uint8)
        )
        cv2.line(
            picture,
            (300, 0),
            (round(220 - swing), round(90 + swing / 2)),
            (40, 40, 45),
            14,
            cv2.LINE_AA,
        )
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
    cameras = [
        Camera(n, CAMERA_TYPES["D435"], None, pose())
        for n in ("head_camera", "left_camera", "right_camera")
    ]
    views = [
        View(c, moving, np.stack(drawn_frames(frames, 3 * slot + i))) for i, c in enumerate(cameras)
    ]
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
            "drawing": {
                "preset": "raster",
                "visuals": CLEAN,
                "cameras": {c.name: CameraInfo.of(c) for c in cameras},
            },
        }
    )
    texts = {"seen": [f"instruction {i}" for i in range(20)], "unseen": []}
    motion = PlanarMotion.still(moving[0], float(times[frames // 2])).to_json()
    spec = EpisodeSpec("benchmark", "aloha-agilex", 1, 0.1, "clean", slot, 0)
    write_episode(path, Episode(spec, log, motion, texts, meta), views)
    return path


@dataclass
class ExportRow:
    """Measurements of one row of the table: wall and CPU seconds of every turn, and bytes
    written."""

    name: str
    call: Callable[[], object]
    floor: "ExportRow | None" = None
    written: Path | None = None
    wall: list[float] = field(default_factory=list)
    cpu: list[float] = field(default_factory=list)

    def turn(self) -> None:
        """Call once, as if nothing had been written before."""
        if self.written is not None:
            shutil.rmtree(self.written, ignore_errors=True)
        wall, cpu = time.perf_counter(), time.process_time()
        self.call()
        self.wall.append(time.perf_counter() - wall)
        self.cpu.append(time.process_time() - cpu)

    def line(self, episodes: int) -> str:
        """The row of the table."""
        wall, cpu = (float(np.median(values)) / episodes for values in (self.wall, self.cpu))
        size = (
            f"{megabytes(self.written) / episodes:11.2f}" if self.written is not None else " " * 11
        )
        ratio = (
            f"{np.median(np.array(self.cpu) / np.array(self.floor.cpu)):9.2f}"
            if self.floor is not None
            else ""
        )
        return f"{self.name:42} {wall:10.3f} {cpu:14.3f} {3600 / cpu:15.0f} {size} {ratio}".rstrip()


def read_pictures(paths: list[Path]) -> list[list[NDArray[np.uint8]]]:
    """Decoded frames, one list per episode and camera."""
    out = []
    for path in paths:
        with open_episode(path) as e:
            out += [list(e.frames(camera)) for camera in e.cameras]
    return out


def _check(dataset: Path, out: Path, episodes: list[Path]) -> list[str]:
    return read_record(out).check(dataset, episodes)


def rows_of(paths: list[Path], root: Path) -> list[ExportRow]:
    """Each format, its floor and its check."""
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

    encoding, copying = (
        ExportRow("floor: PyAV encodes RGB arrays", bare_encode),
        ExportRow("floor: write the JPEG bytes", write_jpegs),
    )
    raw = ExportRow("floor: write raw images", write_raw)
    floors = {"lerobot": encoding, "lerobot-v2.1": encoding, "aloha": raw}
    rows = [encoding, copying, raw]
    for name, exporter in EXPORTERS.items():
        out = root / "exports" / name
        job = Job(root, out, paths, exporter.options(**REQUIRED.get(name, {})))
        # imports and encoder start-up are no cost of an episode
        exporter.export(replace(job, episodes=paths[:1]))
        row = ExportRow(name, partial(exporter.export, job), floors.get(name, copying), out)
        rows += [row, ExportRow(f"{name}: check", partial(_check, root, out, paths))]
    compressed = Job(
        root, root / "exports" / "compressed", paths, EXPORTERS["aloha"].options(compress="jpeg")
    )
    rows.append(
        ExportRow(
            "aloha --compress jpeg",
            partial(EXPORTERS["aloha"].export, compressed),
            copying,
            compressed.out,
        )
    )
    rows.append(
        ExportRow(
            "by lerobot: add_frame, save_episode",
            partial(by_lerobot, paths, root),
            encoding,
            root / "by_lerobot",
        )
    )
    return rows


def by_lerobot(paths: list[Path], root: Path) -> None:
    """The same dataset by lerobot's own writer: features, images and encoder settings are those of
    our export."""
    from lerobot.configs import RGBEncoderConfig
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    codec, writer, names = Codec(), None, {}
    for path in paths:
        with reading(path) as file:
            facts = read_facts(file, root)
            names = names or exported_cameras(facts, {})
            columns = data_columns(facts, names, 0, 0, {})
            if writer is None:
                given = {
                    n: f
                    for n, f in features_of(facts, codec, names).items()
                    if n not in CLOCK_FEATURES
                }
                features = {
                    n: {"dtype": f["dtype"], "shape": tuple(f["shape"]), "names": f["names"]}
                    for n, f in given.items()
                }
                encoder = RGBEncoderConfig(
                    vcodec=codec.name,
                    g=codec.gop,
                    crf=codec.quality,
                    preset=codec.options()["preset"],
                )
                writer = LeRobotDataset.create(
                    "benchmark/by_lerobot",
                    facts.fps,
                    features,
                    root / "by_lerobot",
                    video_backend="pyav",
                    rgb_encoder=encoder,
                    encoder_threads=1,
                )
            images = {image_key(name): list(file.frames(camera)) for camera, name in names.items()}
            vectors = {
                name: values for name, values in columns.items() if name not in CLOCK_FEATURES
            }
            for t in range(len(facts)):
                frame = {name: values[t] for name, values in (vectors | images).items()}
                writer.add_frame({**frame, "task": facts.instruction})
        writer.save_episode(parallel_encoding=False)
    if writer is not None:
        writer.finalize()


def growth(paths: list[Path], new: int, root: Path) -> list[str]:
    """The cost of an export after the last `new` episodes were added, a line a format: seconds, and
    bytes written."""
    lines = []
    for name, exporter in EXPORTERS.items():
        out = root / "grown" / name
        job = Job(root, out, paths, exporter.options(**REQUIRED.get(name, {})))
        exporter.export(replace(job, episodes=paths[:-new]))
        before = {p.stat().st_ino for p in out.rglob("*") if p.is_file()}
        cpu = time.process_time()
        exporter.export(job)
        again = time.process_time() - cpu
        anew = [
            p.stat().st_size
            for p in out.rglob("*")
            if p.is_file() and p.stat().st_ino not in before
        ]
        shutil.rmtree(out)
        cpu = time.process_time()
        exporter.export(job)
        whole = time.process_time() - cpu
        size = f"{sum(anew) / 1e6:8.1f} of {megabytes(out):8.1f} MB"
        lines.append(
            f"{name:14} {again:8.2f} s of {whole:8.2f} s   {size} in {len(anew)} files are new"
        )
    return lines


def megabytes(folder: Path) -> float:
    """Size of all files of a directory."""
    return sum(p.stat().st_size for p in folder.rglob("*") if p.is_file()) / 1e6


def processor() -> str:
    """Name of the processor."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    return next(
        (line.split(":")[1].strip() for line in lines if line.startswith("model name")),
        platform.machine(),
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--episodes", type=int, default=6)
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument(
        "--grow", type=int, default=2, help="episodes that are new in the second table, 0 for none"
    )
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument(
        "--episode", type=Path, nargs="*", help="episode files to export instead of drawn ones"
    )
    args = parser.parse_args()
    load = os.getloadavg()[0]
    print(
        f"{processor()}, {os.cpu_count()} cores, one process, load {load:.1f} at the start; Python"
        f" {platform.python_version()}\n"
    )
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        where = root / "episodes" / "benchmark"
        paths = args.episode or [
            drawn_episode(where / f"episode_{i:07d}.hdf5", args.frames, i)
            for i in range(args.episodes)
        ]
        with open_episode(paths[0]) as e:
            size = "x".join(map(str, e.rgb(e.cameras[0], 0).shape[:2]))
            print(
                f"{len(paths)} episodes; the first has {len(e)} frames of {len(e.cameras)} cameras,"
                f" {size} pixels"
            )
        size = sum(path.stat().st_size for path in paths) / 1e6
        print(f"an episode file has {size / len(paths):.2f} MB\n")
        rows = rows_of(paths, root)
        for _ in range(args.turns):
            for row in rows:
                row.turn()
        print(
            f"{'format':42} {'s/episode':>10} {'CPU s/episode':>14} {'episodes/CPU-h':>15}"
            f" {'MB/episode':>11} {'of floor':>9}"
        )
        for row in rows:
            print(row.line(len(paths)))
        if args.grow:
            print(
                f"\nexported again with the last {args.grow} episodes new (CPU s), against an empty"
                " directory:"
            )
            print("\n".join(growth(paths, args.grow, root)))


if __name__ == "__main__":
    main()
