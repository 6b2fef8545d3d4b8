"""Corrections: a policy acts, the expert labels every frame, takes over at a drawn moment and
finishes."""

import numpy as np
import pytest

from pipeline.data.errors import DominoError
from pipeline.data.recipe.model import Recipe
from pipeline.data.setup.rules import Corrections
from pipeline.data.spec import EpisodeSpec
from pipeline.evaluate.correct import ASTRAY, HELD, PUSHED, Correction
from pipeline.expert.reactive.actor import ReactiveActor
from pipeline.expert.reactive.advice import Adviser
from pipeline.motion.planar import PlanarMotion, Segment
from pipeline.poses import quat_rotate
from pipeline.run.names import named_policy
from pipeline.stages.dry_run import DryRun
from pipeline.stages.failure import Failure
from pipeline.stages.replay import Replay
from pipeline.stages.scene import Scene, build_scene

MEETING = 3.0


@pytest.fixture(scope="module")
def scene() -> Scene:
    return build_scene(EpisodeSpec("click_bell", "aloha-agilex", 1, 0.1, "clean", 0, 1))


def along_y(scene: Scene, speed: float) -> PlanarMotion:
    """At `speed` (m/s), through the manipulation pose at MEETING."""
    x, y, z = scene.bodies["bell"].pose[:3]
    piece = Segment(0.0, 6.0, np.array([[x, 0.0], [y - speed * MEETING, 6.0 * speed]]))
    return PlanarMotion(1, 0.1, 6.0, 0.0, float(z), scene.bodies["bell"].pose[3:], (piece,))


@pytest.fixture(scope="module")
def motion(scene) -> PlanarMotion:
    return along_y(scene, 0.02)


def correcting(policy: str, **keys: object) -> Correction:
    return Correction(
        Recipe.model_validate({"corrections": {"policy": policy, "label": policy}} | keys)
    )


def show(correction: Correction, scene: Scene, motion: PlanarMotion, meeting: float) -> Replay:
    """As after a dry run that met the target then (s)."""
    still = np.zeros((0, 0))
    return correction.show(scene, DryRun(still, still, meeting, {}, still, (), 0, None), motion, 15)


def test_the_policy_acts_until_a_drawn_time_and_the_expert_then(scene, motion):
    done = show(correcting("static"), scene, motion, MEETING)
    log = done.log
    assert log.intervention is not None and log.expert_action is not None
    first = int(np.argmax(log.intervention))
    drawn = scene.spec.rng("takeover").uniform(0.0, MEETING)
    assert (
        first == np.ceil(drawn * 15)
        and log.intervention[first:].all()
        and not log.intervention[:first].any()
    )
    assert np.array_equal(log.expert_action[first:], log.action[first:])
    assert not np.array_equal(log.expert_action[:first], log.action[:first])
    assert scene.succeeded(log)
    again = show(correcting("static"), scene, motion, MEETING).log
    assert np.array_equal(again.action, log.action) and np.array_equal(
        np.array(again.expert_action), log.expert_action
    )


@pytest.mark.parametrize("perturb", ["pause", "push"])
def test_a_robot_is_perturbed_before_the_expert_recovers(perturb):
    """The perturbation lasts as long as it was drawn, is not the expert's, and follows the policy's
    part."""
    scene = build_scene(EpisodeSpec("click_bell", "aloha-agilex", 1, 0.1, "clean", 0, 2))
    log = show(correcting("static", perturb=perturb), scene, along_y(scene, 0.02), MEETING).log
    assert log.intervention is not None
    first, taken = (
        int(np.argmax(log.intervention)),
        int(np.ceil(scene.spec.rng("takeover").uniform(0.0, MEETING) * 15)),
    )
    rng = scene.spec.rng("perturb")
    assert first - taken == round(rng.uniform(*HELD) * 15) and log.intervention[first:].all()
    moved = log.action[first - 1] - log.action[taken - 1]
    wanted = PUSHED * rng.normal(size=14) * (np.arange(14) % 7 != 6) * (perturb == "push")
    assert moved == pytest.approx(wanted, abs=1e-9)
    assert scene.succeeded(log)


def test_an_expert_that_waits_for_an_error_takes_over_where_the_hand_is_astray(scene):
    """The policy goes where the bell was at the start, the expert's path follows the bell."""
    motion = along_y(scene, 0.04)
    log = show(correcting("static", takeover="error"), scene, motion, MEETING).log
    assert log.intervention is not None
    first = int(np.argmax(log.intervention))
    moved = motion.pose(log.times)[:, 1] - motion.pose(0.0)[1]
    # the hand is as far off as the bell has moved at most
    assert 0 < first < 2 * MEETING * 15 and moved[first] > ASTRAY[0]
    assert np.abs(np.array(log.expert_action) - log.action)[:first].max() > 0.02


def test_advice_leads_to_the_moving_target(scene, motion):
    """A robot that follows the labels alone rings the bell."""
    actor = scene.start(motion, 15, "advice", ReactiveActor)
    actor.attend(Recipe().sight, scene.task, scene.spec.rng("sight"))
    actor.wait(1 / 15)
    adviser = Adviser(actor, scene.task.meet, 15)
    for _ in range(90):
        before, label = actor.simulation.command, adviser.action()
        for share in np.linspace(0, 1, 17)[1:]:
            actor.advance(before + share * (label - before), (label - before) * 15)
        if actor.simulation.touched_by:
            break
    bell = actor.pose("bell")
    button = bell[:3] + quat_rotate(
        bell[3:], scene.bodies["bell"].instance.frames().points["button"][:3]
    )
    tool = actor.simulation.tcp(scene.arms["arm"])[:3]
    assert actor.simulation.touched_by and np.linalg.norm((tool - button)[:2]) < 0.02


BROKEN = """
class Broken:
    def reset(self, start): ...
    def act(self, observation): return [float("nan")]

make_policy = Broken
"""

LEAVING = """
import os
class Policy:
    def reset(self, start):
        pass
    def act(self, observation):
        os._exit(0)
def make_policy():
    return Policy()
"""


@pytest.mark.parametrize(
    ("code", "said"), [(BROKEN, r"shape|finite"), (LEAVING, r"ended with code 0")]
)
def test_a_policy_without_an_answer_is_a_failure_with_a_reason(scene, motion, tmp_path, code, said):
    path = tmp_path / "broken.py"
    path.write_text(code)
    corrections = named_policy(Corrections(policy=str(path)))
    recipe = Recipe(corrections=corrections, cameras=("head",), size=(32, 24), render="raster-fast")
    with pytest.raises(Failure, match=said) as raised:
        show(Correction(recipe), scene, motion, MEETING)
    assert raised.value.reason == "policy_failed"


def test_a_target_that_the_policy_touches_first_is_a_failure_with_a_reason(scene, motion):
    # the drawn time lies far behind the touch
    with pytest.raises(Failure) as raised:
        show(correcting("chaser"), scene, motion, 60.0)
    assert raised.value.reason == "takeover_late"


def test_another_policy_under_the_same_name_is_refused(scene, motion):
    recipe = Recipe(corrections=Corrections(policy="static", label="static@1"))
    with pytest.raises(DominoError, match="is static, not static@1 any more"):
        show(Correction(recipe), scene, motion, MEETING)
