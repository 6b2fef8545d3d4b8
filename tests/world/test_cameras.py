"""Which cameras a recipe gets, and what the observer sees."""

import numpy as np
import pytest

from benchmarks.filming import framed
from pipeline.data.cameras import CAMERA_TYPES, CameraType, extrinsics_cv, project, visible
from pipeline.data.episode.meta import NamedCamera
from pipeline.data.setup import Setup
from pipeline.world.cameras import CameraError, cameras_of, check_links, observer, wanted_cameras
from pipeline.world.physics.body import TABLE_HALF, TABLE_TOP
from pipeline.world.robots import MODELS, get_embodiment
from pipeline.world.robots.contract import arm_poses

D435 = CAMERA_TYPES["D435"]


@pytest.mark.parametrize("robot", sorted(MODELS))
def test_the_observer_sees_the_table_and_the_hands_across_it(robot):
    camera, embodiment = observer(D435), get_embodiment(robot)
    corners = [
        (sx * TABLE_HALF[0], sy * TABLE_HALF[1], TABLE_TOP) for sx in (-1, 1) for sy in (-1, 1)
    ]
    hands = [arm_poses(arm, arm.home)[arm.hand][:3] for arm in embodiment.arms.values()]
    assert visible(camera.type, camera.pose, np.array([*corners, *hands])).all()
    # it looks towards the robot, upright: the robot's right is on its left
    down, right = extrinsics_cv(camera.pose)[1, :3], extrinsics_cv(camera.pose)[0, :3]
    assert down[2] < 0 and right[0] < 0
    assert (camera.type.width, camera.type.height) == (D435.width, D435.height)


def test_cameras_come_in_the_order_of_the_recipe():
    mounted = cameras_of(get_embodiment("aloha"))
    top = NamedCamera(name="top", pose=(0, 0, 2, 1, 0, 0, 0), width=64, height=48, fovy=40)
    cameras = wanted_cameras(mounted, Setup(cameras=("left", top, "observer", "head")))
    assert [c.name for c in cameras] == ["left_camera", "top", "observer_camera", "head_camera"]
    assert cameras[0] is mounted[1]
    small = wanted_cameras(mounted, Setup(cameras=("left", top), size=(32, 24)))
    assert [(c.type.width, c.type.height, c.type.fovy) for c in small] == [
        (32, 24, D435.fovy),
        (32, 24, 40),
    ]
    assert wanted_cameras(mounted, Setup()) == mounted


def test_cameras_that_cannot_be_had_are_named():
    mounted = cameras_of(get_embodiment("aloha"))
    with pytest.raises(
        CameraError,
        match="no camera right to draw from: there are head_camera, left_camera, observer_camera",
    ):
        wanted_cameras(mounted[:2], Setup(cameras=("head", "right")))
    with pytest.raises(CameraError, match="left_camera is on 'left_link6'"):
        check_links(mounted, ("bell", "right_link6"))
    check_links(mounted[:1], ())


def test_a_framing_camera_touches_what_it_frames_on_two_sides_and_stays_upright():
    rng = np.random.default_rng(3)
    for kind in (D435, CameraType(90, 200, 50.0)):
        points = rng.uniform((-0.6, -0.5, 0.7), (0.6, 0.4, 1.4), (40, 3))
        pose = framed(points, (-0.4, -0.7, -0.5), kind, margin=0.1)
        pixels, depth = project(kind, pose, points)
        free = np.concatenate([pixels, (kind.width, kind.height) - pixels], 1) / (
            kind.width,
            kind.height,
            kind.width,
            kind.height,
        )
        assert (depth > 0).all() and free.min() == pytest.approx(0.1)
        # nearer is impossible: opposite borders are reached, along one axis at least
        reached = np.isclose(free.min(0), 0.1)
        assert reached[[0, 2]].all() or reached[[1, 3]].all()
        level = extrinsics_cv(pose)[0, :3]
        assert abs(level[2]) < 1e-12
