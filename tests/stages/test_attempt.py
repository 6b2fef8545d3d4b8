"""An attempt grasps the target from another side before it gives the drawn motion up."""

import gc
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest

from pipeline.data.recipe.model import Recipe
from pipeline.data.spec import EpisodeSpec
from pipeline.motion.models.planar import NoMotion
from pipeline.stages import attempt as module
from pipeline.stages.attempt import attempt
from pipeline.stages.dry_run import FIRST, Variation, dry_run
from pipeline.stages.failure import Failure
from pipeline.stages.scene import Scene, build_scene
from pipeline.tasks.contract import Draw, Placement
from pipeline.tasks.library.domino.press.beat_block_hammer import BeatBlockHammer

BLOCKED = EpisodeSpec(
    "move_can_pot", "franka-panda", 1, 0.1, "clean", 9, 3077363216261643159, 2151966414097633330
)
"""A can in the corner of its workspace: the hand that comes in level stands where it would have to
come from."""

RECIPE = Recipe()


def test_another_grasp_lets_the_drawn_motion_in(monkeypatch):
    with monkeypatch.context() as one_grasp:
        one_grasp.setattr(module, "GRASPS", 1)
        with pytest.raises(Failure, match="no_motion") as refused:
            attempt(BLOCKED, RECIPE)
    done = attempt(BLOCKED, RECIPE)
    assert done.scene.succeeded(done.replay.log)
    drawn = refused.value.drawn
    assert drawn is not None and done.motion.features().average_speed == pytest.approx(
        drawn.average_speed
    )
    # both dry runs and the replay count
    assert done.steps > refused.value.steps + done.replay.steps


@pytest.mark.parametrize("grasps", [1, 3], ids=["given up", "solved by another grasp"])
def test_what_an_attempt_held_goes_without_garbage_collection(monkeypatch, grasps):
    monkeypatch.setattr(module, "GRASPS", grasps)
    gc.collect()
    # caches of other tests' modules may hold some
    before = alive()
    gc.disable()
    try:
        with suppress(Failure):
            attempt(BLOCKED, RECIPE)
        assert alive() <= before
    finally:
        gc.enable()


def alive() -> set[int]:
    """Ids of the failures and scenes that this process holds."""
    return {id(each) for each in gc.get_objects() if type(each) in (Failure, NoMotion, Scene)}


def test_an_avoided_approach_is_not_taken_again():
    scene = build_scene(BLOCKED)
    first = dry_run(scene, 15)
    assert first.approach is not None
    second = dry_run(scene, 15, Variation([first.approach]))
    assert second.approach is not None
    assert np.linalg.norm(second.approach) == pytest.approx(1.0)
    assert np.arccos(first.approach @ second.approach) > 0.7


CROSSING = EpisodeSpec(
    "beat_block_hammer", "aloha-agilex", 1, 0.1, "clean", 1, 1, 8409852660330008463
)
"""A block that has to come across the place of the hammer which is to strike it."""


LAYOUT = BeatBlockHammer.layout


def head_towards_the_robot(self: BeatBlockHammer, draw: Draw) -> Iterator[Placement]:
    """The task's layout with the hammer turned by half a turn: its head lies where blocks pass."""
    for each in LAYOUT(self, draw):
        yield (
            replace(each, region=replace(each.region, yaw=(-1.7, -1.4)))
            if each.name == "hammer"
            else each
        )


def test_a_robot_waits_until_what_it_takes_is_out_of_the_way(monkeypatch):
    monkeypatch.setattr(BeatBlockHammer, "layout", head_towards_the_robot)
    with monkeypatch.context() as at_once:
        at_once.setattr(module, "PAUSES", ())
        with pytest.raises(Failure, match="no_motion") as refused:
            attempt(CROSSING, RECIPE)
    done = attempt(CROSSING, RECIPE)
    assert done.scene.succeeded(done.replay.log)
    drawn = refused.value.drawn
    assert drawn is not None and done.motion.features().average_speed == pytest.approx(
        drawn.average_speed
    )


def test_a_pause_delays_the_meeting_and_nothing_else():
    scene = build_scene(CROSSING)
    first = dry_run(scene, 15)
    later = dry_run(scene, 15, Variation(pause=0.7, before=first.skills - 1))
    assert first.approach is None and first.skills == 3
    assert later.meeting - first.meeting == pytest.approx(0.7, abs=0.02)


def test_a_meeting_without_a_grasp_has_no_approach_to_avoid(monkeypatch):
    runs = []

    def refused(*_, **__):
        raise Failure("back_calculate", "no_motion")

    def counted(scene, fps, variation=FIRST):
        runs.append(variation.pause)
        return dry_run(scene, fps, variation)

    monkeypatch.setattr(module, "back_calculate", refused)
    monkeypatch.setattr(module, "dry_run", counted)
    with pytest.raises(Failure, match="no_motion"):
        attempt(EpisodeSpec("click_bell", "aloha-agilex", 1, 0.1, "clean", 0, 1), RECIPE)
    assert runs == [0.0, *module.PAUSES]
