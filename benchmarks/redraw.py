"""What it costs to draw stored episodes again, per camera frame, against the floor: bare rendering
of the same frames.

    python -m benchmarks.redraw [DATASET] [--episodes 6] [--size 640x480] [--depth] [--variants 2] [--repeats 2] ...

Options that are not known here are those of `domino-data render`. The whole is everything that a
worker does for an episode: read and check the file, load what it is drawn from, render, encode and
write. The floor draws the same frames with a renderer that is built and warm. The first episode is
drawn once before, uncounted, because a process opens the driver and loads shaders once.
"""  # noqa: E501

import argparse
import tempfile
import time
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

from benchmarks.hardware import hardware
from benchmarks.phases import timed_phases
from pipeline.commands.build import with_looks
from pipeline.commands.options import parse_value
from pipeline.data.dataset import Dataset
from pipeline.data.episode.file import EpisodeFile
from pipeline.data.recipe.model import Recipe, parse_recipe
from pipeline.data.slots.assets import AssetStore
from pipeline.run.render import work_of
from pipeline.run.slot.redraw import DrawJob, draw_slot
from pipeline.stages.drawing.render import body_poses, renderer, stored_appearance
from pipeline.world.drawing.renderer import device_of

PHASES = ("read", "render", "encode", "write")

SENSORS = ("depth", "segmentation", "pointcloud")


@dataclass(frozen=True)
class RedrawCost:
    """Of one episode: camera frames, seconds by phase, and of the whole and of the floor, by the
    clock and of this processor."""

    frames: int
    phases: dict[str, float]
    whole: float
    whole_cpu: float
    floor: float
    floor_cpu: float


def cost(job: DrawJob) -> RedrawCost:
    """Draw one slot as `domino-data render` does, then its frames again with everything at hand."""
    began, worked = time.perf_counter(), time.process_time()
    with timed_phases() as phases:
        drawn = draw_slot(job)
    whole, whole_cpu = time.perf_counter() - began, time.process_time() - worked
    if isinstance(drawn, str):
        raise SystemExit(drawn)
    out = Dataset(Path(job.out))
    with EpisodeFile(out.episode(job.slot)) as file:
        episode = file.read()
    recipe = job.recipe
    depth, segmentation = recipe.depth or recipe.pointcloud, recipe.segmentation
    with renderer(stored_appearance(episode, AssetStore(out.bodies))) as drawing:
        poses = body_poses(episode.log)
        drawing.render(poses, frames=[0], depth=depth, segmentation=segmentation)
        began, worked = time.perf_counter(), time.process_time()
        drawing.render(poses, depth=depth, segmentation=segmentation)
        floor, floor_cpu = time.perf_counter() - began, time.process_time() - worked
    frames = len(episode.log) * len(episode.meta.drawing.cameras)
    return RedrawCost(frames, phases, whole, whole_cpu, floor, floor_cpu)


def measure(source: Dataset, recipe: Recipe, episodes: int, repeats: int) -> list[RedrawCost]:
    """Costs of so many slots, every repeat into a dataset of its own; of each slot the repeat with
    the least of processor time."""
    best: dict[int, RedrawCost] = {}
    for repeat in range(repeats + 1):
        with tempfile.TemporaryDirectory() as folder:
            out = Dataset(Path(folder) / "out")
            out.create(recipe)
            jobs = work_of(source, out, recipe, recipe.slots()).jobs[: episodes if repeat else 1]
            for number, found in enumerate(map(cost, jobs)):
                if repeat and (number not in best or found.whole_cpu < best[number].whole_cpu):
                    best[number] = found
    return list(best.values())


def table(costs: list[RedrawCost], recipe: Recipe) -> str:
    """A Markdown table of milliseconds per camera frame."""
    frames = sum(c.frames for c in costs)
    phases: dict[str, float] = defaultdict(float)
    for c in costs:
        for name, seconds in c.phases.items():
            phases[name] += 1000 * seconds / frames
    sums = {
        name: 1000 * sum(getattr(c, name) for c in costs) / frames
        for name in ("whole", "whole_cpu", "floor", "floor_cpu")
    }
    rows = [(name, phases[name], phases[f"{name}.cpu"]) for name in PHASES]
    rows += [
        ("**whole**", sums["whole"], sums["whole_cpu"]),
        ("**floor: bare rendering**", sums["floor"], sums["floor_cpu"]),
    ]
    size = "x".join(map(str, recipe.size)) if recipe.size else recipe.camera
    sensors = ", ".join(["rgb", *(name for name in SENSORS if getattr(recipe, name))])
    return "\n".join(
        [
            f"{len(costs)} episodes, {frames} camera frames, {recipe.render}, {size}, {sensors}",
            "",
            "| ms per camera frame | wall | processor |",
            "|---|---:|---:|",
            *(f"| {name} | {wall:.2f} | {cpu:.2f} |" for name, wall, cpu in rows),
            (
                f"| whole / floor | {sums['whole'] / sums['floor']:.2f} |"
                f" {sums['whole_cpu'] / sums['floor_cpu']:.2f} |"
            ),
        ]
    )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "dataset",
        type=Path,
        nargs="?",
        default=Path("out/first"),
        help="out/first, which make build makes",
    )
    parser.add_argument("--episodes", type=int, default=6)
    parser.add_argument("--repeats", type=int, default=2)
    for option in ("cameras", "size", "render"):
        parser.add_argument(f"--{option}")
    for sensor in SENSORS:
        parser.add_argument(f"--{sensor}", action="store_true", default=None)
    parser.add_argument("--variants", type=int, help="randomized looks of each episode")
    given = parser.parse_args()
    source = Dataset(given.dataset)
    keys = ("cameras", "size", "render", *SENSORS, "variants")
    changes = {
        key: parse_value(key, value) for key in keys if (value := getattr(given, key)) is not None
    }
    changes = with_looks(changes, "randomized" if given.variants else "keep")
    recipe = parse_recipe(source.recipe().model_dump() | changes)
    print(hardware(device_of("raster")), "\n")
    print(table(measure(source, recipe, given.episodes, given.repeats), recipe))


if __name__ == "__main__":
    main()
