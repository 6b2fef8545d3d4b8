"""Robots at the places of the original system, against its configuration."""

import numpy as np
import pytest

from pipeline.data.names import SIDES
from pipeline.data.setup.rules import Rules
from pipeline.data.spec import EpisodeSpec
from pipeline.stages.scene import build_scene
from pipeline.world.robots import MODELS, get_embodiment

PLACES = {
    **{"piper": (0.3, -0.45, 0.75), "ur5-wsg": (0.4, -0.65, 0.75)},
    **{"franka-panda": (0.4, -0.65, 0.75), "arx-x5": (0.3, -0.35, 0.784)},
}
"""The right base (m) in RoboTwin 2.0; the left one mirrors it."""


@pytest.mark.parametrize("name", PLACES)
def test_bases_stand_where_the_original_has_them_and_are_turned_as_ours(name):
    ours, theirs = get_embodiment(name), get_embodiment(name, "original")
    x, y, z = PLACES[name]
    for side, sign in zip(SIDES, (-1, 1), strict=True):
        np.testing.assert_allclose(theirs.arms[side].base[:3], (sign * x, y, z))
        np.testing.assert_array_equal(theirs.arms[side].base[3:], ours.arms[side].base[3:])
        assert theirs.arms[side].links == ours.arms[side].links


@pytest.mark.parametrize("name", ["piper", "ur5-wsg", "franka-panda"])
def test_a_stand_is_under_each_moved_base(name):
    for layout in ("ours", "original"):
        robot = get_embodiment(name, layout)
        for side in SIDES:
            base = robot.arms[side].base
            below = [
                c for c in robot.furniture_collision if np.abs(c.pose[:2] - base[:2]).max() < 0.15
            ]
            tops = [float(c.support_points()[:, 2].max()) for c in below]
            assert max(tops) == pytest.approx(base[2] - 0.003, abs=1e-6), (layout, side)


def test_robots_that_stand_where_the_originals_do_are_the_same():
    same = {
        name
        for name in MODELS
        if get_embodiment(name) == get_embodiment(name, "original") or _same_bases(name)
    }
    assert same == {"aloha-agilex", "arx-x5"}


def _same_bases(name: str) -> bool:
    ours, theirs = get_embodiment(name), get_embodiment(name, "original")
    return all(np.array_equal(ours.arms[side].base, theirs.arms[side].base) for side in SIDES)


def test_a_scene_has_the_robot_of_its_rules():
    spec = EpisodeSpec("click_bell", "piper", 0, 0.1, "clean", 0, 0)
    assert build_scene(spec).embodiment.arms["left"].base[2] == pytest.approx(0.85)
    assert build_scene(spec, Rules(layout="original")).embodiment.arms["left"].base[
        2
    ] == pytest.approx(0.75)
