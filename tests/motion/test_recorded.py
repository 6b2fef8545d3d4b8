"""What is derived from a state log, against values computed by hand."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.data.cameras import CAMERA_TYPES, project
from pipeline.data.episode.state_log import CONTACT_DTYPE, Touch
from pipeline.export import ExportError
from pipeline.export.shared.derived import interception
from pipeline.export.shared.episodes import read_facts, reading
from pipeline.motion.recorded import pose_at, track
from pipeline.poses import compose, inverse, pose, quat_about
from tests.synthetic import SPEED, episode_path, make_episode


@pytest.fixture
def facts(tmp_path):
    path = make_episode(episode_path(tmp_path), frames=13)
    with reading(path) as file:
        return read_facts(file, tmp_path)


def touching(facts, rows, touches=()):
    """The same episode with other contacts, (frame, a, b, point), and first contacts."""
    table = np.array([(f, a, b, 0.1, p, 3) for f, a, b, p in rows], CONTACT_DTYPE)
    return interception(
        replace(facts, log=replace(facts.log, contacts=table, touches=list(touches)))
    )


def test_steps_times_and_the_planned_meeting(facts):
    found = interception(facts)
    assert found.steps.tolist() == [16 * i for i in range(13)]
    assert found.motion_start == 0.0
    np.testing.assert_allclose(found.planned_position[0], facts.target[0, 0] + SPEED * 6 / 15)


def test_first_contacts_are_those_of_the_log_and_the_first_of_them_gives_the_grasp(facts):
    log = facts.log
    target, left, right = (log.bodies.index(n) for n in ("target", "left_hand", "right_hand"))
    rows = [
        (6, target, left, (1, 2, 3)),
        (8, target, right, (4, 5, 6)),
        (9, left, right, (0, 0, 0)),
    ]
    poses = tuple(pose((0, 0, 0.9))), tuple(pose((0, 0.1, 0.8), quat_about((0, 0, 1), 1.0)))
    touches = [
        Touch("right", 121, (4, 5, 6), 3, *poses[::-1]),
        Touch("left", 84, (1, 2, 3), 2, *poses),
    ]
    found = touching(facts, rows, touches)
    first = found.first_contacts
    assert [first[side].points for side in ("right", "left")] == [3, 2]
    assert (
        found.contact_pairs.sum(0).tolist() == [1, 1]
        and found.contact_pairs[6, 0] == found.contact_pairs[8, 1] == 1
    )
    grasp = found.grasp_pose()
    np.testing.assert_allclose(
        grasp[-1],
        compose(
            facts.target[-1], compose(inverse(first["left"].target), np.array(first["left"].tcp))
        ),
    )


def test_an_object_that_meets_the_target_is_no_arm(facts):
    found = touching(facts, [(6, 0, 1, (0, 0, 0))])
    assert found.first_contacts == {} and np.array_equal(found.grasp_pose(), facts.target)


@pytest.mark.parametrize(("travel", "wanted"), [(0.1, True), (0.0, False)])
def test_what_is_held_is_what_travels_with_the_hand(facts, travel, wanted):
    log = facts.log
    path = np.repeat(pose((0, 0, 0.8))[None], len(log), 0)
    path[:, 2] += travel * log.times
    hands = np.stack([path, path + np.array([1.0, 0, 0, 0, 0, 0, 0])], axis=1)
    rows = np.array([(f, 0, 2, 0.1, (0, 0, 0), 1) for f in range(4, len(log))], CONTACT_DTYPE)
    poses = log.poses.copy()
    poses[:, log.bodies.index(facts.meta.target)] = path
    found = interception(replace(facts, log=replace(log, poses=poses, tcp=hands, contacts=rows)))
    # frames 4, 5 and 6 fill the window of 0.2 s
    assert found.held[:, 0].tolist() == [False] * 6 + [wanted] * 7
    assert not found.held[:, 1].any()


def test_poses_between_frames_turn_along_the_shorter_arc():
    a, b = pose((0, 0, 0)), pose((1, 0, 0), quat_about((0, 0, 1), 1.0))
    half = pose_at(np.array([0.0, 1.0]), np.stack([a, np.concatenate([b[:3], -b[3:]])]), 0.5)
    np.testing.assert_allclose(half, pose((0.5, 0, 0), quat_about((0, 0, 1), 0.5)), atol=1e-12)


def test_a_track_is_the_projection_of_every_frame(facts):
    kind = CAMERA_TYPES["D435"]
    for camera in facts.cameras:
        poses = facts.camera_poses[camera]
        got = track(kind, poses, facts.target[:, :3])
        for t in range(len(facts)):
            uv, depth = project(kind, poses[t], facts.target[t, :3])
            np.testing.assert_allclose(got[t, :3], [*uv, depth])
    assert got.shape == (13, 4)
    assert track(kind, facts.camera_poses["head_camera"], facts.target[:, :3])[:, 3].all()


def test_a_motion_that_is_none_is_named(facts):
    with pytest.raises(ExportError, match="episode_0000000"):
        interception(replace(facts, motion="{}"))
