"""Failed attempts: files below failures/, and pictures for the report."""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from pipeline.data.atomic import remove, write_atomic
from pipeline.data.dataset import Dataset
from pipeline.data.episode.meta import FailureInfo
from pipeline.data.keys import SlotKeys
from pipeline.data.recipe.model import Recipe, Slot
from pipeline.data.setup import Setup
from pipeline.data.store.place import place_of
from pipeline.motion.planar import PlanarMotion
from pipeline.report.film_strip import encode
from pipeline.report.page import failed_folder
from pipeline.stages.attempt import Rollout
from pipeline.stages.drawing.render import appearance_of, render
from pipeline.stages.dry_run import DRY_RUN
from pipeline.stages.failure import Failure
from pipeline.stages.replay import REACT, REPLAY, Demonstrator, Replay
from pipeline.stages.scene import build_scene

from .make import draw, episode_of, write

KEPT = {"none": (), "rendered": (REPLAY, REACT), "all": (DRY_RUN, REPLAY, REACT)}
"""Stages whose failures are kept, by the recipe's keep_failures; the others record nothing."""


@dataclass(frozen=True)
class Failed:
    """A failed attempt: number, reason, keys, demonstrator."""

    slot: Slot
    number: int
    failure: Failure
    keys: SlotKeys
    demonstrator: Demonstrator


def keep_failure(dataset: Dataset, recipe: Recipe, failed: Failed) -> str:
    """Draw and write a failure that the recipe keeps; its sha256, else ""."""
    failure, log = failed.failure, failed.failure.log
    if failure.stage not in KEPT[recipe.keep_failures] or log is None:
        return ""
    scene = build_scene(recipe.spec(failed.slot, failed.number), recipe.ruling())
    motion, meeting = failure.motion, failure.meeting
    if motion is None:
        touched = log.time_of("meeting")
        meeting = float(log.times[-1]) if touched is None else touched
        pose = scene.bodies[scene.task.target].pose
        motion = PlanarMotion.still(pose, max(meeting, 1 / recipe.fps))
    scene = scene.furnished(motion)
    images = draw(dataset, scene, log, recipe)
    replay = Replay(log, failure.steps)
    rollout = Rollout(scene, motion, meeting, replay, failure.steps, failed.demonstrator)
    episode = episode_of(rollout, recipe, images.drawing, failed.keys)
    why = FailureInfo(
        attempt=failed.number,
        stage=failure.stage,
        reason=failure.reason,
        detail=failure.detail,
        conditions=failure.conditions,
    )
    flagged = replace(episode, meta=episode.meta.model_copy(update={"failure": why}))
    return write(dataset.failure(failed.slot, failed.number), flagged, images)[0]


def remove_failures(dataset: Dataset, slot: Slot) -> None:
    """Remove the stored failed attempts of a slot, before it is made again."""
    first = dataset.failure(slot, 0)
    pattern = f"{first.stem.removesuffix('000')}*.hdf5"
    for path in first.parent.glob(pattern):
        remove(path)
    if place := place_of(first):
        place.delete(p for p in place.files() if p.parent == first.parent and p.match(pattern))


FRAMES, APART = 3, 0.5  # frames of a picture, and seconds between them
WIDTH = 256  # pixels of a frame


def keep_last_frames(
    dataset: Dataset, recipe: Recipe, slot: Slot, number: int, failure: Failure
) -> None:
    """Write the last head camera frames of an attempt, unless nothing moved or the cell has this
    failure. Raises OSError.
    """
    folder, log = failed_folder(dataset.root, slot.cell.path), failure.log
    name = f"{failure.stage}-{failure.reason}"
    if log is None or any(folder.glob(f"{name}-*.jpg")):
        return
    scene = build_scene(recipe.spec(slot, number), recipe.ruling())
    if failure.motion is not None:
        scene = scene.furnished(failure.motion)
    setup = Setup(camera=recipe.camera, cameras=("head",), render="raster-fast")
    step = round(APART * recipe.fps)
    chosen = [max(0, len(log) - 1 - step * back) for back in reversed(range(FRAMES))]
    (view,) = render(appearance_of(scene, setup), log, frames=chosen)
    size = (WIDTH, WIDTH * view.rgb.shape[1] // view.rgb.shape[2])
    frames = [cv2.resize(frame, size, interpolation=cv2.INTER_AREA) for frame in view.rgb]
    picture = encode(np.hstack(frames).astype(np.uint8), quality=80)
    write_atomic(folder / f"{name}-{slot.index}-{number}.jpg", picture)
