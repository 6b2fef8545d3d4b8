"""Milliseconds per camera frame, read-back included, of scenes that builds draw: by preset, and
where the time of `raster` goes.

    python -m benchmarks.rendering [--scenes click_bell:aloha ...] [--presets raster ...] [--frames 32] [--truth] [--sensors]

An episode of every scene is rolled out once, level 1; a task with "@randomized" gets that domain.
Its frames are drawn from the head and wrist cameras (320x240), preset after preset in every repeat,
so that all meet the same load; the lower quartile of the repeats is shown. Processor time is of
this process, all threads, so it holds on a busy machine too; wall time only on an idle one.

The split is by difference. "room" is a frame without any body and without shadows, the floor of
what a frame can cost; "bodies" is what `raster-fast` takes more, "shadows" what `raster` takes more
than that: its share of the shadow map, and the look-ups. "new" is what it costs to make the
renderer and its first frame, once an episode. "first look" is `raster` as episodes of the first
look are drawn. With `--sensors`, a line below has what each imperfection of the cameras adds to
`raster`.
"""  # noqa: E501

import argparse
import itertools
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.hardware import hardware
from pipeline.data.episode.visuals import FIRST_LOOK
from pipeline.data.imperfections import Sensors
from pipeline.run.names import recipe_from
from pipeline.stages.attempt import attempt
from pipeline.stages.drawing.exposure import exposed
from pipeline.stages.drawing.render import Appearance, appearance_of, body_poses, renderer
from pipeline.stages.failure import Failure
from pipeline.world.drawing.sensing import Sensing
from pipeline.world.drawing.vulkan import ensure_renderer

SCENES = (
    "click_bell:aloha",
    "place_container_plate:franka",
    "handover_block:ur5",
    "place_object_basket@randomized:arx",
)
PRESETS = ("raster", "raster-fast", "raster-smooth")
EFFECTS = {
    "noise": Sensors(noise=2),
    "drift": Sensors(drift=0.1),
    "motion_blur": Sensors(motion_blur=8),
    "latency": Sensors(latency=0.5),
    "depth_noise": Sensors(depth_noise="d435"),
}


@dataclass(frozen=True)
class SceneJob:
    """One row of a table: what to draw, and its poses (T,7) by body."""

    appearance: Appearance
    poses: dict[str, NDArray[np.float64]]


@dataclass(frozen=True)
class Cost:
    """Milliseconds per camera frame, by this processor and by the clock, and seconds of the
    processor until the first frame."""

    cpu: float
    wall: float
    new: float


def rolled_out(scene: str) -> SceneJob:
    """The first accepted attempt at a scene "task[@domain]:embodiment". Raises SystemExit when none
    of 30 is accepted."""
    name, embodiment = scene.split(":")
    task, _, domain = name.partition("@")
    recipe = recipe_from(
        {
            "tasks": [task],
            "embodiments": [embodiment],
            "levels": [1],
            "domains": [domain or "clean"],
            "episodes": 1,
        }
    )
    slot = next(recipe.slots())
    for number in range(30):
        try:
            rollout = attempt(recipe.spec(slot, number), recipe)
        except Failure:
            continue
        return SceneJob(appearance_of(rollout.scene), body_poses(rollout.replay.log))
    raise SystemExit(f"no attempt at {scene} was accepted")


def size(job: SceneJob) -> str:
    """Bodies and triangles of a scene in words."""
    parts = [parts for parts in job.appearance.bodies.values() if parts]
    triangles = sum(
        len(mesh.triangles) for mesh, _ in itertools.chain(*parts, job.appearance.furniture)
    )
    return f"{len(parts)} bodies, {triangles} triangles"


def without_bodies(job: SceneJob) -> SceneJob:
    """The same cameras in the empty room."""
    bodies = dict.fromkeys(job.appearance.bodies, ())
    return SceneJob(
        replace(job.appearance, bodies=bodies, furniture=(), preset="raster-fast"), job.poses
    )


def in_first_look(job: SceneJob) -> SceneJob:
    """The same as older episodes are drawn."""
    return SceneJob(
        replace(
            job.appearance,
            preset="raster",
            visuals=replace(job.appearance.visuals, look=FIRST_LOOK),
        ),
        job.poses,
    )


def measure(jobs: dict[str, SceneJob], frames: int, repeats: int, truth: bool) -> dict[str, Cost]:
    """The cost of every job, drawn in turns."""
    new, times, draw = (
        dict[str, float](),
        defaultdict[str, list[tuple[float, float]]](list),
        dict[str, Callable[[], object]](),
    )
    opened = []
    for name, job in jobs.items():
        began = time.process_time()
        drawing = renderer(job.appearance)
        exposed(drawing, job.poses, [0], job.appearance.sensing, depth=truth, segmentation=truth)
        new[name] = time.process_time() - began
        opened.append(drawing)
        count = min(frames, len(next(iter(job.poses.values()))))
        draw[name] = lambda d=drawing, j=job, n=count: exposed(
            d, j.poses, range(n), j.appearance.sensing, depth=truth, segmentation=truth
        )
    for _ in range(repeats):
        for name, job in jobs.items():
            cpu, wall = time.process_time(), time.perf_counter()
            draw[name]()
            count = min(frames, len(next(iter(job.poses.values())))) * len(job.appearance.cameras)
            times[name].append(
                (
                    (time.process_time() - cpu) / count * 1e3,
                    (time.perf_counter() - wall) / count * 1e3,
                )
            )
    for drawing in opened:
        drawing.close()
    quartile = {name: np.quantile(np.array(runs), 0.25, axis=0) for name, runs in times.items()}
    return {name: Cost(float(q[0]), float(q[1]), new[name]) for name, q in quartile.items()}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", nargs="+", default=list(SCENES))
    parser.add_argument("--presets", nargs="+", default=list(PRESETS))
    parser.add_argument("--frames", type=int, default=32)
    parser.add_argument("--repeats", type=int, default=8)
    parser.add_argument(
        "--truth", action="store_true", help="also read depth and segmentation back"
    )
    parser.add_argument(
        "--sensors", action="store_true", help="also what each imperfection of the cameras costs"
    )
    options = parser.parse_args()
    device = ensure_renderer()
    print(
        f"{hardware(device)}; three cameras of 320x240, ms of a processor (of the clock) per camera"
        " frame\n"
    )
    presets = list(dict.fromkeys([*options.presets, "raster", "raster-fast"]))
    print(
        f"| scene | {' | '.join(presets)} | first look | room | bodies | shadows | new, s"
        f" |\n|---|{'---|' * (len(presets) + 5)}"
    )
    for scene in options.scenes:
        job = rolled_out(scene)
        jobs = {name: SceneJob(replace(job.appearance, preset=name), job.poses) for name in presets}
        jobs |= {"first look": in_first_look(job), "room": without_bodies(job)}
        cost = measure(jobs, options.frames, options.repeats, options.truth)
        cells = [
            f"{cost[name].cpu:.1f} ({cost[name].wall:.1f})" for name in (*presets, "first look")
        ]
        room, fast, full = (cost[name].cpu for name in ("room", "raster-fast", "raster"))
        split = [
            f"{room:.1f}",
            f"{fast - room:.1f}",
            f"{full - fast:.1f}",
            f"{cost['raster'].new:.2f}",
        ]
        print(f"| {scene}, {size(job)} | {' | '.join([*cells, *split])} |", flush=True)
        if options.sensors:
            flawed = {
                name: replace(job.appearance, sensing=Sensing(sensors, 0, 15))
                for name, sensors in EFFECTS.items()
            }
            jobs = {"raster": job} | {
                name: SceneJob(appearance, job.poses) for name, appearance in flawed.items()
            }
            cost = measure(jobs, options.frames, options.repeats, truth=True)
            added = ", ".join(
                f"{name} {cost[name].cpu - cost['raster'].cpu:.1f}" for name in EFFECTS
            )
            print(
                f"\nsensors add, ms of a processor per camera frame with depth: {added}\n",
                flush=True,
            )


if __name__ == "__main__":
    main()
