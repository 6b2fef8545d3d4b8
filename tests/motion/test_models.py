"""Models of motions by name: the paper's, and one from outside the package that goes the whole way
of an episode."""

import json

import numpy as np
import pytest

from pipeline.motion.contract import Level, MotionRequest, Streams, keeps_alpha, twist_fault
from pipeline.motion.models import MODELS, level_name, level_of, motion_from_json, register
from pipeline.motion.models.planar import Planar
from pipeline.motion.workspace import Workspace
from pipeline.poses import yawed
from tests.motion.sway import SwayModel

END = yawed((0.12, -0.08, 0.77), 0.4)


@pytest.fixture
def sway():
    register(SwayModel())
    yield MODELS["sway"]
    MODELS.remove("sway")


def asked(level: int, **options) -> MotionRequest:
    return MotionRequest(level, 0.1, 3.0, END, Workspace(-0.35, 0.35, -0.25, 0.15), **options)


@pytest.mark.parametrize("level", [1, 2, 3])
def test_a_motion_comes_back_from_json_with_its_model(level):
    for seed in range(5):
        drawn = MODELS["planar"].draw(
            asked(level), Streams(np.random.default_rng(seed), np.random.default_rng(seed))
        )
        again = motion_from_json(drawn.to_json())
        assert (again.model, again.level, again.to_json()) == ("planar", level, drawn.to_json())
        assert keeps_alpha(again, "average") and not twist_fault(again)


def test_a_twist_is_the_rate_of_the_pose(sway):
    drawn = sway.draw(
        asked(4, lead=0.5), Streams(np.random.default_rng(0), np.random.default_rng(0))
    )
    t, h = np.linspace(-0.4, 4, 23), 1e-6
    slope = (drawn.pose(t + h)[:, :3] - drawn.pose(t - h)[:, :3]) / (2 * h)
    np.testing.assert_allclose(drawn.twist(t)[:, :3], slope, atol=1e-8)
    np.testing.assert_allclose(drawn.pose(3.0), END, atol=1e-12)


def test_a_motion_that_is_too_fast_does_not_keep_alpha():
    drawn = MODELS["planar"].draw(
        asked(1), Streams(np.random.default_rng(0), np.random.default_rng(0))
    )
    values = json.loads(drawn.to_json()) | {"alpha": 0.01}
    assert not keeps_alpha(motion_from_json(json.dumps(values)), "average")


def test_a_model_is_registered_once_and_does_not_describe_level_0():
    with pytest.raises(ValueError, match="registered twice"):
        register(Planar())
    broken = SwayModel()
    broken.levels = {0: Level("stands", "#000000")}
    with pytest.raises(ValueError, match="level 0"):
        register(broken)


def test_a_level_that_is_not_installed_is_still_described():
    assert level_of("nowhere", 7).text == "level 7 of nowhere"
    assert [level_name("planar", 2), level_name("sway", 0), level_name("sway", 4)] == [
        "level 2",
        "level 0",
        "sway level 4",
    ]


def test_a_motion_of_an_unknown_model_is_refused():
    with pytest.raises(ValueError, match="needs the motion 'sway', which is not installed"):
        motion_from_json('{"model": "sway"}')
