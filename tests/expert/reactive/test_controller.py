"""What a round target leaves free."""

import numpy as np
import pytest

from pipeline.expert.reactive.controller import turned_like
from pipeline.poses import angle_between, pose, quat_about, quat_multiply, quat_rotate
from pipeline.world.objects import FAMILIES

UP = (0.0, 0.0, 1.0)


def test_a_round_body_is_turned_about_its_own_axis_alone():
    tilt = quat_about((1.0, 0.0, 0.0), 0.4)
    aim = pose((0.1, 0.2, 0.3), tilt)
    spun = pose((0.5, 0.0, 0.3), quat_multiply(tilt, quat_about(UP, 2.5)))
    same = turned_like(spun, aim)
    assert same[:3] == pytest.approx(spun[:3])
    assert angle_between(same[3:], tilt) < 1e-6
    tipped = pose((0.1, 0.2, 0.3), quat_multiply(quat_about((0.0, 1.0, 0.0), 0.3), spun[3:]))
    same = turned_like(tipped, aim)
    assert quat_rotate(same[3:], UP) == pytest.approx(quat_rotate(tipped[3:], UP))
    others = [quat_multiply(tipped[3:], quat_about(UP, a)) for a in np.linspace(0, 6.28, 200)]
    assert angle_between(same[3:], tilt) <= min(angle_between(q, tilt) for q in others) + 1e-9


@pytest.mark.parametrize(
    ("name", "is_round"),
    [("can", True), ("shell_cup", True), ("bell", True), ("block", False), ("mug", False)],
)
def test_bodies_with_one_outline_from_all_sides_are_round(name, is_round):
    for seed in range(4):
        body = FAMILIES[name].draw(np.random.default_rng(seed))
        assert body.shape().is_round == is_round
