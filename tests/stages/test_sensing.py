"""Images as sensors take them: an open shutter collects light, and evaluations see what datasets
show."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.data.imperfections import Sensors
from pipeline.data.setup import Setup
from pipeline.data.spec import EpisodeSpec
from pipeline.evaluate.scenes.trial import Eyes
from pipeline.motion.planar import PlanarMotion
from pipeline.stages.drawing.render import appearance_of, body_poses, capture, renderer
from pipeline.stages.scene import build_scene

SIZE = {"size": (96, 72), "render": "raster-fast", "cameras": ("head", "left")}


@pytest.fixture(scope="module")
def filmed():
    """A scene, and its log while the target and the left arm move ever faster along a line."""
    scene = build_scene(EpisodeSpec("click_bell", "aloha-agilex", 1, 0.1, "clean", 0, 0))
    still = PlanarMotion.still(scene.bodies[scene.task.target].pose, 1.0)
    log = scene.start(still, 15, "test").recorder.log()
    log.poses = np.repeat(log.poses, 5, 0)
    log.times = np.arange(5) / 15
    for name in log.bodies:
        if name == scene.task.target or name.startswith("left_"):
            log.pose(name)[:, 0] += 0.04 * np.arange(5) ** 2
    return scene, log


def captured(filmed, **values):
    scene, log = filmed
    setup = Setup(**SIZE, **values)
    return capture(appearance_of(scene, setup), log, setup)


def test_motion_blur_is_the_mean_light_of_the_moments_of_the_shutter(filmed):
    scene, log = filmed
    blurred = captured(filmed, depth=True, sensors=Sensors(motion_blur=40))
    sharp = captured(filmed, depth=True)
    poses = body_poses(log)
    with renderer(appearance_of(scene, Setup(**SIZE))) as drawing:
        for k in (1, 4):
            # 40 ms are 0.6 of a frame at 15 Hz; between two frames these bodies keep to a line
            at = k - 0.6 * np.arange(8) / 8
            low = np.floor(at).astype(int)
            share = (at - low)[:, None]
            moments = {
                n: p[low] * (1 - share) + p[np.minimum(low + 1, 4)] * share
                for n, p in poses.items()
            }
            for drawn, view, plain in zip(
                drawing.render(moments), blurred.views, sharp.views, strict=True
            ):
                mean = 255 * np.sqrt(np.square(drawn.rgb / 255.0).mean(0))
                assert np.abs(mean - view.rgb[k]).max() <= 1.0
                assert np.abs(view.rgb[k].astype(int) - plain.rgb[k]).max() > 20
                assert np.array_equal(view.depth[k], plain.depth[k])
    assert all(
        np.array_equal(a.rgb[0], b.rgb[0]) for a, b in zip(blurred.views, sharp.views, strict=True)
    )


def test_an_evaluation_sees_what_a_dataset_shows(filmed):
    scene, log = filmed
    every = Sensors(noise=2, motion_blur=20, drift=0.1, depth_noise="d435", latency=1.5)
    setup = Setup(**SIZE, depth=True, sensors=every)
    stored, eyes = captured(filmed, depth=True, sensors=every), Eyes(scene, setup)
    for k in (0, 3):
        seen = eyes.look(
            SimpleNamespace(
                past=log.poses[: k + 1], simulation=SimpleNamespace(names=log.bodies, events=[])
            )
        )
        for view in stored.views:
            assert np.array_equal(seen.images[view.camera.name], view.rgb[k])
            assert np.array_equal(seen.depth[view.camera.name], view.depth[k])
    eyes.close()
    plain = captured(filmed)
    assert all(
        (a.rgb != b.rgb).mean() > 0.5 for a, b in zip(stored.views, plain.views, strict=True)
    )
