"""Physics against closed forms: fall, rest, following, release, drives, grasping, contacts; and
bytes that repeat."""

import hashlib
import subprocess
import sys
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from pipeline.data.episode.state_log import CONTACT_DTYPE
from pipeline.expert.actor import Actor
from pipeline.expert.skills import grasp, lift, open_
from pipeline.motion.models.turntable import Turntable
from pipeline.motion.pace import Pace
from pipeline.motion.planar import PlanarMotion, Segment
from pipeline.poses import (
    lifted,
    quat_about,
    quat_conjugate,
    quat_multiply,
    quat_rotate,
    rotation_vector,
    yawed,
)
from pipeline.tasks.outcome import Outcome
from pipeline.world.objects import FAMILIES
from pipeline.world.physics.body import TABLE_TOP, Body
from pipeline.world.physics.contacts import Contacts
from pipeline.world.physics.recorder import Recorder
from pipeline.world.physics.simulation import PHYSICS_HZ, Simulation
from pipeline.world.robots import get_embodiment

ROOT = Path(__file__).parents[3]
G = 9.81
DT = 1 / PHYSICS_HZ


def body(name, family, x, y, *, up=0.0, yaw=0.0, fixed=False, seed=0):
    instance = FAMILIES[family].draw(np.random.default_rng(seed))
    return Body(name, family, instance, yawed((x, y, TABLE_TOP + up), yaw), fixed)


def far_target():
    """A target that stands where nothing happens."""
    return body("target", "can", -0.4, 0.25)


def simulate(*bodies, target="target", motion=None):
    start = next(b for b in bodies if b.name == target)
    return Simulation(
        get_embodiment("aloha-agilex"),
        bodies,
        target,
        motion or PlanarMotion.still(start.pose, 1.0),
    )


def hold(simulation, steps):
    still = np.zeros(len(simulation.command))
    for _ in range(steps):
        simulation.step(simulation.home_vector(), still)


def curve(start, duration=2.0):
    """From a pose 20 cm to the right and 10 cm away on a parabola, in `duration` s."""
    c = np.array([[start[0], 0.2, 0.0], [start[1], 0.0, 0.1]])
    return PlanarMotion(
        2, 0.2, duration, 0.0, float(start[2]), start[3:], (Segment(0.0, duration, c),)
    )


def straight(start, speed, duration=5.0):
    c = np.array([[start[0], speed * duration], [start[1], 0.0]])
    return PlanarMotion(
        1, speed, duration, 0.0, float(start[2]), start[3:], (Segment(0.0, duration, c),)
    )


# --- bodies
# ------------------------------------------------------------------------------------------


def test_a_fixed_body_is_no_target():
    with pytest.raises(ValueError, match="'target' is fixed and cannot move"):
        simulate(body("target", "can", 0.0, 0.1, fixed=True))


def test_a_free_body_falls_as_it_must_and_comes_to_rest_on_the_table():
    block = body("block", "block", 0.3, 0.2, up=0.12)
    s = simulate(far_target(), block)
    for n in range(1, 30):
        hold(s, 1)
        # semi-implicit Euler: the speed of a step is that of its end
        assert s.pose("block")[2] == pytest.approx(
            TABLE_TOP + 0.12 - G * DT * DT * n * (n + 1) / 2, abs=2e-4
        )
    assert s.speed("block") == pytest.approx(G * 29 * DT, rel=1e-3)
    hold(s, 200)
    np.testing.assert_allclose(s.pose("block")[:3], block.pose[:3] - (0, 0, 0.12), atol=1.5e-3)
    assert s.speed("block") < 1e-3
    assert not s.events


def test_settling_ends_when_all_is_quiet_and_does_not_count_as_time():
    s = simulate(far_target(), body("block", "block", 0.3, 0.2, up=0.02))
    assert s.settle()
    assert 12 < s.settle_steps < PHYSICS_HZ
    assert (s.steps, s.time) == (0, 0.0)
    assert s.speed("block") < 0.01
    quiet = simulate(far_target())
    assert quiet.settle()
    assert quiet.settle_steps == 13  # as long as a body needs that begins to fall or to slide


def test_a_scene_that_does_not_come_to_rest_or_touches_its_target_is_not_settled():
    assert not simulate(far_target(), body("ball", "block", 0.3, 0.2, up=6.0)).settle()
    target = far_target()
    falling = Body(
        "block", "block", FAMILIES["block"].draw(np.random.default_rng(0)), lifted(target.pose, 0.2)
    )
    assert not simulate(target, falling).settle()


def test_a_fixed_body_stays_under_load():
    pad = body("pad", "pad", 0.3, 0.2, fixed=True)
    s = simulate(far_target(), pad, body("block", "block", 0.3, 0.2, up=0.05))
    hold(s, 150)
    np.testing.assert_array_equal(s.pose("pad"), pad.pose.astype(np.float32))
    assert s.speed("pad") == 0
    thickness = pad.instance.shape().aabb()[1, 2]
    assert s.pose("block")[2] == pytest.approx(TABLE_TOP + thickness, abs=1.5e-3)


def test_the_table_carries_a_resting_body_with_its_weight():
    block = body("block", "block", 0.3, 0.2)
    s = simulate(far_target(), block)
    hold(s, 240)
    found = {(s.names[a], s.names[b]): (impulse, point) for a, b, impulse, point, _ in s.contacts()}
    impulse, point = found["block", "table"]
    assert impulse == pytest.approx(block.instance.shape().mass * G * DT, rel=0.02)
    np.testing.assert_allclose(point, [0.3, 0.2, TABLE_TOP], atol=5e-3)
    assert all(a < b for a, b, *_ in s.contacts())


# --- the target
# ------------------------------------------------------------------------------------------


def test_contacts_of_sleeping_bodies_are_those_that_a_new_reading_gives(monkeypatch):
    bodies = far_target(), body("box", "block", 0.1, 0.1), body("can", "can", 0.35, 0.0, up=0.02)

    def contacts_of(simulation):
        found, reused, last = list[list[tuple]](), 0, None
        for step in range(300):
            if step in (200, 220):
                simulation.shift("can", np.array([-0.8, 0.3, 0.0]))
            simulation.step(simulation.command, np.zeros(len(simulation.command)))
            reused += simulation.touches is last
            last = simulation.touches
            found.append([(*pair[:3], *pair[3], pair[4]) for pair in simulation.contacts()])
        return found, reused

    found, reused = contacts_of(simulate(*bodies))
    assert 30 < reused < 200
    monkeypatch.setattr(Contacts, "still_hold", lambda *_: False)
    assert contacts_of(simulate(*bodies)) == (found, 0)
    assert len({len(pairs) for pairs in found}) > 1


def test_the_target_follows_its_motion_until_it_is_touched():
    target = body("target", "can", -0.3, 0.1)
    motion = curve(target.pose)
    s = simulate(target, motion=motion)
    assert s.settle()
    recorder = Recorder(s, 15)
    still = np.zeros(len(s.command))
    for _ in range(480):
        s.step(s.home_vector(), still)
        recorder.after_step()
    log = recorder.log()
    assert len(log) == 31
    assert (
        np.linalg.norm(log.pose("target")[:, :3] - motion.position(log.times), axis=1).max() < 1e-5
    )
    np.testing.assert_allclose(log.target_velocity, motion.velocity(log.times), atol=1e-12)
    assert np.ptp(log.pose("target")[:, 3:], axis=0).max() < 1e-6
    assert not s.released
    assert log.time_of("meeting") is None


def test_the_first_touch_releases_the_target_with_the_velocity_it_has():
    speed = 0.2
    target, block = body("target", "can", -0.2, 0.15), body("block", "block", 0.05, 0.15)
    s = simulate(target, block, motion=straight(target.pose, speed))
    assert s.settle()
    near = block.instance.shape().aabb()[0, 0]
    radius = max(v for v in target.instance.shape().aabb()[1, :2])
    touch = (0.05 + near - radius + 0.2) / speed
    before = 0
    while not s.released:
        hold(s, 1)
        before += 1
        assert s.time < touch + 0.02
    assert s.time == pytest.approx(touch, abs=0.02)
    assert s.touched_by == "block"
    assert [(e.name, e.time) for e in s.events] == [("meeting", s.time), ("release", s.time)]
    np.testing.assert_allclose(s.target_twist(), [speed, 0, 0, 0, 0, 0], atol=2e-5)
    at = s.pose("target")[0]
    hold(s, 120)
    # friction 0.5 of can and table stops it on v^2 / (2 mu g), the push against the block sooner
    assert 0 < s.pose("target")[0] - at < 1.1 * speed**2 / (2 * 0.5 * G)
    assert s.speed("target") < 0.01
    assert s.pose("block")[0] > 0.05


def test_without_stops_the_target_pushes_through_and_ends_its_motion_when_released():
    speed = 0.1
    target, block = body("target", "can", -0.2, 0.15), body("block", "block", -0.08, 0.15)
    motion = straight(target.pose, speed)
    s = Simulation(
        get_embodiment("aloha-agilex"), (target, block), "target", motion, after_touch="continue"
    )
    assert s.settle()
    hold(s, 240)
    assert s.touched_by == "block"
    assert not s.released
    assert [e.name for e in s.events] == ["meeting"]
    np.testing.assert_allclose(s.pose("target")[:3], motion.position(1.0), atol=1e-5)
    assert s.pose("block")[0] > -0.08 + 0.02
    s.release()
    s.release()
    assert [e.name for e in s.events] == ["meeting", "release"]
    hold(s, 120)
    assert s.speed("target") < 0.01


def test_a_touch_of_clutter_is_seen_at_the_step_of_the_touch_and_once():
    speed = 0.1
    target, block, other = (
        body("target", "can", -0.2, 0.15),
        body("block", "block", -0.08, 0.15),
        body("other", "block", 0.2, -0.1),
    )
    motion = straight(target.pose, speed)
    bodies = (target, block, other)
    s = Simulation(
        get_embodiment("aloha-agilex"),
        bodies,
        "target",
        motion,
        after_touch="continue",
        clutter=("block", "other"),
    )
    assert s.settle()
    assert s.events == []
    gap = (
        -0.08 + block.instance.shape().aabb()[0, 0] - (-0.2 + target.instance.shape().aabb()[1, 0])
    )
    hold(s, 240)
    touches = [e for e in s.events if e.name == "clutter_touched"]
    assert [e.by for e in touches] == ["block"]
    assert touches[0].time == pytest.approx(gap / speed, abs=0.02)


# --- the robot
# ------------------------------------------------------------------------------------------


def test_the_drives_follow_a_sine_with_feed_forward_to_5_mrad():
    s = simulate(far_target())
    home = s.home_vector()
    grip = np.array([n.endswith("gripper") for n in s.embodiment.vector_names])
    lower, upper = (np.array(v) for v in zip(*_limits(s.embodiment), strict=True))
    amplitude = np.where(grip, 0.0, np.minimum(0.25, 0.8 * np.maximum(upper - home, home - lower)))
    sign = np.where(upper - home > home - lower, 1.0, -1.0)
    w, worst = 2 * np.pi * 0.5, 0.0
    for n in range(1, 481):
        t = n * DT
        s.step(
            home + sign * amplitude * (1 - np.cos(w * t)) / 2,
            sign * amplitude * w * np.sin(w * t) / 2,
        )
        error = np.abs(s.state_vector(s.qpos()[0]) - s.command)[~grip]
        worst = max(worst, float(error.max()))
    assert worst < 5e-3


def _limits(embodiment):
    for arm in (embodiment.arms["left"], embodiment.arms["right"]):
        joints = {j.name: j for j in arm.joints}
        yield from ((joints[n].lower, joints[n].upper) for n in arm.arm_joints)
        yield 0.0, 1.0


def test_the_home_pose_is_held_still():
    s = simulate(far_target())
    hold(s, 240)
    qpos, qvel = s.qpos()
    np.testing.assert_allclose(s.state_vector(qpos), s.home_vector(), atol=2e-3)
    assert np.abs(qvel).max() < 1e-2


def test_jaws_close_and_open_to_their_measured_ends():
    s = simulate(far_target())
    grip = np.array([n.endswith("gripper") for n in s.embodiment.vector_names])
    for value in (0.0, 1.0, 0.5):
        command = np.where(grip, value, s.home_vector())
        for _ in range(150):
            s.step(command, np.zeros(len(command)))
        np.testing.assert_allclose(s.state_vector(s.qpos()[0])[grip], value, atol=0.02)


@pytest.fixture(scope="module")
def lifted_can():
    """A can that the right arm has grasped and lifted by 12 cm: its actor, still holding it."""
    can = body("target", "can", 0.22, -0.05)
    s = simulate(can)
    assert s.settle()
    bodies = {"target": can}
    actor = Actor(s, Recorder(s, 15), bodies, {"arm": "right"}, np.random.default_rng(0), 400)
    actor.perform(grasp("right", "target"))
    actor.perform(lift("right", 0.12))
    actor.wait(0.25)
    return actor


def test_a_grasped_can_is_lifted_and_held(lifted_can):
    actor, s = lifted_can, lifted_can.simulation
    o = Outcome(actor.recorder.log(), actor.bodies, s.embodiment, "target")
    assert s.touched_by.startswith("right_")
    assert 0.10 < o.rise("target") < 0.13
    assert o.holds("right", "target")
    assert not o.touching("target", "table")
    assert o.upright("target", 0.1)
    before = s.pose("target")
    actor.wait(0.25)
    np.testing.assert_allclose(s.pose("target"), before, atol=5e-4)
    gripper = s.embodiment.arms["right"].gripper
    width = 2 * actor.bodies["target"].instance.radius
    assert o.opening("right") * gripper.opening == pytest.approx(width, abs=3e-3)
    for finger in o.fingers("right"):
        row = o.contacts(finger, "target", 1)[-1]
        local = quat_rotate(
            o.pose("target")[3:] * np.array([1, -1, -1, -1]), row["point"] - o.pose("target")[:3]
        )
        assert np.hypot(*local[:2]) == pytest.approx(width / 2, abs=4e-3)


def test_a_log_has_one_name_per_column(lifted_can):
    s, log = lifted_can.simulation, lifted_can.recorder.log()
    frames, names = len(log), s.names
    assert log.bodies == names
    assert names[0] == "target"
    assert names[-1] == "table"
    assert log.poses.shape == (frames, len(names), 7)
    assert log.qpos.shape == log.qvel.shape == (frames, len(log.joints))
    assert log.state.shape == log.action.shape == (frames, len(log.vector_names))
    assert log.tcp.shape == (frames, 2, 7)
    assert log.contacts.dtype == CONTACT_DTYPE
    assert log.contacts["frame"].max() < frames
    np.testing.assert_allclose(log.times, np.arange(frames) / 15)
    np.testing.assert_allclose(np.linalg.norm(log.poses[..., 3:], axis=-1), 1, atol=1e-5)
    commands = np.array(lifted_can.stream.commands)
    np.testing.assert_array_equal(log.action[:-1], commands[15::16][: frames - 1])
    np.testing.assert_allclose(log.pose("table")[0], [0, 0, TABLE_TOP, 1, 0, 0, 0])
    hand = log.pose(f"right_{s.embodiment.arms['right'].hand}")
    assert np.ptp(np.linalg.norm(log.tcp[:, 1, :3] - hand[:, :3], axis=1)) < 1e-5
    measured = log.state[:, log.vector_names.index("right_joint1")]
    np.testing.assert_array_equal(measured, log.qpos[:, log.joints.index("right_joint1")])


def test_what_is_let_go_falls(lifted_can):
    lifted_can.perform(open_("right"))
    lifted_can.wait(0.5)
    assert lifted_can.pose("target")[2] < TABLE_TOP + 0.05
    assert lifted_can.held == {}


@pytest.mark.parametrize("fps", [7, 25, 50, 100])
def test_a_rate_that_does_not_divide_the_physics_is_refused(fps):
    class Dummy:
        pass

    with pytest.raises(ValueError, match=f"fps {fps} does not divide"):
        Recorder(Dummy(), fps)  # type: ignore[arg-type]


# --- determinism
# ------------------------------------------------------------------------------------------


def rollout_hash():
    """Random pushing about with arms, jaws and a moving target: sha256 of the log."""
    target, block = body("target", "can", -0.15, 0.15), body("block", "bottle", 0.05, 0.15)
    s = simulate(target, block, motion=straight(target.pose, 0.2))
    s.settle()
    recorder = Recorder(s, 15)
    rng = np.random.default_rng(1)
    for _ in range(20):
        command = s.home_vector() + rng.uniform(-0.3, 0.3, len(s.command))
        for _ in range(16):
            s.step(command, np.zeros(len(command)))
            recorder.after_step()
    log = recorder.log()
    parts = [
        log.poses,
        log.qpos,
        log.qvel,
        log.state,
        log.tcp,
        log.target_velocity,
        log.target_angular_velocity,
        log.contacts,
    ]
    return hashlib.sha256(
        b"".join(p.tobytes() for p in parts) + repr(log.events).encode()
    ).hexdigest()


def test_the_same_commands_give_the_same_bytes_in_any_process():
    first = rollout_hash()
    assert rollout_hash() == first
    code = (
        f"import sys; sys.path.insert(0, {str(ROOT)!r}); from tests.world.physics.test_simulation"
        " import rollout_hash; "
    )
    code += "print(rollout_hash())"
    assert (
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        ).stdout.strip()
        == first
    )


def test_a_turning_target_keeps_its_spin_and_its_origin_s_velocity_at_release():
    can = body("target", "can", 0.1, -0.1, up=0.3)
    motion = Turntable(
        1, 0.1, 2.0, 0.0, tuple(can.pose), Pace(0.0, (2.0,), (0.1,)), (0.1, -0.2), 1, 0.15
    )
    s = simulate(can, motion=motion)
    hold(s, 120)
    before, twist = s.pose("target"), motion.twist(0.5)
    s.release()
    assert not s.contacts() and "disc" in s.names
    hold(s, 2)
    np.testing.assert_allclose((s.pose("target") - before)[:2] / (2 * DT), twist[:2], atol=2e-3)
    np.testing.assert_allclose(s._moved.angular_velocity[2], twist[5], atol=1e-3)


@dataclass
class Tumbling:
    """A body whose origin flies straight at `speed` (3,) m/s while it turns at `spin` (3,)
    rad/s."""

    start: np.ndarray
    speed: np.ndarray
    spin: np.ndarray

    def pose(self, t):
        poses = []
        for seconds in np.ravel(t):
            angle = np.linalg.norm(self.spin) * seconds
            turned = quat_multiply(quat_about(self.spin, angle), self.start[3:])
            poses.append([*(self.start[:3] + seconds * self.speed), *turned])
        return np.reshape(poses, (*np.shape(t), 7))

    def twist(self, t):
        return np.broadcast_to([*self.speed, *self.spin], (*np.shape(t), 6))

    def scenery(self):
        return ()


@pytest.fixture(scope="module")
def tumbled():
    """A tumbling can, whose origin is the middle of its base, let go after 0.25 s: simulation,
    poses and twists of each step, and the step of the release."""
    can = body("target", "can", 0.0, 0.1, up=1.0)
    motion = Tumbling(can.pose, np.array([0.3, -0.2, 0.1]), np.array([3.0, 2.0, -1.0]))
    s = simulate(can, motion=motion)
    poses, twists = [s.pose("target")], [s.target_twist()]
    for step in range(100):
        if step == 60:
            s.release()
        hold(s, 1)
        poses.append(s.pose("target"))
        twists.append(s.target_twist())
    assert np.linalg.norm(s._moved.cmass_local_pose.p) > 0.03
    return motion, np.array(poses), np.array(twists), 60


def test_a_tumbling_target_is_let_go_with_the_velocity_of_its_origin(tumbled):
    motion, poses, _, released = tumbled
    # the mass centre falls, the origin goes round it: v = v_centre + w x (origin - centre)
    after = (poses[released + 1, :3] - poses[released, :3]) / DT
    wanted = motion.speed - [0, 0, G * DT]
    np.testing.assert_allclose(after, wanted, atol=5e-3)


def test_the_velocities_of_a_target_are_those_of_its_pose_before_and_after_the_release(tumbled):
    _, poses, twists, _ = tumbled
    moved = np.diff(poses[:, :3], axis=0) / DT
    turned = [
        rotation_vector(quat_multiply(b[3:], quat_conjugate(a[3:]))) / DT
        for a, b in pairwise(poses)
    ]
    between = (twists[1:] + twists[:-1]) / 2
    # gravity changes the velocity by 0.04 m/s a step; the mass centre's is up to 0.15 m/s away from
    # the origin's
    np.testing.assert_allclose(moved, between[:, :3], atol=0.022)
    np.testing.assert_allclose(turned, between[:, 3:], atol=0.02)


@pytest.mark.parametrize("borne", [False, True])
def test_a_borne_target_falls_half_a_second_after_it_was_touched(borne):
    can = replace(body("target", "can", 0.1, -0.1, up=0.3), borne=borne)
    s = simulate(can)
    s.release()
    hold(s, round(0.5 * PHYSICS_HZ))
    fallen = can.pose[2] - s.pose("target")[2]
    assert fallen < 1e-6 if borne else fallen > 0.29
    hold(s, round(0.2 * PHYSICS_HZ))
    assert can.pose[2] - s.pose("target")[2] > 0.1
