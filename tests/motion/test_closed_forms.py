"""Motions in closed form: what holds of every model, and the law of each by an independent
calculation."""

import json
from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from pipeline.motion.closed_form import MotionError, first_that_fits
from pipeline.motion.contract import MotionRequest, NoMotion, Streams, keeps_alpha, twist_fault
from pipeline.motion.models import MODELS, motion_from_json
from pipeline.motion.workspace import Workspace
from pipeline.motion.wrapped import Rider
from pipeline.poses import compose, inverse, quat_multiply, quat_rotate, yawed

END = yawed((0.05, -0.05, 0.74), 0.4)
OWN = [name for name in MODELS if name != "planar"]
every_model = pytest.mark.parametrize("name", OWN)


def asked(level, **options):
    return MotionRequest(
        level,
        0.1,
        3.0,
        END,
        Workspace(-0.35, 0.35, -0.25, 0.25),
        radius=0.03,
        height=0.06,
        tail=0.25,
        **options,
    )


def drawn(name, level, seed, **options):
    streams = Streams(np.random.default_rng(seed), np.random.default_rng(seed + 1))
    return MODELS[name].draw(asked(level, **options), streams)


@every_model
@given(level=st.integers(1, 3), seed=st.integers(0, 10**6), lead=st.sampled_from([0.0, 0.5]))
@settings(max_examples=8, deadline=None)
def test_every_model_meets_keeps_alpha_and_comes_back_from_json(name, level, seed, lead):
    motion = drawn(name, level, seed, lead=lead)
    np.testing.assert_allclose(motion.pose(3.0), END, atol=1e-12)
    assert 0 < motion.features().average_speed <= 0.1 * (1 + 1e-9)
    assert keeps_alpha(motion, "average") and not twist_fault(motion)
    assert asked(level).workspace.contains(motion.pose(np.linspace(-lead, 3.0, 301))[:, :3]).all()
    again = motion_from_json(motion.to_json())
    assert again == motion and again.to_json() == motion.to_json()
    np.testing.assert_array_equal(motion.pose(-9.0), motion.pose(-lead))
    assert not motion.twist(-lead - 1e-6).any()


def test_a_motion_whose_twist_is_not_the_derivative_of_its_pose_is_refused():
    right = drawn("sinusoid", 1, 0)

    class Slow(type(right)):
        def rates(self, t):
            return 0.5 * type(right).rates(self, t)

    wrong = Slow(**{name: getattr(right, name) for name in (f.name for f in fields(right))})
    assert not twist_fault(right) and twist_fault(wrong)
    with pytest.raises(
        MotionError, match="'sinusoid': its twist is not the derivative of its pose"
    ):
        first_that_fits(asked(1), [wrong])


@every_model
@given(level=st.integers(1, 3), seed=st.integers(0, 10**6))
@settings(max_examples=5, deadline=None)
def test_a_twist_is_the_rate_of_the_pose(name, level, seed):
    motion, h = drawn(name, level, seed), 1e-6
    t = np.linspace(0.05, 3.2, 40)
    for at in (0.0, 3.0, *motion.breakpoints()):
        t = t[np.abs(t - at) > 2 * h]
    before, after = motion.pose(t - h), motion.pose(t + h)
    np.testing.assert_allclose(motion.twist(t)[:, :3], (after - before)[:, :3] / (2 * h), atol=1e-6)
    if name == "ramp":  # its spin jumps where its bend begins and ends
        steady = np.linalg.norm(motion.twist(t + h) - motion.twist(t - h), axis=1) < 0.01
        t, before, after = t[steady], before[steady], after[steady]
    turned = quat_multiply(after[:, 3:], before[:, 3:] * [1, -1, -1, -1])
    np.testing.assert_allclose(
        motion.twist(t)[:, 3:], turned[:, 1:] * np.sign(turned[:, :1]) / h, atol=1e-6
    )


@every_model
def test_the_greatest_speed_can_be_bounded(name):
    for seed in range(5):
        for level in (1, 2, 3):
            assert drawn(
                name, level, seed, speed_bound="maximum"
            ).features().maximum_speed <= 0.1 * (1 + 1e-6)


@every_model
def test_levels_are_constant_smooth_and_abrupt(name):
    for seed in range(3):
        for level in (1, 2):
            steady = drawn(name, level, seed)
            assert len(steady.breakpoints()) == (name == "rebound" and steady.bounce > 0)
        abrupt = drawn(name, 3, seed)
        jumps = [
            np.linalg.norm(np.diff(abrupt.twist([at - 1e-9, at])[:, :3], axis=0))
            for at in abrupt.breakpoints()
        ]
        assert jumps and (max(jumps) > 0.01 or name == "handed")


@every_model
def test_level_0_stands_among_the_scenery(name):
    streams = Streams(np.random.default_rng(0), np.random.default_rng(0))
    still, moving = MODELS[name].stand(asked(0), streams), drawn(name, 1, 0)
    assert still.features().maximum_speed == 0.0 and still.level == 0
    np.testing.assert_allclose(still.pose([-1.0, 1.0, 4.0]), np.tile(END, (3, 1)), atol=1e-12)
    assert {p.name for p in moving.scenery()} >= {"belt", "disc"} & {
        p.name for p in still.scenery()
    }
    for prop in moving.scenery():
        assert np.shape(prop.pose(np.zeros(4))) == (4, 7) and np.shape(prop.pose(0.0)) == (7,)


@every_model
def test_what_fits_nowhere_is_refused_with_its_reasons(name):
    with pytest.raises(NoMotion, match="blocked"):
        drawn(name, 1, 0, free=lambda motion: False)
    with pytest.raises(NoMotion, match="visibility"):
        drawn(name, 1, 0, visible=lambda path: np.zeros(len(path), bool))


@every_model
def test_what_is_no_motion_is_refused(name):
    values = json.loads(drawn(name, 1, 0).to_json())
    with pytest.raises(ValueError, match="alpha"):
        motion_from_json(
            json.dumps({key: value for key, value in values.items() if key != "alpha"})
        )


@given(level=st.integers(1, 3), seed=st.integers(0, 10**6))
@settings(max_examples=5, deadline=None)
def test_a_rolling_body_does_not_slip(level, seed):
    motion, t = drawn("rolling", level, seed), np.linspace(0, 3, 50)
    poses, twists = motion.pose(t), motion.twist(t)
    centre = poses[:, :3] + quat_rotate(poses[:, 3:], np.array([0, 0, 0.03]))
    np.testing.assert_allclose(centre[:, 2], END[2] + 0.03, atol=1e-12)
    lowest = centre - [0, 0, 0.03]
    np.testing.assert_allclose(
        twists[:, :3] + np.cross(twists[:, 3:], lowest - poses[:, :3]), 0, atol=1e-12
    )


@pytest.mark.parametrize("name", ["turntable", "circle"])
def test_a_circle_keeps_its_radius_and_only_the_turntable_turns_its_body(name):
    motion = drawn(name, 1, 3)
    poses = motion.pose(np.linspace(0, 3, 50))
    a, b, c = poses[0, :2], poses[20, :2], poses[-1, :2]
    centre = np.linalg.solve(2 * np.array([b - a, c - a]), [b @ b - a @ a, c @ c - a @ a])
    np.testing.assert_allclose(
        np.linalg.norm(poses[:, :2] - centre, axis=1), motion.radius, atol=1e-9
    )
    assert (np.ptp(poses[:, 3:], axis=0).max() > 0.05) == (name == "turntable")


def test_slats_keep_pace_with_what_rides_on_the_belt():
    motion = drawn("conveyor", 1, 0)
    slat = next(p for p in motion.scenery() if p.name == "slat_2")
    t = np.linspace(0.5, 0.6, 4)
    apart = np.diff(slat.pose(t)[:, :3] - motion.pose(t)[:, :3], axis=0)
    assert np.abs(apart).max() < 1e-12


@given(seed=st.integers(0, 10**6))
@settings(max_examples=5, deadline=None)
def test_a_pendulum_swings_as_gravity_has_it(seed):
    motion, t = drawn("pendulum", 1, seed), np.linspace(0.0, 3.0, 61)
    pivot = np.array(END[:3]) + np.array([0, 0, motion.length])
    arm = motion.pose(t)[:, :3] - pivot
    along = np.array([np.cos(motion.heading), np.sin(motion.heading), 0.0])
    angle, rate = (
        np.arctan2(arm @ along, -arm[:, 2]),
        (motion.twist(0.0)[:3] @ along) / (-arm[0, 2]),
    )
    fall = lambda _, y: [y[1], -9.81 / motion.length * np.sin(y[0])]  # noqa: E731
    found = solve_ivp(fall, (0, 3), [angle[0], rate], t_eval=t, rtol=1e-9, atol=1e-12).y[0]
    np.testing.assert_allclose(found, angle, atol=0.02 * np.abs(angle).max() + 1e-4)


def test_a_ramp_leads_down_to_the_table_with_its_body_flat_on_it():
    motion = drawn("ramp", 1, 1)
    poses, twists = motion.pose(np.linspace(0, 3.2, 60)), motion.twist(np.linspace(0, 3.2, 60))
    assert poses[0, 2] > END[2] + 0.005 and (np.diff(poses[:, 2]) <= 1e-12).all()
    np.testing.assert_allclose(poses[-5:, 2], END[2], atol=1e-12)
    up = quat_rotate(poses[:, 3:], np.array([0, 0, 1.0]))
    np.testing.assert_allclose(np.einsum("ij,ij->i", up, twists[:, :3]), 0, atol=1e-12)
    assert [prop.solid for prop in motion.scenery()] == [True]


def test_a_handed_object_arrives_at_rest_and_is_stopped_on_the_way_at_level_3():
    motion = drawn("handed", 3, 2)
    stop, resumes = motion.breakpoints()
    np.testing.assert_allclose(motion.twist([stop, (stop + resumes) / 2, 3.0, 3.2]), 0, atol=1e-9)
    assert np.linalg.norm(motion.twist(stop / 2)[3:]) > 0.01


@given(level=st.integers(1, 3), seed=st.integers(0, 10**6))
@settings(max_examples=5, deadline=None)
def test_what_flies_is_moved_by_gravity_alone(level, seed):
    for name, vertical in (("drop", "released"), ("toss", "met")):
        motion = drawn(name, level, seed)
        free, h = np.linspace(motion.release + 0.01, motion.duration + 0.05, 20), 1e-4
        pulled = (motion.pose(free + h) - 2 * motion.pose(free) + motion.pose(free - h))[
            :, :3
        ] / h**2
        np.testing.assert_allclose(pulled, np.tile([0, 0, -9.81], (20, 1)), atol=1e-3)
        at = motion.release if vertical == "released" else motion.duration
        assert abs(motion.twist(at)[2]) < 1e-9 and 0.05 < 9.81 * motion.flight**2 / 2 < 0.13
        np.testing.assert_allclose(motion.pose([9.0, 99.0])[:, 2], 0.0, atol=1e-12)
        assert not motion.twist(9.0).any()


@given(level=st.integers(1, 3), seed=st.integers(0, 10**6))
@settings(max_examples=5, deadline=None)
def test_what_was_pushed_is_slowed_by_friction_and_struck_by_cushions(level, seed):
    motion = drawn("pushed", level, seed)
    t, h = np.linspace(0.12 * 3 + 0.01, 3.0, 40), 1e-4
    speeds = motion.speed(t)
    for at in motion.breakpoints():
        t = t[np.abs(t - at) > 2 * h]
    slowed = (motion.speed(t + h) - motion.speed(t - h)) / (2 * h)
    np.testing.assert_allclose(slowed, -9.81 * motion.friction, atol=1e-6)
    assert (np.diff(speeds) < 0).all() and len(motion.breakpoints()) == len(motion.normals) <= 2 * (
        level == 3
    )
    for at, normal in zip(motion.breakpoints(), motion.normals, strict=True):
        before, after = motion.twist([at - 1e-9, at])
        n, along = (
            np.array([np.cos(normal), np.sin(normal)]),
            np.array([-np.sin(normal), np.cos(normal)]),
        )
        assert after[:2] @ n == pytest.approx(-motion.restitution * (before[:2] @ n), rel=1e-5)
        # what the surface gains in spin, the disc loses in speed: I = m r^2 / 2
        rubbed = (before - after)[:2] @ along
        assert motion.radius * (after - before)[5] / 2 == pytest.approx(rubbed, abs=1e-6)


@given(level=st.integers(1, 3), seed=st.integers(0, 10**6))
@settings(max_examples=10, deadline=None)
def test_a_ball_rebounds_from_its_wall_as_from_a_mirror(level, seed):
    motion = drawn("rebound", level, seed)
    wall, goal = (prop.pose(0.0) for prop in motion.scenery())
    n = quat_rotate(wall[3:], np.array([1.0, 0, 0]))
    centre = lambda t: motion.centre(motion.pace.advance(t))  # noqa: E731
    off = (centre(np.linspace(0, 3.0, 3001)) - wall[:3]) @ n
    assert off.min() > motion.radius - 1e-9
    if motion.bounce:
        [at] = motion.breakpoints()
        assert (centre(at) - wall[:3]) @ n == pytest.approx(motion.radius, abs=1e-4)
        before, after = np.diff(centre(at + np.array([-2e-5, -1e-5, 1e-5, 2e-5])), axis=0)[[0, 2]]
        kept = np.linalg.norm(after) / np.linalg.norm(before)
        np.testing.assert_allclose(before - 2 * (before @ n) * n, after / kept, atol=1e-9)
        assert 0.39 < kept < 0.61 if level == 3 else kept == pytest.approx(1, abs=1e-3)
    ahead = quat_rotate(goal[3:], np.array([1.0, 0, 0]))
    assert (centre(np.array(3.0)) - goal[:3]) @ ahead == pytest.approx(-motion.line)


@given(level=st.integers(1, 3), seed=st.integers(0, 10**6))
@settings(max_examples=10, deadline=None)
def test_what_goes_into_a_tunnel_comes_out_before_the_meeting(level, seed):
    motion = drawn("tunnel", level, seed, lead=1.0)
    [tunnel], t = motion.scenery(), np.linspace(-1.0, 3.0, 2001)
    box = np.abs(np.array([piece.at[:3] for piece in tunnel.pieces])).max(0)
    along = (motion.pose(t) - tunnel.pose(0.0))[:, :3] @ [
        np.cos(motion.heading),
        np.sin(motion.heading),
        0,
    ]
    hidden = np.abs(along) < motion.length / 2 - 0.03
    assert tunnel.solid and hidden.any() and (np.diff(along) > 0).all()
    assert along[-1] > motion.length / 2 + 0.03 + 0.03
    assert box[1] > 0.03 and box[2] > 0.06


@given(level=st.integers(1, 3), seed=st.integers(0, 10**6))
@settings(max_examples=10, deadline=None)
def test_what_passes_twice_comes_back_on_another_lane(level, seed):
    motion, t = drawn("twice", level, seed, lead=2.0), np.linspace(-2.0, 3.0, 4001)
    c, s = np.cos(motion.heading), np.sin(motion.heading)
    local = (motion.pose(t)[:, :3] - END[:3]) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    x, y, z = local.T
    first, second = np.abs(y - 2 * motion.side * motion.turn) < 1e-12, np.abs(y) < 1e-12
    assert (np.diff(x[first]) < 0).all() and (np.diff(x[second]) > 0).all()
    turning = ~first & ~second
    r = np.hypot(x[turning] + motion.back, y[turning] - motion.side * motion.turn)
    np.testing.assert_allclose(r, motion.turn, atol=1e-12)
    assert not z.any() and x[first].max() > -motion.turn
    if level == 3:
        fast, slow = (motion.speed(t[of]).mean() for of in (second, first))
        assert fast / slow == pytest.approx(1.6)


@given(level=st.integers(1, 3), seed=st.integers(0, 10**6))
@settings(max_examples=10, deadline=None)
def test_two_that_change_places_are_opposite_and_the_ball_is_under_one(level, seed):
    other_end, t = yawed((0.20, -0.03, 0.74), 0.0), np.linspace(0.0, 3.0, 61)
    motion = drawn("shuffle", level, seed, company=((0.20, -0.03, 0.03),))
    other = Rider(motion, compose(inverse(END), other_end))
    middle = (END[:3] + other_end[:3]) / 2
    at, opposite, ball = motion.pose(t)[:, :3], other.pose(t)[:, :3], motion.scenery()[-1].pose(t)
    np.testing.assert_allclose((at + opposite) / 2, np.tile(middle, (61, 1)), atol=1e-12)
    np.testing.assert_allclose(ball[0, :3], middle, atol=1e-12)
    under = t >= motion.covered
    np.testing.assert_allclose(ball[under, :3], at[under], atol=1e-12)
    assert 0 < np.linalg.norm(ball[5, :3] - middle) < 0.9 * np.linalg.norm(at[5] - middle)


def test_plates_light_up_for_a_moment_in_two_colours():
    for name, hue in (("flash", 1), ("flash_red", 0)):
        motion, t = drawn(name, 1, 0), np.linspace(0, 3, 3001)
        plate, light = motion.scenery()
        assert int(np.argmax(light.pieces[0].colour)) == hue
        lit = np.abs(light.pose(t)[:, 2] - END[2]) < 1e-9
        assert lit.sum() / 1000 == pytest.approx(0.6, abs=0.002) and not lit[:300].any()
        np.testing.assert_allclose(light.pose(t)[lit, :3], motion.pose(t)[lit, :3], atol=1e-12)
        np.testing.assert_allclose(plate.pose(t)[:, :3], motion.pose(t)[:, :3], atol=1e-12)
