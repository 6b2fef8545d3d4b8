"""The picture of a failed attempt: its last frames, once for each way in which a cell fails, in the
report."""

import base64
from dataclasses import asdict

import cv2
import numpy as np
import pyarrow as pa
import pytest

from pipeline.data.dataset import Dataset
from pipeline.data.slots.records import ATTEMPTS
from pipeline.motion.planar import PlanarMotion
from pipeline.planning.failure import PlanFailure
from pipeline.report.page import write_report
from pipeline.report.summary import Group
from pipeline.run.names import recipe_from
from pipeline.run.slot.failures import FRAMES, WIDTH, keep_last_frames
from pipeline.stages.failure import Failure, failing_as
from pipeline.stages.scene import build_scene

RECIPE = recipe_from({"tasks": "click_bell", "embodiments": "aloha", "levels": 1, "episodes": 2})


@pytest.fixture(scope="module")
def blocked():
    """A plan that fails when the arms have stood still for a second, as the stages report it."""
    slot = next(RECIPE.slots())
    scene = build_scene(RECIPE.spec(slot, 0), RECIPE.ruling())
    actor = scene.start(PlanarMotion.still(scene.bodies["bell"].pose, 1.0), RECIPE.fps, "dry_run")
    with pytest.raises(Failure) as caught, failing_as("dry_run", actor):
        for _ in range(40):
            actor.advance(actor.simulation.command, np.zeros_like(actor.simulation.command))
        raise PlanFailure("grasp_blocked", "something is in the way")
    return caught.value


def test_the_last_frames_are_in_the_report_once(tmp_path, blocked):
    dataset = Dataset(tmp_path / "out")
    dataset.create(RECIPE)
    first, second = RECIPE.slots()
    keep_last_frames(dataset, RECIPE, first, 0, blocked)
    keep_last_frames(dataset, RECIPE, second, 0, blocked)
    (path,) = (dataset.root / "report").rglob("*.jpg")
    assert (
        path.relative_to(dataset.root).as_posix()
        == f"report/failed/{first.cell.path}/dry_run-grasp_blocked-0-0.jpg"
    )
    picture = cv2.imread(str(path))
    assert picture is not None and picture.shape == (192, FRAMES * WIDTH, 3)
    red = picture[..., 2].astype(int) - picture[..., 0]
    assert red.std() > 5  # a table under a sky, and no empty frame
    row = {
        "slot": 0,
        "attempt": 0,
        "seed": 1,
        "outcome": "failed",
        "stage": "dry_run",
        "reason": "grasp_blocked",
    }
    tried = pa.Table.from_pylist([asdict(first.cell) | row], ATTEMPTS)
    page = write_report(dataset.root, [Group(first.cell, (), tried)]).read_text()
    # the caption, and what is said for the image
    assert page.count("failed: dry run: grasp blocked (slot 0, attempt 0)") == 2
    assert base64.b64encode(path.read_bytes()).decode() in page


def test_a_failure_before_anything_moved_has_no_picture(tmp_path):
    dataset = Dataset(tmp_path / "out")
    dataset.create(RECIPE)
    keep_last_frames(
        dataset, RECIPE, next(RECIPE.slots()), 0, Failure("back_calculate", "no_motion")
    )
    assert not (dataset.root / "report").exists()
