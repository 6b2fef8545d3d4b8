"""What the physics of a built episode promises, checked against its stored arrays alone."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.data.cameras import world_poses
from pipeline.data.dataset import Dataset
from pipeline.data.episode.file import EpisodeFile
from pipeline.data.episode.state_log import physics_id
from pipeline.data.setup.rules import rules_of
from pipeline.data.slots.assets import AssetStore
from pipeline.motion.contract import keeps_alpha, twist_fault
from pipeline.motion.models import motion_from_json
from pipeline.motion.recorded import TRACKS, Interception, conditions_of, physics_arrays
from pipeline.poses import compose
from pipeline.run.slot.make import sentences
from pipeline.run.slot.redraw import cached_parts
from pipeline.stages.drawing.render import body_poses, stored_appearance
from pipeline.stages.drawing.tracks import track_arrays
from pipeline.stages.scene import build_scene
from pipeline.world.robots.contract import jaw_value, link_poses

# metres, and parts of a rotation, by which the simulator's poses may differ from those computed
CLOSE = 1e-3


@pytest.fixture(scope="module", params=[1, 2, 3])
def made(request, built):
    """An accepted episode of each level, its motion, and its scene built again."""
    dataset = Dataset(built)
    path = next(
        path for path in dataset.accepted(dataset.recipe()) if f"/L{request.param}/" in str(path)
    )
    with EpisodeFile(path) as file:
        episode = file.read()
        cameras = {name: file.array(f"observation/{name}/pose") for name in file.cameras}
    scene = build_scene(episode.spec, rules_of(episode.meta))
    motion = motion_from_json(episode.motion)
    return SimpleNamespace(
        e=episode, log=episode.log, motion=motion, scene=scene, cameras=cameras, dataset=dataset
    )


def same_poses(stored, computed):
    """A quaternion and its negative are one rotation."""
    turned = np.sign((stored[:, 3:] * computed[:, 3:]).sum(1, keepdims=True))
    np.testing.assert_allclose(stored[:, :3], computed[:, :3], atol=CLOSE)
    np.testing.assert_allclose(stored[:, 3:], turned * computed[:, 3:], atol=CLOSE)


def test_frames_and_events_are_on_one_clock(made):
    log, fps = made.log, made.e.meta.fps
    np.testing.assert_allclose(log.times, np.arange(len(log)) / fps, atol=1e-9)
    assert {"meeting", "success"} <= {event.name for event in log.events}
    assert all(0 <= event.time <= log.times[-1] + 1 / fps for event in log.events)
    last = round(float(log.times[-1]) * made.e.meta.physics_hz)
    assert log.skills and all(0 <= run.start < run.end <= last for run in log.skills)


def test_the_target_is_on_its_motion_until_it_is_released(made):
    meta, log = made.e.meta, made.log
    freed = log.time_of("meeting" if meta.contact == "hold" else "release")
    before = log.times < (np.inf if freed is None else freed)
    gap = np.linalg.norm(
        log.pose(meta.target)[before, :3] - made.motion.pose(log.times[before])[:, :3], axis=1
    )
    assert gap.max() < 1e-3


def test_the_motion_is_of_its_level_and_no_faster_than_alpha(made):
    motion, spec, meta = made.motion, made.e.spec, made.e.meta
    assert (motion.level, motion.alpha) == (spec.level, spec.alpha)
    assert keeps_alpha(motion, "average") and not twist_fault(motion)
    found = motion.features()
    assert (meta.average_speed, meta.maximum_speed) == pytest.approx(
        (found.average_speed, found.maximum_speed), abs=1e-6
    )


def test_robot_and_target_meet_at_the_planned_time_and_place(made):
    meta, log, motion = made.e.meta, made.log, made.motion
    end = made.scene.bodies[meta.target].pose[:3]
    assert np.linalg.norm(motion.pose(meta.meeting_time)[:3] - end) < 1e-4
    real = log.time_of("meeting")
    assert (
        abs(real - meta.meeting_time) < 0.1 and np.linalg.norm(motion.pose(real)[:3] - end) < 0.01
    )
    met, sides = log.event("meeting"), {touch.side: touch for touch in log.touches}
    (touch,) = [touch for side, touch in sides.items() if met.by.startswith(f"{side}_")]
    assert touch.step == round(met.time * meta.physics_hz)


def test_success_holds_in_the_scene_built_again(made):
    assert made.scene.succeeded(made.log)
    conditions = conditions_of(made.e.interception)
    assert conditions and all(
        len(holds) == len(made.log) and holds[-1] for holds in conditions.values()
    )


def test_the_group_interception_follows_from_the_state_log(made):
    derived = Interception(made.e.meta, made.log, made.motion)
    for key, wanted in physics_arrays(derived, conditions_of(made.e.interception)).items():
        assert np.array_equal(made.e.interception[key], wanted), key
    assert made.e.meta.physics_id == physics_id(made.e.spec, made.log)


def test_joints_place_the_links_and_hands_the_tools(made):
    log = made.log
    columns = {name: log.qpos[:, number] for number, name in enumerate(log.joints)}
    for number, (side, arm) in enumerate(made.scene.embodiment.arms.items()):
        own = {
            name.removeprefix(f"{side}_"): values
            for name, values in columns.items()
            if name.startswith(f"{side}_")
        }
        placed = {f"{side}_{link}": pose for link, pose in link_poses(arm, own).items()}
        assert set(placed) & set(log.bodies)
        for body in set(placed) & set(log.bodies):
            same_poses(log.pose(body), np.broadcast_to(placed[body], log.pose(body).shape))
        same_poses(log.tcp[:, number], compose(log.pose(f"{side}_{arm.hand}"), arm.tcp))
        jaws = np.stack([own[name] for name in arm.gripper.joints], axis=1)
        measured = [
            *(own[name] for name in arm.arm_joints),
            np.array([jaw_value(arm.gripper, row) for row in jaws]),
        ]
        names = [*(f"{side}_{name}" for name in arm.arm_joints), f"{side}_gripper"]
        state = log.state[:, [log.vector_names.index(name) for name in names]]
        np.testing.assert_allclose(state, np.stack(measured, axis=1), atol=CLOSE)


def test_cameras_are_where_they_are_mounted_and_tracks_where_bodies_are(made):
    meta, log = made.e.meta, made.log.late(made.e.meta.drawing.latency)
    for name, info in meta.drawing.cameras.items():
        mounted = world_poses(info.camera(name), body_poses(log), len(log))
        same_poses(made.cameras[name], np.broadcast_to(mounted, made.cameras[name].shape))
    frames = sorted({0, len(log) // 2, len(log) - 1})
    some = replace(log, times=log.times[frames], poses=log.poses[frames])
    appearance = stored_appearance(made.e, AssetStore(made.dataset.bodies), cached_parts)
    tracks = track_arrays(
        appearance, some, [name for name in meta.objects if name not in meta.clutter]
    )
    assert tracks and set(tracks) == {key for key in made.e.interception if key.startswith(TRACKS)}
    for key, values in tracks.items():
        np.testing.assert_allclose(
            made.e.interception[key][frames], values, rtol=1e-3, atol=2e-2, equal_nan=True
        )


def test_sentences_are_those_of_the_scene(made):
    assert sentences(made.scene, made.log, made.dataset.recipe().instructions) == dict(
        made.e.instructions
    )
