"""What an accepted episode costs, phase by phase, against the floor: bare rendering of the same
frames with everything at hand.

    python -m benchmarks.generation [--tasks all] [--levels 1,3] [--episodes 2] [--workers 1,2] [--embodiment aloha] [--out FILE.md] [--processes]

Processor seconds are what a phase costs on a core of its own; wall seconds show what else the
machine was doing. Every worker first makes one episode that is not counted, because a process
compiles, opens the renderer and loads shaders once. `--processes` needs no Ray: plain processes take
the slots.
"""  # noqa: E501

import argparse
import tempfile
import time
from collections import defaultdict, deque
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import islice
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from benchmarks.hardware import hardware
from benchmarks.phases import timed_phases
from benchmarks.rendering import MANISKILL3, PIXELS
from pipeline.crew.contract import Crew, Done
from pipeline.crew.loop import run
from pipeline.data.dataset import Dataset
from pipeline.data.episode.file import EpisodeFile
from pipeline.data.recipe.model import Recipe, Slot
from pipeline.data.slots.records import SlotRecord
from pipeline.run.build import ATTEMPT_SECONDS
from pipeline.run.names import recipe_from
from pipeline.run.slot.fill import FillJob, fill_slot
from pipeline.stages.drawing.render import appearance_of, body_poses, renderer
from pipeline.stages.scene import build_scene
from pipeline.world.drawing.renderer import device_of

PHASES = ("scene", "dry_run", "back_calculate", "replay", "render", "encode", "write")
PHYSICS = PHASES[:4]


@dataclass(frozen=True)
class Made:
    """One worker's answer: the slot's record, seconds by phase, frames of its episode, and wall and
    processor seconds of drawing them barely."""

    record: SlotRecord
    phases: dict[str, float]
    frames: int = 0
    floor: float = 0.0
    floor_cpu: float = 0.0


def make(job: FillJob) -> Made:
    """Fill a slot as a build does, then draw its frames again with the renderer already built and
    warm."""
    with timed_phases() as phases:
        record = fill_slot(job)
    if not record.accepted:
        return Made(record, phases)
    with EpisodeFile(Dataset(Path(job.root)).episode(job.slot)) as file:
        episode = file.read()
    with renderer(appearance_of(build_scene(episode.spec), job.recipe)) as drawing:
        poses = body_poses(episode.log)
        drawing.render(poses, frames=[0])
        began, worked = time.perf_counter(), time.process_time()
        drawing.render(poses)
        wall, cpu = time.perf_counter() - began, time.process_time() - worked
        return Made(record, phases, len(episode.log), wall, cpu)


def measure(recipe: Recipe, workers: int, plain: bool = False) -> list[Made]:
    """All slots of the recipe made by so many workers, without each worker's first; `plain`
    processes instead of Ray's."""
    with tempfile.TemporaryDirectory() as folder:
        slots = [*islice(_warming(recipe), workers), *recipe.slots()]
        jobs = deque(FillJob(folder, recipe, slot) for slot in slots)
        if plain:
            with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
                return list(pool.map(make, jobs))[workers:]
        crew = Crew("inline" if workers == 1 else "ray", workers)
        ends = list(run(lambda: make, jobs, crew, ATTEMPT_SECONDS * recipe.attempts))
    first = slots[:workers]
    return [end.result for end in ends if isinstance(end, Done) and end.job.slot not in first]


def _warming(recipe: Recipe) -> Iterator[Slot]:
    """Slots beyond those that the recipe wants."""
    cell = recipe.cells()[0]
    index = recipe.wanted(cell)
    while True:
        yield Slot(cell, index)
        index += 1


def report(made: list[Made], workers: int) -> str:
    """A Markdown table: mean seconds per accepted episode by phase, failed attempts included; the
    floor, rates and ratios."""
    accepted = [m for m in made if m.record.accepted]
    if not accepted:
        return f"### {workers} workers\n\nno episode was accepted\n"
    n = len(accepted)
    phases: dict[str, float] = defaultdict(float)
    for m in made:
        for name, seconds in m.phases.items():
            phases[name] += seconds / n
    frames = float(np.mean([m.frames for m in accepted]))
    attempts = sum(len(m.record.attempts) for m in made)
    wall, cpu = (sum(phases[p + end] for p in PHASES) for end in ("", ".cpu"))
    floor, floor_cpu = (
        float(np.mean([getattr(m, key) for m in accepted])) for key in ("floor", "floor_cpu")
    )
    rows = [(p.replace("_", " "), phases[p], phases[f"{p}.cpu"]) for p in PHASES]
    rows += [
        (
            "**physics and planning**",
            sum(phases[p] for p in PHYSICS),
            sum(phases[f"{p}.cpu"] for p in PHYSICS),
        ),
        ("**total**", wall, cpu),
        ("**render floor**", floor, floor_cpu),
    ]
    lines = [
        (
            f"### {workers} worker{'s' if workers > 1 else ''}: {n} episodes of {frames:.0f} frames"
            f" x 3 cameras, {attempts} attempts"
        ),
        "",
        "| seconds per accepted episode | wall | processor |",
        "|---|---:|---:|",
        *(f"| {name} | {a:.3f} | {b:.3f} |" for name, a, b in rows),
        f"| total / floor | {wall / floor:.2f} | {cpu / floor_cpu:.2f} |",
        (
            f"| ms per camera frame, floor | {1000 * floor / frames / 3:.2f} |"
            f" {1000 * floor_cpu / frames / 3:.2f} |"
        ),
        (
            "| pixels a second, floor, times ManiSkill3's |"
            f" {frames * 3 * PIXELS / floor / MANISKILL3:.0f} |"
            f" {frames * 3 * PIXELS / floor_cpu / MANISKILL3:.0f} |"
        ),
        f"| **episodes per hour** | **{3600 * workers / wall:.0f}** | {3600 * workers / cpu:.0f} |",
        "",
    ]
    return "\n".join(lines)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--tasks",
        default="click_bell,place_container_plate,beat_block_hammer,shake_bottle,grab_roller,handover_block",
    )
    parser.add_argument("--embodiment", default="aloha")
    parser.add_argument("--levels", default="1,3")
    parser.add_argument("--episodes", type=int, default=1, help="per task and level")
    parser.add_argument("--workers", default="1,2", help="numbers of workers, comma separated")
    parser.add_argument("--render", default="raster")
    parser.add_argument("--processes", action="store_true", help="without Ray")
    parser.add_argument("--out", type=Path, help="write the tables to this file as well")
    given = parser.parse_args()
    recipe = recipe_from(
        {
            "tasks": given.tasks.split(","),
            "embodiments": given.embodiment.split(","),
            "levels": [int(level) for level in given.levels.split(",")],
            "episodes": given.episodes,
            "render": given.render,
        }
    )
    text = f"{hardware(device_of('raster'))}\n\n"
    text += "\n".join(
        report(measure(recipe, int(workers), given.processes), int(workers))
        for workers in given.workers.split(",")
    )
    print(text)
    if given.out:
        given.out.write_text(text)


if __name__ == "__main__":
    main()
