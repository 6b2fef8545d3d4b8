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
renderer and its first frame, once an episode. "Mpx/s" are pixels of `raster` a second of a
processor, "peer" the ratio to ManiSkill3's: MANISKILL3. The last line is the floor of any software
renderer: every pixel cleared, tested for depth and lit once by one light. "first look" is `raster` as episodes of the first
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
from numba import njit
from numpy.typing import NDArray

from benchmarks.hardware import hardware
from pipeline.data.episode.visuals import FIRST_LOOK
from pipeline.data.imperfections import Sensors
from pipeline.run.names import recipe_from
from pipeline.stages.attempt import attempt
from pipeline.stages.drawing.exposure import exposed
from pipeline.stages.drawing.render import Appearance, appearance_of, body_poses, renderer
from pipeline.stages.failure import Failure
from pipeline.world.drawing.renderer import device_of
from pipeline.world.drawing.sensing import Sensing

SCENES = (
    "click_bell:aloha",
    "place_container_plate:franka",
    "handover_block:ur5",
    "place_object_basket@randomized:arx",
)
PIXELS = 320 * 240
PRESETS = ("raster", "raster-fast")
MANISKILL3 = 736 * 128 * 128 / 28.2
"""Pixels a second of ManiSkill3 3.0.1 on an AMD EPYC without a GPU: PickCube-v1, ten demonstrations
of its planner replayed with one 128x128 camera, 736 frames in 28.2 s."""
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


@njit(cache=True, error_model="numpy", fastmath={"nnan", "nsz"})
def _light_once(depths: NDArray[np.float32], image: NDArray[np.uint8]) -> None:
    one, half = np.float32(1), np.float32(0.5)
    for p in range(len(depths)):
        depths[p] = np.float32(0)
    for p in range(len(depths)):
        nearer = one > depths[p]
        depths[p] = one if nearer else depths[p]
        x, y = np.float32(p % 320) - np.float32(160), np.float32(p // 320) - np.float32(120)
        away = one / np.sqrt(x * x + y * y + np.float32(90000))
        light = np.sqrt(max(half * x * away + half, np.float32(0)))
        image[p, 0] = np.uint8(np.int32(light * np.float32(255)))
        image[p, 1] = np.uint8(np.int32(light * np.float32(200)))
        image[p, 2] = np.uint8(np.int32(light * np.float32(150)))


def least() -> float:
    """Milliseconds of a processor to clear, test and light each pixel of a frame once."""
    depths, image = np.empty(PIXELS, np.float32), np.empty((PIXELS, 4), np.uint8)
    _light_once(depths, image)
    spent = list[float]()
    for _ in range(20):
        began = time.process_time()
        for _ in range(50):
            _light_once(depths, image)
        spent.append((time.process_time() - began) / 50 * 1e3)
    return min(spent)


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
    device = device_of("raster")
    print(
        f"{hardware(device)}; three cameras of 320x240, ms of a processor (of the clock) per camera"
        " frame\n"
    )
    presets = list(dict.fromkeys([*options.presets, "raster", "raster-fast"]))
    print(
        f"| scene | {' | '.join(presets)} | first look | room | bodies | shadows | new, s"
        f" | Mpx/s | peer |\n|---|{'---|' * (len(presets) + 7)}"
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
            f"{PIXELS / full / 1e3:.1f}",
            f"{PIXELS / full * 1e3 / MANISKILL3:.0f}",
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

    print(f"\nfloor, every pixel lit once: {least():.2f} ms")


if __name__ == "__main__":
    main()
