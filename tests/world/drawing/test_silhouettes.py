"""Tracks without drawing against what the renderer draws: pixels of the segmentation, of all bodies
and of one alone."""

import numpy as np
import pytest

from pipeline.data.cameras import Camera, CameraType, look, project, world_poses
from pipeline.poses import compose, pose, quat_from_rpy, transform
from pipeline.world.drawing import silhouettes
from pipeline.world.drawing.engine import NEAR
from pipeline.world.drawing.renderer import Renderer
from pipeline.world.drawing.room import box, table_legs, table_top
from pipeline.world.drawing.silhouettes import occluders_of, track_bodies
from pipeline.world.looks.materials import plastic
from pipeline.world.looks.visuals import CLEAN

KIND = CameraType(96, 72, 45.0)
CAMERA = Camera("head", KIND, None, look((0.05, -0.5, 1.25), (0, 0.6, -0.62)))
HALF = np.array([0.06, 0.04, 0.05])
BODIES = {
    "block": [(box((0, 0, 0), HALF), plastic("teal"))],
    "wall": [(box((0, 0, 0), (0.05, 0.005, 0.1)), plastic("red"))],
}
FRAMES = 4
POSES = {
    # free, half behind the wall, half out of the image, held so near that a corner is cut off
    "block": np.stack(
        [
            pose((0.08, 0.05, 0.85), quat_from_rpy(0.3, -0.2, 0.7)),
            pose((0.0, 0.05, 0.80)),
            pose((0.46, 0.10, 0.80)),
            compose(CAMERA.pose, pose((0.095, 0.0, 0.01), quat_from_rpy(0.5, 0.3, 0.2))),
        ]
    ),
    "wall": np.stack(
        [pose((0.4, 0.4, 0.80)), pose((0.05, 0.0, 0.80)), *[pose((0.4, 0.4, 0.80))] * 2]
    ),
}


@pytest.fixture(scope="module")
def track():
    fixed = [*table_legs(), *table_top(CLEAN)]
    return track_bodies(
        occluders_of(BODIES, fixed), POSES, ["block"], KIND, world_poses(CAMERA, POSES, FRAMES)
    )


def pixels(bodies):
    with Renderer(bodies, [], [CAMERA], CLEAN) as renderer:
        (view,) = renderer.render(POSES, segmentation=True)
    assert view.segmentation is not None
    return view.segmentation == 1


def test_the_visible_share_is_that_of_the_segmentation(track, monkeypatch):
    seen, alone = pixels(BODIES).sum((1, 2)), pixels(BODIES | {"wall": []}).sum((1, 2))
    assert track.visible[0, 0] == 1.0 == seen[0] / alone[0]
    assert 0.2 < track.visible[1, 0] < 0.8
    assert track.visible[1, 0] == pytest.approx(seen[1] / alone[1], abs=2e-3)
    monkeypatch.setattr(silhouettes, "SAMPLES", 300)
    coarse = track_bodies(
        occluders_of(BODIES, []), POSES, ["block"], KIND, world_poses(CAMERA, POSES, FRAMES)
    )
    assert coarse.visible[1, 0] == pytest.approx(seen[1] / alone[1], abs=0.05)


def test_what_is_out_of_the_image_is_not_seen(track):
    """A camera that sees more, with pixels of the same size, counts the whole silhouette."""
    wide = CameraType(
        KIND.width * 3,
        KIND.height * 3,
        float(np.degrees(2 * np.arctan(3 * np.tan(np.radians(KIND.fovy) / 2)))),
    )
    with Renderer(BODIES, [], [Camera("wide", wide, None, CAMERA.pose)], CLEAN) as renderer:
        (view,) = renderer.render(POSES, [2, 3], segmentation=True)
    assert view.segmentation is not None
    for k, frame in enumerate((2, 3)):
        whole = view.segmentation[k] == 1
        inside = whole[KIND.height : 2 * KIND.height, KIND.width : 2 * KIND.width]
        assert 0.05 < inside.sum() / whole.sum() < 0.95
        assert track.visible[frame, 0] == pytest.approx(
            inside.sum() / whole.sum(), abs=0.02 if frame == 3 else 2e-3
        )


def test_boxes_and_centres_are_projections(track):
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * HALF
    for t in range(3):
        at = POSES["block"][t]
        uv, depth = project(KIND, CAMERA.pose, transform(at, corners))
        assert depth.min() > NEAR
        np.testing.assert_allclose(track.box[t, 0], [*uv.min(0), *uv.max(0)], atol=1e-3)
        np.testing.assert_allclose(
            track.centre[t, 0], project(KIND, CAMERA.pose, at[:3])[0], atol=1e-3
        )
        # the pose in the camera's frame puts the centre to the same pixel
        x, y, z = track.pose[t, 0, :3]
        f = KIND.height / 2 / np.tan(np.radians(KIND.fovy) / 2)
        np.testing.assert_allclose(
            [f * x / z + KIND.width / 2, f * y / z + KIND.height / 2], track.centre[t, 0], atol=1e-3
        )


def test_what_is_behind_the_camera_is_not_there():
    behind = {
        name: np.repeat(compose(CAMERA.pose, pose((-1.0, 0, 0)))[None], 1, 0) for name in BODIES
    }
    track = track_bodies(
        occluders_of(BODIES, []), behind, ["wall", "block"], KIND, world_poses(CAMERA, behind, 1)
    )
    assert not track.box.any() and not track.centre.any() and not track.visible.any()
