"""One picture of twelve catches of fetched objects, half in the randomized domain: `python -m
benchmarks.real_scenes PLUGINS docs/real_scenes.jpg`.

PLUGINS is the directory that `domino-data objects fetch` filled.
"""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.figures import labelled, scaled
from benchmarks.filming import FACING, FILMED, facing, framed
from pipeline.data.recipe.model import Recipe
from pipeline.data.spec import EpisodeSpec
from pipeline.plugins import load_plugins, use_plugins
from pipeline.run.names import resolve
from pipeline.stages.attempt import Rollout, attempt
from pipeline.stages.drawing.render import appearance_of, render
from pipeline.stages.failure import Failure

AFTER = 0.6  # s after the meeting: the hand has closed and lifts
CLOSE = (-0.17, 0.17)  # m to each side of the object
ACROSS, WIDTH, SEEDS = 4, 320, 6

type Image = NDArray[np.uint8]


class Catch(NamedTuple):
    """A robot, an object, the family that it stands for, and the task that catches it."""

    robot: str
    name: str
    family: str
    task: str
    domain: str = "clean"


CATCHES = (
    Catch("aloha-agilex", "soda_can", "can", "place_can_basket"),
    Catch("franka-panda", "milk", "pill_bottle", "move_pillbottle_pad"),
    Catch("ur5-wsg", "plain_mug", "cup", "place_empty_cup"),
    Catch("piper", "apple", "bread", "place_bread_basket"),
    Catch("arx-x5", "short_can", "sauce_can", "move_can_pot"),
    Catch("franka-panda", "coffee_mug", "mug", "take_hanging_mug"),
    Catch("franka-panda", "cereal", "playing_cards", "move_playingcard_away", "randomized"),
    Catch("aloha-agilex", "glass_bottle", "bottle", "shake_bottle", "randomized"),
    Catch("ur5-wsg", "lemon", "bread", "place_bread_skillet", "randomized"),
    Catch("piper", "bread_loaf", "bread", "place_bread_basket", "randomized"),
    Catch("arx-x5", "lemon_ball", "play_ball", "stop_rolling_ball", "randomized"),
    Catch("aloha-agilex", "green_bridge", "playing_cards", "move_playingcard_away", "randomized"),
)


def caught(one: Catch, level: int = 1, alpha: float = 0.1) -> Rollout | None:
    """The first accepted rollout of SEEDS layouts; None where all fail."""
    recipe = resolve(
        Recipe(tasks=(one.task,), embodiments=(one.robot,), objects={one.family: (one.name,)})
    )
    for seed in range(SEEDS):
        try:
            spec = EpisodeSpec(one.task, one.robot, level, alpha, one.domain, 0, seed)
            return attempt(spec, recipe)
        except Failure as failure:
            print(f"{one.robot} {one.name} {seed}: {failure.stage} {failure.reason}", flush=True)
    return None


def images(rollout: Rollout) -> tuple[Image, Image]:
    """Images (480,640,3) just after the meeting: from across the table, and close to the hand."""
    scene, log = rollout.scene, rollout.replay.log
    frame = min(int(np.searchsorted(log.times, rollout.meeting + AFTER)), len(log) - 1)
    around = log.pose(scene.task.target)[frame, :3] + [
        (x, y, z) for x in CLOSE for y in CLOSE for z in (-0.1, 0.26)
    ]
    across = facing(log, scene.task.target)
    close = replace(across, name="close", pose=framed(around, FACING, FILMED, 0.0))
    drawing = replace(appearance_of(scene), cameras=(across, close), preset="raster")
    views = render(drawing, log, frames=[frame])
    return views[0].rgb[0], views[1].rgb[0]


def main() -> None:
    """Draw the catches of objects that are in PLUGINS."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("plugins", type=Path)
    parser.add_argument("out", type=Path)
    given = parser.parse_args()
    use_plugins([str(given.plugins)])
    load_plugins()
    panels = list[Image]()
    for one in CATCHES:
        rollout = caught(one)
        if rollout is None:
            print(f"left out: {one.robot} with {one.name}", flush=True)
            continue
        print(one.robot, one.name, one.domain, flush=True)
        across, close = images(rollout)
        title = f"{one.robot}: {one.name.replace('_', ' ')}"
        panels.append(np.vstack([labelled(scaled(across, WIDTH), title), scaled(close, WIDTH)]))
    whole = len(panels) // ACROSS * ACROSS
    rows = [np.hstack(panels[k : k + ACROSS]) for k in range(0, whole, ACROSS)]
    sheet = cv2.cvtColor(np.vstack(rows), cv2.COLOR_RGB2BGR)
    cv2.imwrite(str(given.out), sheet, (cv2.IMWRITE_JPEG_QUALITY, 82))


if __name__ == "__main__":
    main()
