"""The frozen description of a scene, and arm planners in it."""

from dataclasses import FrozenInstanceError

import numpy as np
import pytest

from pipeline.data.names import SIDES
from pipeline.planning.collision import ArmState, Carried, Obstacle, PlanningScene
from pipeline.planning.failure import PlanFailure
from pipeline.planning.planner import ArmPlanner, Planner
from pipeline.poses import IDENTITY, Pose, compose, pose, quat_about
from pipeline.world.robots.contract import Embodiment
from pipeline.world.shapes import Collider
from tests.planning.arms import six_arm

LEFT = six_arm()
RIGHT = six_arm(pose((0.3, -0.42, 0.78), quat_about((0, 0, 1), np.pi / 2)))
PLANNER = Planner(Embodiment("two-six", {"left": LEFT, "right": RIGHT}, IDENTITY))
HOME = np.array(LEFT.home)
CUBE = (Collider("box", (0.02, 0.02, 0.02)),)
ROD = (Collider("box", (0.06, 0.005, 0.005)),)


def scene(
    obstacles: dict[str, Obstacle] | None = None, carried: dict[str, Carried] | None = None
) -> PlanningScene:
    """Both arms at home with closed jaws."""
    return PlanningScene(
        {side: ArmState(HOME.copy(), 0.0, HOME.copy()) for side in SIDES},
        obstacles or {},
        carried or {},
    )


def arm(in_scene: PlanningScene) -> ArmPlanner:
    return ArmPlanner(PLANNER, "left", in_scene, np.random.default_rng(0))


def before_the_tcp(distance: float) -> Pose:
    return compose(PLANNER.fk("left", HOME), pose((distance, 0, 0)))


def test_a_scene_cannot_be_changed() -> None:
    obstacles = {"cube": Obstacle(CUBE, IDENTITY)}
    still = scene(obstacles)
    with pytest.raises(FrozenInstanceError):
        still.obstacles = {}  # type: ignore[misc]
    with pytest.raises(TypeError):
        still.obstacles["ball"] = Obstacle(CUBE, IDENTITY)  # type: ignore[index]
    with pytest.raises(TypeError):
        del still.arms["left"]  # type: ignore[attr-defined]
    with pytest.raises(FrozenInstanceError):
        still.arms["left"].gripper = 1.0  # type: ignore[misc]
    del obstacles["cube"]
    assert list(still.obstacles) == ["cube"]


def test_a_body_in_the_hand_is_no_obstacle_any_more() -> None:
    before = scene({"cube": Obstacle(CUBE, IDENTITY), "ball": Obstacle(CUBE, IDENTITY)})
    after = before.holding("cube", Carried("left", CUBE, IDENTITY))
    assert list(after.obstacles) == ["ball"] and after.carried["cube"].side == "left"
    assert list(before.obstacles) == ["cube", "ball"] and not before.carried
    handed_over = after.holding("cube", Carried("right", CUBE, IDENTITY))
    assert handed_over.carried["cube"].side == "right" and len(handed_over.carried) == 1


def test_a_checker_sees_obstacles_and_what_is_carried() -> None:
    wall = {"wall": Obstacle(CUBE, before_the_tcp(0.12))}
    assert arm(scene()).checker()(HOME)
    assert arm(scene(wall)).checker()(HOME)
    held = {"rod": Carried("left", ROD, pose((0.05, 0, 0)))}
    assert arm(scene({}, held)).checker()(HOME)
    assert not arm(scene(wall, held)).checker()(HOME)
    assert arm(scene(wall, held)).checker([("rod", "wall")])(HOME)


def test_a_checker_keeps_its_margin_and_takes_other_jaws() -> None:
    # the closed fingers end 29.6 mm before the tcp: 0.0846 + 0.035 + 0.03 - 0.12
    gap = arm(scene({"wall": Obstacle(CUBE, before_the_tcp(0.0296 + 0.02 + 0.001))}))
    assert gap.checker(margin=0.0)(HOME) and not gap.checker()(HOME)
    pin = Obstacle(
        (Collider("box", (0.01, 0.005, 0.01)),), compose(before_the_tcp(-0.01), pose((0, 0.065, 0)))
    )
    beside = arm(scene({"pin": pin}))
    assert beside.checker()(HOME) and not beside.checker(jaws=1.0)(HOME)


def test_a_checker_avoids_the_other_arm_where_it_is_expected() -> None:
    meet = pose((0.0, -0.1, 0.95), quat_about((0, 0, 1), np.pi / 2))
    there = {
        side: ArmPlanner(PLANNER, side, scene(), np.random.default_rng(0)).solve(meet[None])
        for side in SIDES
    }
    assert all(ok[0] for _, ok in there.values())
    left, right = (there[side][0][0] for side in SIDES)
    apart = arm(scene())
    assert apart.checker()(left)
    assert not apart.within(apart.scene.expecting("right", right)).checker()(left)
    assert apart.checker()(left), "the scene that was asked about first is as it was"


def test_motions_start_at_the_command_and_keep_the_gripper() -> None:
    start = arm(scene())
    goal = compose(before_the_tcp(0.0), pose((0.05, 0, 0)))
    path = start.line(start.q, goal)
    assert path is not None
    line = start.timed(path, minimum=1.0)
    np.testing.assert_allclose(start.fk(line.q[-1])[:3], goal[:3], atol=1e-4)
    assert (
        len(line.q) >= 240 and (line.gripper == 0.0).all() and line.gripper.shape == (len(line.q),)
    )
    assert np.abs(line.q[0] - HOME).max() < 1e-3
    near = HOME + 0.1
    free = start.free_trajectory(near, start.checker())
    np.testing.assert_array_equal(free.q[-1], near)
    slow = start.free_trajectory(near, start.checker(), speed_scale=0.25)
    # a trapezoid: 0.1 rad at a quarter of 1.4 rad/s with 6 rad/s2
    assert len(slow.q) == np.ceil(240 * (0.1 / 0.35 + 0.35 / 6)) > len(free.q)


def test_what_cannot_be_reached_is_a_failure_with_its_reason() -> None:
    start = arm(scene())
    assert start.line(start.q, pose((0, 3.0, 1.0))) is None
    with pytest.raises(PlanFailure, match="path_blocked: the left arm"):
        start.free_trajectory(HOME + 0.1, lambda q: False)
