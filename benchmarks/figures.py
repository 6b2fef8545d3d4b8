"""The README's images.

python -m benchmarks.figures robots docs/robots.jpg
python -m benchmarks.figures hero STILL.hdf5 MOVING.hdf5 docs/hero.webp
python -m benchmarks.figures stages docs/stages.png
python -m benchmarks.figures beyond docs/beyond.webp
python -m benchmarks.figures decide docs/decide.webp
python -m benchmarks.figures pair docs/pair.webp
python -m benchmarks.figures domino docs/domino.webp
python -m benchmarks.figures variants EPISODE.hdf5 docs/variants.jpg
python -m benchmarks.figures effects ROWS.jsonl docs/event_effects.png
"""

import argparse
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray
from PIL import Image

from benchmarks.filming import facing, film
from benchmarks.ladder import effect, effect_groups
from pipeline.data.cameras import View
from pipeline.data.episode.events import EventSpec
from pipeline.data.episode.file import Episode, open_episode
from pipeline.data.names import CAMERAS, SIDES
from pipeline.data.recipe.model import Cell, Recipe
from pipeline.data.setup import Setup
from pipeline.data.slots.assets import AssetStore
from pipeline.data.spec import CONTROL, EpisodeSpec
from pipeline.evaluate.episode import EpisodeJob, play_arm
from pipeline.evaluate.names import policy_name
from pipeline.evaluate.scenes.benchmark import read_benchmark
from pipeline.evaluate.scenes.case import Case
from pipeline.evaluate.scoring.clock import parse_clock
from pipeline.report.film_strip import draw_path, meeting_frame, path_pixels
from pipeline.stages.attempt import Rollout, attempt
from pipeline.stages.drawing.render import (
    appearance_of,
    render,
    stored_appearance,
    visuals_of,
    with_setup,
)
from pipeline.stages.failure import Failure
from pipeline.tasks.contract import expand_tasks
from pipeline.world.drawing.vulkan import ensure_renderer
from pipeline.world.robots import MODELS


def accepted(task: str, robot: str, level: int = 1, alpha: float = 0.1, first: int = 0) -> Rollout:
    """The first accepted rollout of a task on a robot among 50 seeds from `first` on."""
    for seed in range(first, first + 50):
        try:
            return attempt(EpisodeSpec(task, robot, level, alpha, "clean", 0, seed), Recipe())
        except Failure:
            continue
    raise SystemExit(f"no seed of {task} on {robot} was accepted")


def from_the_side(rollout: Rollout, frames: list[int]) -> NDArray[np.uint8]:
    """Images (N,480,640,3) of frames of a rollout from across the table, both arms and the whole
    path of the target in view."""
    scene, log = rollout.scene, rollout.replay.log
    camera = facing(log, scene.task.target)
    appearance = replace(appearance_of(scene), cameras=(camera,), preset="raster")
    return render(appearance, log, frames=frames)[0].rgb


def with_path(view: View, episode: Episode) -> NDArray[np.uint8]:
    """The images (T,H,W,3) of a view of an episode, a copy, with the target's path drawn in."""
    pixels, in_front = path_pixels(
        view.camera.type, view.poses, episode.log.pose(episode.meta.target)
    )
    images, meeting = view.rgb.copy(), meeting_frame(episode)
    for i, image in enumerate(images):
        draw_path(image, pixels, in_front, i, meeting)
    return images


def robots(out: Path, task: str = "shake_bottle") -> None:
    """Each robot at home and with a caught bottle in its hand."""
    rows = []
    for name in MODELS:
        rollout = accepted(task, name)
        log = rollout.replay.log
        held = int(np.searchsorted(log.times, (log.time_of("meeting") or 0.0) + 1.2))
        images = [
            labelled(image, name) for image in from_the_side(rollout, [0, min(held, len(log) - 1)])
        ]
        rows.append(np.vstack([scaled(image, 480) for image in images]))
    cv2.imwrite(
        str(out), cv2.cvtColor(np.hstack(rows), cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 88]
    )


WIDTH, INSET = 480, 140
"""Pixels across of an image from across the table and of the wrist camera's in its corner."""


def panel(path: Path, title: str) -> list[NDArray[np.uint8]]:
    """Frames (H,W,3) of an episode: from across the table with the target's path, in a corner the
    busier arm's wrist camera."""
    with open_episode(path) as e:
        episode = e.read()
    busiest = SIDES[int(np.ptp(episode.log.tcp[:, :, :3], axis=0).sum(axis=1).argmax())]
    outside, wrist = film(path, path.parents[5] / "assets" / "bodies", CAMERAS[busiest])
    frames = []
    for image, small in zip(with_path(outside, episode), wrist.rgb, strict=True):
        frame, small = scaled(image, WIDTH), scaled(small, INSET)
        height, width = small.shape[:2]
        frame[-6 - height : -6, 6 : 6 + width] = small
        cv2.rectangle(
            frame,
            (5, frame.shape[0] - 7 - height),
            (6 + width, frame.shape[0] - 6),
            (245, 245, 245),
            1,
        )
        frames.append(labelled(frame, title))
    return frames


def scaled(image: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    """An image at another width."""
    return np.asarray(
        cv2.resize(
            image, (width, image.shape[0] * width // image.shape[1]), interpolation=cv2.INTER_AREA
        ),
        np.uint8,
    )


def labelled(image: NDArray[np.uint8], text: str) -> NDArray[np.uint8]:
    """The image with a text in its upper left corner, in place."""
    for color, thick in (((245, 245, 245), 3), ((30, 30, 30), 1)):
        cv2.putText(image, text, (8, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.5, color, thick, cv2.LINE_AA)
    return image


def hero(still: Path, moving: Path, out: Path) -> None:
    """The same task beside itself, still and moving, as an animated WebP of every second frame in
    the episodes' own time."""
    sides = [panel(still, "level 0: still")[::2], panel(moving, "level 3: abrupt changes")[::2]]
    count = max(len(frames) for frames in sides) + 6
    gap = np.full((sides[0][0].shape[0], 6, 3), 255, np.uint8)
    images = [
        Image.fromarray(
            np.hstack(
                [sides[0][min(i, len(sides[0]) - 1)], gap, sides[1][min(i, len(sides[1]) - 1)]]
            )
        )
        for i in range(count)
    ]
    images[0].save(
        out,
        save_all=True,
        append_images=images[1:],
        duration=round(2000 / 15),
        loop=0,
        quality=72,
        method=6,
    )


def around_meeting(rollout: Rollout) -> list[int]:
    """Every second frame from 34 before the meeting to 14 after it."""
    met, last = round(rollout.meeting * 15), len(rollout.replay.log) - 1
    return [min(max(met + step, 0), last) for step in range(-34, 16, 2)]


def whole(rollout: Rollout) -> list[int]:
    """Forty frames of the whole episode, evenly in time."""
    return np.linspace(0, len(rollout.replay.log) - 1, 40).round().astype(int).tolist()


def animate(
    suite: str,
    out: Path,
    across: int,
    width: int,
    quality: int,
    shown: Callable[[Rollout], list[int]] = around_meeting,
) -> None:
    """The frames `shown` of tasks of a suite, the robots taking turns, as an animated WebP of so
    many columns of a width in pixels."""
    names, robots, panels = expand_tasks([suite]), [*MODELS], list[NDArray[np.uint8]]()
    for k, name in enumerate(names[: len(names) // across * across]):
        rollout = accepted(name, robots[k % len(robots)], 1 + k % 3, first=20)
        rgb = from_the_side(rollout, shown(rollout))
        small = [labelled(scaled(image, width), name.replace("_", " ")) for image in rgb]
        panels.append(np.array(small))
        print(name, flush=True)
    rows = [np.concatenate(panels[k : k + across], axis=2) for k in range(0, len(panels), across)]
    images = [Image.fromarray(frame) for frame in np.concatenate(rows, axis=1)]
    times = [round(2000 / 15)] * (len(images) - 1) + [900]
    images[0].save(
        out,
        save_all=True,
        append_images=images[1:],
        duration=times,
        loop=0,
        quality=quality,
        method=6,
    )


def beyond(out: Path) -> None:
    """Twenty tasks of the suite `beyond`."""
    animate("beyond", out, 4, 320, 62)


def decide(out: Path) -> None:
    """The twelve tasks of the suite `decide`, from beginning to end."""
    animate("decide", out, 4, 320, 55, whole)


def domino(out: Path) -> None:
    """The 35 tasks of the suite `domino`."""
    animate("domino", out, 5, 256, 55)


def variants(path: Path, out: Path) -> None:
    """An episode at its meeting as it was stored and in three randomized looks, from the head
    camera and from the observer."""
    with open_episode(path) as e:
        episode = e.read()
    stored = stored_appearance(episode, AssetStore(path.parents[5] / "assets" / "bodies"))
    setup = Setup(cameras=("head", "observer"), size=(640, 480), visuals="randomized")
    looks = [stored.visuals, *(visuals_of(episode.spec, setup, k) for k in range(3))]
    columns = []
    for look in looks:
        appearance = replace(
            with_setup(stored, setup, look, episode.log.sides, None), preset="raster"
        )
        views = render(appearance, episode.log, frames=[meeting_frame(episode) or 0])
        columns.append(np.vstack([scaled(view.rgb[0], 320) for view in views]))
    cv2.imwrite(
        str(out),
        cv2.cvtColor(np.hstack(columns), cv2.COLOR_RGB2BGR),
        [cv2.IMWRITE_JPEG_QUALITY, 88],
    )


def travelled(rollout: Rollout) -> float:
    """How far (m) the target comes from its start to the meeting."""
    start, end = rollout.motion.pose(0.0)[:2], rollout.motion.pose(rollout.meeting)[:2]
    return float(np.hypot(*(end - start)))


def stages(out: Path, task: str = "shake_bottle") -> None:
    """The three stages of one level-2 episode at 0.2 m/s, from above: the plan in the still scene,
    the motion calculated backwards from the meeting, and both replayed on one clock."""
    rollout = max(
        (accepted(task, "aloha-agilex", 2, 0.2, seed) for seed in range(0, 400, 50)), key=travelled
    )
    log, meeting = rollout.replay.log, rollout.meeting
    target = log.pose(rollout.scene.task.target)[:, :2] * 100
    met = int(np.searchsorted(log.times, meeting))
    tools = log.tcp[:, :, :2] * 100
    hand = tools[:, int(np.ptp(tools, axis=0).sum(axis=1).argmax())]
    figure, panels = plt.subplots(
        1, 3, figsize=(11, 3.6), sharex=True, sharey=True, layout="constrained"
    )
    titles = (
        (
            "1. Dry run: the target stands still;\nthe first touch gives $T_{meet}$ ="
            f" {meeting:.2f} s"
        ),
        "2. Back-calculation: a motion that is\nat the same place at $T_{meet}$",
        "3. Replay: the same plan, the moving\ntarget, one clock",
    )
    for index, (axes, title) in enumerate(zip(panels, titles, strict=True)):
        axes.set_title(title, fontsize=10, loc="left")
        if index != 1:
            axes.plot(
                *hand[: met + 1].T,
                color="#4464ad",
                lw=1.6,
                label="hand, planned" if index == 0 else "hand, replayed",
            )
            axes.plot(*hand[0], "s", color="#4464ad", ms=5)
        if index:
            arrows(axes, target[: met + 1], backwards=index == 1)
        if index == 2:
            for time in np.linspace(0, meeting, 5):
                i = int(np.searchsorted(log.times, time))
                axes.plot(*np.stack([hand[i], target[i]]).T, color="#999999", lw=0.7, ls=":")
                axes.annotate(
                    f"{log.times[i]:.1f} s",
                    hand[i],
                    fontsize=7,
                    color="#4464ad",
                    xytext=(4, 4),
                    textcoords="offset points",
                )
        axes.plot(*target[met], "o", ms=12, mfc="none", mec="#e0a100", mew=2, label="meeting")
        axes.set_xlabel("x, to the right (cm)")
        axes.set_aspect("equal")
        axes.legend(fontsize=7, loc="best", frameon=False)
    panels[0].set_ylabel("y, away from the robot (cm)")
    figure.savefig(out, dpi=110)


def arrows(axes: Axes, path: NDArray[np.float64], backwards: bool) -> None:
    """Draw a path (T,2), with an arrow in the direction in which it is calculated or run
    through."""
    axes.plot(
        *path.T,
        color="#b5179e",
        lw=1.8,
        label="target, calculated backwards" if backwards else "target, moving",
    )
    axes.plot(*path[0], "o", color="#b5179e", ms=5)
    step = -1 if backwards else 1
    for share in (0.3, 0.7):
        i = int(share * (len(path) - 1))
        a, b = path[i], path[i + step]
        axes.annotate(
            "", b + 3 * (b - a), a, arrowprops={"arrowstyle": "->", "color": "#b5179e", "lw": 1.5}
        )


def pair(out: Path) -> None:
    """One scene without its event and with it, acted in by the policy that extrapolates."""
    job = EpisodeJob(
        benchmark_case("shake_bottle"),
        policy_name("interceptor"),
        parse_clock("sim"),
        setup=Setup(cameras=(), events=(EventSpec.model_validate("stop@share=0.6"),)),
    )
    sides, camera = list[list[NDArray[np.uint8]]](), None
    for arm, title in ((CONTROL, "without the event"), ("", "the bottle stops")):
        case = replace(job.case, spec=replace(job.case.spec, arm=arm))
        trial, row = play_arm(replace(job, case=case))
        log = trial.log()
        camera = camera or facing(log, trial.scene.task.target)
        appearance = appearance_of(trial.scene)
        appearance = replace(appearance, cameras=(camera,), preset="raster")
        frames = list(range(0, min(len(log), 70), 2))
        rgb = render(appearance, log, frames=frames)[0].rgb
        title += ": success" if row["success"] else f": {row['failure']}"
        sides.append([labelled(scaled(image, 400), title) for image in rgb])
    count = max(map(len, sides))
    images = [
        Image.fromarray(np.hstack([side[min(i, len(side) - 1)] for side in sides]))
        for i in range(count)
    ]
    times = [round(2000 / 15)] * (count - 1) + [1200]
    images[0].save(
        out, save_all=True, append_images=images[1:], duration=times, loop=0, quality=65, method=6
    )


def benchmark_case(task: str) -> Case:
    """The first scene of a task at level 1 in domino-v1."""
    cell = Cell(task, "aloha-agilex", 1, 0.1, "clean")
    return read_benchmark("domino-v1").cases([cell], 1)[cell][0]


def effects(rows: Path, out: Path) -> None:
    """Paired effects of events, by rows of benchmarks.ladder: a panel a kind, a point a policy."""
    groups = effect_groups([json.loads(line) for line in rows.read_text().splitlines()])
    kinds, policies = (list(dict.fromkeys(key[i] for key in groups)) for i in (0, 1))
    figure, axes = plt.subplots(
        1, len(kinds), figsize=(1.5 * len(kinds) + 1.5, 0.3 * len(policies) + 1.2), sharey=True
    )
    for kind, axis in zip(kinds, np.atleast_1d(axes), strict=True):
        for place, policy in enumerate(policies):
            if own := groups.get((kind, policy)):
                mean, low, high = effect(own)
                axis.plot([low, high], [place, place], color="#9ca3af", lw=2)
                axis.plot(mean, place, "o", color="#b91c1c" if high < 0 else "#1f2937", ms=5)
        axis.axvline(0, color="#d1d5db", lw=1, zorder=0)
        axis.set(title=kind, xlim=(-108, 108), xticks=(-100, 0, 100))
        axis.spines[["top", "right", "left"]].set_visible(False)
        axis.tick_params(left=False)
    np.atleast_1d(axes)[0].set_yticks(range(len(policies)), policies)
    np.atleast_1d(axes)[0].invert_yaxis()
    figure.supxlabel("effect of the event on the success rate, points (95 %)", fontsize=9)
    figure.tight_layout()
    figure.savefig(out, dpi=120)


FIGURES = {
    "effects": effects,
    "robots": robots,
    "hero": hero,
    "stages": stages,
    "beyond": beyond,
    "decide": decide,
    "domino": domino,
    "pair": pair,
    "variants": variants,
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=FIGURES)
    parser.add_argument("paths", nargs="+", type=Path)
    args = parser.parse_args()
    ensure_renderer()
    FIGURES[args.what](*args.paths)


if __name__ == "__main__":
    main()
