"""Frames per second of each annotation stage against its floor, and bytes per frame against the
original's layout.

Also files and pairs against that layout, and Farneback against exact flow on moving targets.

    python -m benchmarks.annotation [--dataset OUT] [--episodes 4] [--frames 150] [--models small|full|none] [--image PNG]

Without --dataset the episodes are drawn (benchmarks/export.py). Floors are bare calls on the same
frames in the same process: JPEG decode, resize, grey, Farneback, polar, HSV for flow; the networks'
forward passes on ready tensors at the same batch for masks and features. Networks have the real
architecture and random weights: `small` is what a CPU can bear (DINOv2-S, SAM 2 Hiera-T,
GroundingDINO Swin-T on small images), `full` is the default models' size. Exact flow needs
--dataset with real episodes; where they store no depth and segmentation they are rendered again.
"""  # noqa: E501

import argparse
import os
import platform
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import h5py
import numpy as np

from benchmarks.export import drawn_episode
from benchmarks.flow_agreement import flow_agreement
from benchmarks.random_models import random_models
from pipeline.annotate.flow import bit_stable
from pipeline.annotate.networks.features import load_encoder
from pipeline.annotate.networks.masks import load_detector, load_segmenter
from pipeline.annotate.networks.models import image_settings, inference, pick_device, resolve
from pipeline.annotate.options import (
    AnnotateOptions,
    FeatureOptions,
    FlowOptions,
    MaskOptions,
    WorldOptions,
)
from pipeline.annotate.overlays import annotation_sheet
from pipeline.annotate.selection import Absent, build_stages
from pipeline.annotate.stage import Redraw, Stage, directory_of, encoded_frames
from pipeline.annotate.store import episode_paths
from pipeline.annotate.work import StageWorker
from pipeline.annotate.world_stage import WorldStage
from pipeline.data.episode.file import open_episode
from pipeline.data.episode.frames import decode_frame
from pipeline.data.slots.annotations import annotation_path, read_entry
from pipeline.run.annotate import annotate

CAMERA = "head_camera"


def timed(call: Callable[[], object]) -> tuple[float, float]:
    """Wall and CPU seconds of a call."""
    wall, cpu = time.perf_counter(), time.process_time()
    call()
    return time.perf_counter() - wall, time.process_time() - cpu


def best(call: Callable[[], object], repeats: int) -> tuple[float, float]:
    """Least wall and least CPU seconds of several calls: the box is shared."""
    runs = [timed(call) for _ in range(repeats)]
    return min(w for w, _ in runs), min(c for _, c in runs)


def compare(
    ours: Callable[[], object], floor: Callable[[], object], repeats: int
) -> list[tuple[float, float]]:
    """Least wall and CPU seconds of both, run in turns so that a busy moment meets either."""
    runs = [(timed(ours), timed(floor)) for _ in range(repeats)]
    return [(min(r[i][0] for r in runs), min(r[i][1] for r in runs)) for i in range(2)]


def linked(dataset: Path, root: Path) -> Path:
    """A directory that has the dataset's episodes and assets, and none of its annotations."""
    root.mkdir(parents=True, exist_ok=True)
    for name in ("episodes", "assets"):
        (root / name).symlink_to(dataset.resolve() / name)
    return root


def flow_floor(dataset: Path, paths: Sequence[Path], stride: int = 4) -> None:
    """The paper's OpenCV calls on every frame, nothing else."""
    for path in paths:
        with open_episode(dataset / "episodes" / path) as e:
            frames = encoded_frames(e, CAMERA)
        grey, flow = [], np.zeros((64, 64, 2), np.float32)
        for data in frames:
            small = cv2.resize(decode_frame(data), (64, 64), interpolation=cv2.INTER_AREA)
            grey.append(cv2.cvtColor(small, cv2.COLOR_RGB2GRAY))
        for t in range(len(grey)):
            flow = cv2.calcOpticalFlowFarneback(
                grey[max(0, t - stride)], grey[t], flow, 0.5, 3, 15, 3, 5, 1.2, 0
            )
            magnitude, angle = cv2.cartToPolar(flow[..., 0], flow[..., 1], angleInDegrees=True)
            p99 = max(float(np.percentile(np.asarray(magnitude, np.float32), 99)), 1e-6)
            value = np.clip(magnitude / p99 * 255, 0, 255)
            hsv = np.stack([angle / 2, np.full_like(angle, 255), value], -1).astype(np.uint8)
            cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB)


def farneback_only(dataset: Path, path: Path) -> float:
    """CPU ms of one bare calcOpticalFlowFarneback at 64x64."""
    with open_episode(dataset / "episodes" / path) as e:
        flow = np.zeros((64, 64, 2), np.float32)
        pair = [
            cv2.cvtColor(cv2.resize(e.rgb(CAMERA, t), (64, 64)), cv2.COLOR_RGB2GRAY) for t in (0, 4)
        ]
    with bit_stable():
        _, cpu = best(
            lambda: [
                cv2.calcOpticalFlowFarneback(pair[0], pair[1], flow, 0.5, 3, 15, 3, 5, 1.2, 0)
                for _ in range(100)
            ],
            5,
        )
    return cpu * 10


def run_stage(stage: Stage, dataset: Path, paths: Sequence[Path]) -> Callable[[], object]:
    """A call that computes all episodes of a stage; its models are loaded beforehand."""
    worker = StageWorker(stage, dataset)
    worker.start()

    def call() -> None:
        for path in paths:
            annotation_path(dataset, directory_of(stage), path).unlink(missing_ok=True)
        actions = {o.action for o in worker.run(paths)}
        assert actions == {"computed"}, actions

    return call


def model_floors(
    options: AnnotateOptions, dataset: Path, paths: Sequence[Path]
) -> tuple[Callable[[], None], Callable[[], None]]:
    """Calls that run the bare forward passes of masks (one caption) and features for every frame,
    on ready tensors."""
    import torch

    device = pick_device("auto")
    m, f = options.masks, options.features
    files = resolve(m.detector)
    detector, segmenter = (
        load_detector(files, device),
        load_segmenter(resolve(m.segmenter), device),
    )
    encoder = load_encoder(resolve(f.encoder), f.size, device)
    short = image_settings(files)["size"]["shortest_edge"]
    counts = frame_counts(dataset, paths)
    with open_episode(dataset / "episodes" / paths[0]) as e:
        height, width = e.rgb(CAMERA, 0).shape[:2]
    text = detector.tokenizer(["a moving thing."], return_tensors="pt").to(device)
    image = torch.rand(m.batch, 3, short, int(short * width / height), device=device)
    square = torch.rand(m.batch, 3, segmenter.side, segmenter.side, device=device)
    boxes = torch.tensor([[[10.0, 10.0, 200.0, 200.0]]], device=device).repeat(m.batch, 1, 1)
    patches = torch.rand(f.batch, 3, f.size, f.size, device=device)

    def done() -> None:
        if device.startswith("cuda"):
            torch.cuda.synchronize()

    def batches(batch: int) -> list[int]:
        return [min(batch, n - s) for n in counts for s in range(0, n, batch)]

    def masks() -> None:
        with inference(device):
            for n in batches(m.batch):
                words = {k: v.expand(n, -1) for k, v in text.items()}
                detector.model(
                    pixel_values=image[:n],
                    pixel_mask=torch.ones_like(image[:n, 0], dtype=torch.long),
                    **words,
                )
                segmenter.model(
                    pixel_values=square[:n], input_boxes=boxes[:n], multimask_output=False
                )
        done()

    def features() -> None:
        with inference(device):
            for n in batches(f.batch):
                encoder.model(pixel_values=patches[:n])
        done()

    return masks, features


def stages_of(options: AnnotateOptions, *names: str) -> list[Stage]:
    """The stages of these names, with their models."""
    stages = build_stages(options, list(names), Redraw())
    return [stage for stage in stages if not isinstance(stage, Absent)]


def stage_rows(
    dataset: Path, paths: Sequence[Path], models: tuple[MaskOptions, FeatureOptions] | None
) -> list[list[str]]:
    """Rows of the table of stages."""
    options = AnnotateOptions()
    (flow,) = stages_of(options, "flow")
    pairs: list[tuple[Stage, Callable[[], object], Sequence[Path], int]] = [
        (flow, lambda: flow_floor(dataset, paths), paths, 3)
    ]
    if models is not None:
        options = AnnotateOptions(masks=models[0], features=models[1])
        few = paths[:1]
        masks, features = model_floors(options, dataset, few)
        stages = stages_of(options, "masks", "features")
        pairs += [(stages[0], masks, few, 1), (stages[1], features, few, 1)]
    rows = []
    for stage, floor, used, repeats in pairs:
        frames = sum(frame_counts(dataset, used))
        call = run_stage(stage, dataset, used)
        ours, bare = compare(call, floor, repeats)
        size = (
            sum(annotation_path(dataset, directory_of(stage), p).stat().st_size for p in used)
            / frames
        )
        reuse, _ = timed(lambda stage=stage, used=used: list(StageWorker(stage, dataset).run(used)))
        rates = [
            f"{frames / ours[0]:.1f}",
            f"{frames / bare[0]:.1f}",
            f"{ours[0] / bare[0]:.2f}",
            f"{ours[1] / bare[1]:.2f}",
        ]
        rates.append(f"{1e3 * ours[1] / frames:.2f}")
        rows.append([stage.name, str(frames), *rates, f"{size:.0f}", f"{frames / reuse:.0f}"])
    return rows


def frame_counts(dataset: Path, paths: Sequence[Path]) -> list[int]:
    """Frames of each episode."""
    out = []
    for path in paths:
        with open_episode(dataset / "episodes" / path) as e:
            out.append(len(e))
    return out


def original_layout(
    dataset: Path, directory: str, paths: Sequence[Path], root: Path
) -> list[tuple[str, int, int, int]]:
    """(what, computed, files, bytes) of the original's caches for the same frames, written for
    real: per step and offset one npz, four flow pairs (history 4, stride 4) and four future
    masks."""
    flow, masks = [0, 0, 0], [0, 0, 0]
    for path in paths:
        entry = read_entry(annotation_path(dataset, directory, path))
        steps = len(entry.arrays["rgb"])
        with open_episode(dataset / "episodes" / path) as e:
            height, width = e.rgb(CAMERA, 0).shape[:2]
        for step in range(steps):
            for offset in range(4):
                rgb = entry.arrays["rgb"][max(0, step - 4 * offset)]
                np.savez(root / "a.npz", flow_rgb=rgb)
                np.savez(
                    root / "b.npz",
                    mask=np.zeros((height, width), np.uint8),
                    box=np.zeros(4, np.float32),
                )
                for count, name in ((flow, "a.npz"), (masks, "b.npz")):
                    count[0] += 1
                    count[1] += 1
                    count[2] += (root / name).stat().st_size
    return [("flow", flow[0], flow[1], flow[2]), ("masks", masks[0], masks[1], masks[2])]


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print aligned columns."""
    widths = [max(len(str(r[i])) for r in [head, *rows]) for i in range(len(head))]
    for row in [head, *rows]:
        print(
            "  ".join(
                str(x).rjust(w) if i else str(x).ljust(w)
                for i, (x, w) in enumerate(zip(row, widths, strict=True))
            )
        )
    print()


def main(arguments: Sequence[str] | None = None) -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--dataset", type=Path)
    parser.add_argument("--episodes", type=int, default=4)
    parser.add_argument("--frames", type=int, default=150)
    parser.add_argument("--models", choices=("small", "full", "none"), default="none")
    parser.add_argument("--image", type=Path)
    a = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    machine = platform.processor() or platform.machine()
    print(
        f"{machine}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}; OpenCV"
        f" {cv2.__version__}"
    )
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        if a.dataset:
            dataset = linked(a.dataset, root / "data")
        else:
            dataset = root / "data"
            for i in range(a.episodes):
                drawn_episode(
                    dataset / f"episodes/benchmark/aloha-agilex/L1/clean/episode_{i:07d}.hdf5",
                    a.frames,
                    i,
                )
        everything = episode_paths(dataset)
        paths = everything[: a.episodes]
        models = random_models(root / "models", a.models) if a.models != "none" else None
        rows = stage_rows(dataset, paths, models)
        table(
            [
                "stage",
                "frames",
                "frames/s",
                "floor/s",
                "wall ratio",
                "CPU ratio",
                "CPU ms",
                "bytes/frame",
                "reused/s",
            ],
            rows,
        )
        print(
            f"bare Farneback at 64x64: {farneback_only(dataset, paths[0]):.2f} ms of CPU a pair\n"
        )
        print_layout(dataset, paths, root)
        if a.dataset:
            print_world(dataset, paths)
            print_errors(dataset, everything, a.image)


def print_layout(dataset: Path, paths: Sequence[Path], root: Path) -> None:
    """Ours against the original's, for the flow pairs and files of the same episodes."""
    directory = annotate(dataset, ["flow"])["stages"][0]["directory"]
    pairs = sum(n - 1 for n in frame_counts(dataset, paths))
    size = sum(annotation_path(dataset, directory, p).stat().st_size for p in paths)
    theirs = original_layout(dataset, directory, paths, root)
    rows = [["flow, ours (raw + RGB)", f"{pairs}", f"{len(paths)}", f"{size / 1e6:.1f}"]]
    rows += [
        [f"{name}, original", f"{n}", f"{files}", f"{b / 1e6:.1f}"] for name, n, files, b in theirs
    ]
    _, n, files, total = theirs[0]
    rows.append(
        [
            "flow, original / ours",
            f"{n / pairs:.2f}",
            f"{files / len(paths):.0f}",
            f"{total / size:.2f}",
        ]
    )
    table(["layout", "computed", "files", "MB"], rows)


def print_world(dataset: Path, paths: Sequence[Path]) -> None:
    """Processor time and bytes a frame of the stage `world`, without and with maps of every pixel,
    and the bytes of each array."""
    from functools import partial

    from pipeline.stages.drawing.truth import truth

    again, frames = (
        Redraw(truth=partial(truth, bodies=dataset / "assets" / "bodies")),
        sum(frame_counts(dataset, paths)),
    )
    rows, sizes = list[list[str]](), Counter[str]()
    for dense in (False, True):
        stage = WorldStage(WorldOptions(dense=dense), CAMERA, again.truth)
        wall, cpu = best(run_stage(stage, dataset, paths), 2)
        files = [annotation_path(dataset, directory_of(stage), path) for path in paths]
        size = sum(file.stat().st_size for file in files)
        rows.append(
            [
                "with maps" if dense else "without maps",
                f"{frames / wall:.1f}",
                f"{1e3 * cpu / frames:.1f}",
                f"{size / frames:.0f}",
            ]
        )
        for file in files if dense else ():
            with h5py.File(file) as f:
                sizes.update({name: array.id.get_storage_size() for name, array in f.items()})
    table(["world", "frames/s", "CPU ms", "bytes/frame"], rows)
    table(["array", "bytes/frame"], [[name, f"{n / frames:.0f}"] for name, n in sizes.items()])


def print_errors(dataset: Path, paths: Sequence[Path], image: Path | None) -> None:
    """Farneback against exact flow by level, and the image of the last episode."""
    from functools import partial

    from pipeline.stages.drawing.redraw import redraw

    again = Redraw(partial(redraw, bodies=dataset / "assets" / "bodies"))
    annotate(dataset, ["flow"], redraw=again)
    sim = AnnotateOptions(flow=FlowOptions(source="sim"), masks=MaskOptions(source="sim"))
    annotate(dataset, ["flow", "masks"], options=sim, redraw=again)
    report = flow_agreement(dataset, paths, CAMERA)
    names = ["pairs", "exact", "measured", "error", "angle", "error_still"]
    table(
        ["level", *names],
        [[level, *(str(row[n]) for n in names)] for level, row in report["levels"].items()],
    )
    if image is not None:
        moving = [p for p in paths if p.parts[2] != "L0"] or list(paths)
        sheet = annotation_sheet(dataset, moving[-1], CAMERA)
        assert sheet is not None
        cv2.imwrite(str(image), cv2.cvtColor(sheet, cv2.COLOR_RGB2BGR))
        print(f"image: {image}")


if __name__ == "__main__":
    main()
