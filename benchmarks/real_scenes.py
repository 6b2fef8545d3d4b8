"""One picture of vendors' robots that catch objects of others: `python -m benchmarks.real_scenes
LAB OUT.jpg [--frames DIR]`.

LAB is the directory of plugins that `benchmarks.robots` and `benchmarks.real_objects` filled (`--to
LAB`). With `--frames` each scene is also written as PNG files of 640x480: from across the table,
close to the hand, by the head camera.
"""

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.figures import labelled, scaled
from pipeline.data.cameras import CameraType, framed
from pipeline.data.names import CAMERAS
from pipeline.data.recipe.model import Recipe
from pipeline.data.spec import EpisodeSpec
from pipeline.plugins import load_plugins, use_plugins
from pipeline.run.names import resolve
from pipeline.stages.attempt import Phases, Rollout, attempt
from pipeline.stages.drawing.redraw import FACING, FILMED, facing
from pipeline.stages.drawing.render import appearance_of, render
from pipeline.stages.failure import Failure

AFTER = 0.6  # s after the meeting: the hand has closed and lifts
HEAD = CameraType(640, 480, 37.0)
CLOSE = (-0.17, 0.17)  # m to each side of the object
ACROSS, WIDTH, SEEDS = 4, 320, 6

type Image = NDArray[np.uint8]


@dataclass(frozen=True)
class Catch:
    """A robot, an object, the family that it stands for, and the task that catches it."""

    robot: str
    name: str
    family: str
    task: str


CATCHES = (
    Catch("ur5e-robotiq", "plain_mug", "cup", "place_empty_cup"),
    Catch("kinova3-robotiq", "milk", "pill_bottle", "move_pillbottle_pad"),
    Catch("xarm7-robotiq", "soda_can", "can", "place_can_basket"),
    Catch("ms-panda", "bread_loaf", "bread", "place_bread_basket"),
    Catch("ur5e-robotiq", "apple", "bread", "place_bread_basket"),
    Catch("kinova3-robotiq", "duck", "playing_cards", "move_playingcard_away"),
    Catch("xarm7-robotiq", "cereal", "playing_cards", "move_playingcard_away"),
    Catch("ms-panda", "lego_brick", "playing_cards", "move_playingcard_away"),
)


def caught(one: Catch, level: int = 1, alpha: float = 0.1) -> Rollout | None:
    """The first accepted rollout of SEEDS layouts; None where all fail."""
    recipe = resolve(
        Recipe(tasks=(one.task,), embodiments=(one.robot,), objects={one.family: (one.name,)})
    )
    for seed in range(SEEDS):
        try:
            return attempt(
                EpisodeSpec(one.task, one.robot, level, alpha, "clean", 0, seed), recipe, Phases()
            )
        except Failure as failure:
            print(f"{one.robot} {one.name} {seed}: {failure.stage} {failure.reason}", flush=True)
    return None


def images(rollout: Rollout) -> dict[str, Image]:
    """Images (480,640,3) just after the meeting, by name: from across the table, close to the hand,
    by the head camera."""
    scene, log = rollout.scene, rollout.replay.log
    appearance = appearance_of(scene)
    head = next(camera for camera in appearance.cameras if camera.name == CAMERAS["head"])
    frame = min(int(np.searchsorted(log.times, rollout.meeting + AFTER)), len(log) - 1)
    around = log.pose(scene.task.target)[frame, :3] + [
        (x, y, z) for x in CLOSE for y in CLOSE for z in (-0.1, 0.26)
    ]
    close = replace(
        facing(log, scene.task.target), name="close", pose=framed(around, FACING, FILMED, 0.0)
    )
    cameras = (facing(log, scene.task.target), close, replace(head, type=HEAD))
    views = render(
        replace(appearance, cameras=cameras, preset="raster-smooth"), log, frames=[frame]
    )
    return dict(zip(("across", "close", "head"), (view.rgb[0] for view in views), strict=True))


def save(path: Path, image: Image, *options: int) -> None:
    """Write an RGB image."""
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), cv2.cvtColor(image, cv2.COLOR_RGB2BGR), options)


def main() -> None:
    """Draw the scenes whose robot and object are in LAB."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("lab", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--frames", type=Path)
    given = parser.parse_args()
    use_plugins([str(given.lab)])
    load_plugins()
    panels = list[Image]()
    for one in CATCHES:
        here = (given.lab / "robots" / one.robot).is_dir() and (
            given.lab / "objects" / one.name
        ).is_dir()
        rollout = caught(one) if here else None
        if rollout is None:
            print(f"left out: {one.robot} with {one.name}", flush=True)
            continue
        seen = images(rollout)
        if given.frames is not None:
            for name, image in seen.items():
                save(given.frames / f"{one.robot}_{one.name}_{name}.png", image)
        across = labelled(
            scaled(seen["across"], WIDTH), f"{one.robot}: {one.name.replace('_', ' ')}"
        )
        panels.append(np.vstack([across, scaled(seen["close"], WIDTH)]))
    rows = [
        np.hstack(panels[k : k + ACROSS]) for k in range(0, len(panels) // ACROSS * ACROSS, ACROSS)
    ]
    save(given.out, np.vstack(rows), cv2.IMWRITE_JPEG_QUALITY, 82)


if __name__ == "__main__":
    main()
