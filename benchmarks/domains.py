"""The two domains side by side: `python -m benchmarks.domains --out docs/domains.jpg`.

One frame, at the meeting, of an accepted episode of every task, clean on the left and randomized on
the right; the tasks take the robots in turn. The cells are paired by domain: both try the same
layouts and objects. Level 1, head camera. Prints how many pairs show the same scene.
"""

import argparse
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import cycle
from multiprocessing import get_context
from operator import eq
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from pipeline.data.names import HEAD
from pipeline.data.recipe.model import Recipe, Slot
from pipeline.data.spec import DOMAINS
from pipeline.report.film_strip import encode
from pipeline.stages.attempt import attempt
from pipeline.stages.drawing.render import appearance_of, render
from pipeline.stages.failure import Failure
from pipeline.world.robots import MODELS

TASKS = (
    *("click_bell", "place_shoe", "shake_bottle", "beat_block_hammer", "grab_roller"),
    *(
        "place_container_plate",
        "handover_block",
        "move_can_pot",
        "put_object_cabinet",
        "place_bread_basket",
    ),
)
SIZE = (240, 180)
"""Width and height (pixels) of a frame."""

GAP, LABEL, ACROSS = 6, 20, 2


def shot(job: tuple[Recipe, Slot]) -> tuple[int, NDArray[np.uint8]]:
    """The number of the accepted attempt at a slot and its frame (H,W,3) at the meeting."""
    recipe, slot = job
    for number in range(recipe.attempts):
        try:
            rollout = attempt(recipe.spec(slot, number), recipe)
        except Failure:
            continue
        appearance = replace(appearance_of(rollout.scene, recipe).seen_by(HEAD), preset="raster")
        frame = min(round(rollout.meeting * recipe.fps), len(rollout.replay.log) - 1)
        (view,) = render(appearance, rollout.replay.log, frames=[frame])
        return number, cv2.resize(view.rgb[0], SIZE, interpolation=cv2.INTER_AREA).astype(np.uint8)
    raise RuntimeError(f"{slot.path} was given up")


def sheet(
    pairs: dict[tuple[str, str], tuple[NDArray[np.uint8], NDArray[np.uint8]]],
) -> NDArray[np.uint8]:
    """The image (H,W,3): two frames for each task and robot, their names above, ACROSS pairs in a
    row."""
    width, height = 2 * SIZE[0] + GAP, SIZE[1] + LABEL
    page = np.full((height * -(-len(pairs) // ACROSS), width * ACROSS, 3), 255, np.uint8)
    for i, ((task, robot), frames) in enumerate(pairs.items()):
        x, y = i % ACROSS * width, i // ACROSS * height
        said = f"{task.replace('_', ' ')}, {robot}: clean, randomized"
        cv2.putText(
            page,
            said,
            (x + 2, y + 14),
            cv2.FONT_HERSHEY_SIMPLEX,
            0.42,
            (30, 30, 30),
            1,
            cv2.LINE_AA,
        )
        page[y + LABEL : y + height, x : x + 2 * SIZE[0]] = np.hstack(frames)
    return page


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--tasks", default=",".join(TASKS))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--out", type=Path, required=True)
    args = parser.parse_args()
    jobs = list[tuple[Recipe, Slot]]()
    for task, robot in zip(args.tasks.split(","), cycle(MODELS), strict=False):
        cells = {"tasks": [task], "embodiments": [robot], "levels": [1], "domains": list(DOMAINS)}
        recipe = Recipe.model_validate(
            {**cells, "seed": args.seed, "episodes": 1, "paired": ["domains"], "size": [640, 480]}
        )
        jobs += [(recipe, slot) for slot in recipe.slots()]
    with ProcessPoolExecutor(args.workers, mp_context=get_context("spawn")) as pool:
        made = list(tqdm(pool.map(shot, jobs), total=len(jobs), unit="frame"))
    numbers, frames = zip(*made, strict=True)
    names = [(slot.cell.task, slot.cell.embodiment) for _, slot in jobs[::2]]
    print(f"{sum(map(eq, numbers[::2], numbers[1::2]))} of {len(names)} pairs show the same scene")
    args.out.write_bytes(
        encode(
            sheet(dict(zip(names, zip(frames[::2], frames[1::2], strict=True), strict=True))),
            quality=85,
        )
    )


if __name__ == "__main__":
    main()
