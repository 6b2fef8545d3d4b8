from dataclasses import asdict

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy import stats

from pipeline.motion.contract import MotionRequest, NoMotion, Streams
from pipeline.motion.models import back_calculate_motion, motion_from_json
from pipeline.motion.planar import PlanarMotion
from pipeline.motion.planar_shapes import mean_speed
from pipeline.motion.workspace import Workspace
from pipeline.poses import yawed
from tests.motion.jumps import velocity_jumps

TABLE = Workspace(-0.35, 0.35, -0.25, 0.15)
END = yawed((0.12, -0.08, 0.77), 0.4)
LATE = (1.0, 0.8, 0.64, 0.5, 0.4, 0.3, 0.24)


def streams(shape: int, direction: int) -> Streams:
    return Streams(np.random.default_rng((shape, 0)), np.random.default_rng((direction, 1)))


def draw(
    level, seed=0, alpha=0.1, duration=3.0, end=END, workspace=TABLE, **options
) -> PlanarMotion:
    both = streams(seed, options.pop("direction", seed))
    found = back_calculate_motion(
        MotionRequest(level, alpha, duration, end, workspace, **options), both
    )
    assert isinstance(found, PlanarMotion)
    return found


def drawn(level, seed, **options) -> PlanarMotion | None:
    """The motion, or None where its shape fits in no direction."""
    try:
        return draw(level, seed, **options)
    except NoMotion:
        return None


def clock(m: PlanarMotion, n=400):
    return np.linspace(-m.lead, m.duration, n)


def arc(m: PlanarMotion) -> float:
    return float(np.linalg.norm(np.diff(m.position(clock(m, 3000)), axis=0), axis=1).sum())


@settings(max_examples=30, deadline=None)
@given(
    level=st.sampled_from([1, 2, 3]),
    seed=st.integers(0, 2**32),
    alpha=st.sampled_from([0.05, 0.1, 0.2, 0.3]),
    duration=st.floats(2.0, 8.0),
    lead=st.sampled_from([0.0, 0.8]),
    x=st.floats(-0.34, 0.34),
    y=st.floats(-0.24, 0.14),
)
def test_every_motion_keeps_its_promises(level, seed, alpha, duration, lead, x, y):
    end = yawed((x, y, 0.77), 0.4)
    try:
        m = draw(level, seed, alpha, duration, end, lead=lead)
    except NoMotion as nothing:
        assert nothing.features is None or nothing.counts["workspace"] >= 256
        assume(False)
    np.testing.assert_allclose(m.pose(duration), end, atol=1e-9, rtol=0)
    points = m.position(clock(m))
    assert TABLE.contains(points).all()
    assert TABLE.guarded((x, y)).contains(points).all()
    assert arc(m) / (duration + lead) <= alpha * (1 + 1e-9)
    assert m.average_speed() <= alpha * (1 + 1e-9)
    assert (points[:, 2] == 0.77).all()
    assert motion_from_json(m.to_json()).to_json() == m.to_json()
    if level == 3:
        assert 1 <= len(m.breakpoints()) <= 2
        after, before = m.velocity(m.breakpoints()), m.velocity(m.breakpoints() - 1e-7)
        assert np.linalg.norm(after - before, axis=-1).max() >= 0.2 * alpha - 1e-4
    else:
        assert len(m.breakpoints()) == 0
    if level == 1:
        v = m.velocity(0.0)
        np.testing.assert_allclose(m.position(-lead), end[:3] - v * (duration + lead), atol=1e-12)
        assert 0.01 - 1e-12 <= np.linalg.norm(v) <= alpha * (1 + 1e-9)


@pytest.mark.parametrize("level", [1, 2, 3])
def test_the_maximum_bound_holds_at_every_instant(level):
    for seed in range(60):
        m = draw(level, seed, speed_bound="maximum")
        steps = np.linalg.norm(np.diff(m.position(clock(m, 2000)), axis=0), axis=1) / (
            m.duration / 1999
        )
        assert steps.max() <= 0.1 * (1 + 1e-9)
        assert m.maximum_speed() <= 0.1 * (1 + 1e-9)


def test_the_average_bound_lets_levels_2_and_3_be_faster_for_a_while():
    for level in (2, 3):
        assert max(draw(level, seed).maximum_speed() for seed in range(30)) > 0.12


def test_lead_moves_the_start_and_not_the_meeting():
    m = draw(2, 3, lead=1.5)
    assert m.lead == 1.5
    assert np.linalg.norm(m.velocity(-1.0)) > 0
    np.testing.assert_array_equal(m.position(-5.0), m.position(-1.5))
    assert not m.velocity(-1.6).any()
    np.testing.assert_allclose(m.position(3.0), END[:3], atol=1e-12)


def test_level_1_is_as_fast_with_a_lead_as_without():
    # the law's share at alpha itself is 27 %
    for lead in (0.0, 2.0):
        speeds = [draw(1, seed, alpha=0.02, lead=lead).maximum_speed() for seed in range(100)]
        assert 10 <= sum(speed > 0.02 - 1e-9 for speed in speeds) <= 50


@pytest.mark.parametrize(("level", "alpha"), [(0, 0.0), (0, 0.3), (1, 0.0), (2, 0.0), (3, 0.0)])
def test_level_0_and_alpha_0_are_the_same_still_target(level, alpha):
    both = streams(0, 0)
    m = back_calculate_motion(MotionRequest(level, alpha, 3.0, END, TABLE, lead=0.5), both)
    assert m.to_json() == PlanarMotion.still(END, 3.0, 0.5).to_json()
    assert both.shape.random() == streams(0, 0).shape.random()
    assert both.direction.random() == streams(0, 0).direction.random()


@pytest.mark.parametrize("level", [1, 2, 3])
def test_the_seed_decides_the_motion(level):
    assert draw(level, 1).to_json() == draw(level, 1).to_json()
    assert len({draw(level, seed).to_json() for seed in range(20)}) == 20


@pytest.mark.parametrize("level", [1, 2, 3])
def test_the_tail_stays_in_the_workspace(level):
    near_the_corner = yawed((0.3, -0.2, 0.77), 0.0)
    plain = [draw(level, seed, end=near_the_corner) for seed in range(30)]
    assert any(not TABLE.contains(m.position(m.duration + 1.5)) for m in plain)
    kept = [
        m for m in (drawn(level, seed, end=near_the_corner, tail=1.5) for seed in range(30)) if m
    ]
    assert len(kept) >= 5
    for m in kept:
        assert TABLE.contains(m.position(np.linspace(-1, m.duration + 1.5, 200))).all()


@pytest.mark.parametrize("level", [2, 3])
def test_the_end_speed_can_be_limited(level):
    assert max(np.linalg.norm(draw(level, seed).end_velocity) for seed in range(30)) > 0.1
    for seed in range(30):
        assert np.linalg.norm(draw(level, seed, end_speed_limit=0.06).end_velocity) <= 0.06


def test_visibility_is_asked_in_batches_about_whole_paths():
    shapes = []

    def left_of_the_end(points):
        shapes.append(points.shape)
        assert (points[..., 2] == END[2]).all()
        return (points[..., 0] <= END[0] + 1e-9).all(-1)

    m = draw(1, visible=left_of_the_end)
    assert m.position(0.0)[0] < END[0]
    n, k, d = shapes[0]
    assert n > 10
    assert k >= 24
    assert d == 3


def test_visibility_sees_start_end_and_the_end_of_the_tail():
    extremes = []

    def remember(points):
        extremes.append(points[0])
        return np.ones(len(points), bool)

    m = draw(2, 5, visible=remember, tail=0.5)
    for t in (0.0, m.duration, m.duration + 0.5):
        assert np.linalg.norm(extremes[0] - m.position(t), axis=-1).min() < 1e-12


def test_free_is_asked_for_one_direction_after_another():
    offered = []

    def third(motion):
        offered.append(motion)
        return len(offered) == 3

    m = draw(3, 4, free=third)
    assert len(offered) == 3
    assert m is offered[2]
    assert draw(3, 4).to_json() == offered[0].to_json()
    features = [list(vars(motion.features()).values()) for motion in offered]
    np.testing.assert_allclose(features, [features[0]] * 3, rtol=1e-9)


@pytest.mark.parametrize("level", [1, 2, 3])
def test_the_shape_is_kept_whatever_the_direction(level):
    """Two attempts of a slot: speeds and distances from the end at all times are the same, the
    directions are not."""
    for seed in range(20):
        a, b = draw(level, seed, direction=1), draw(level, seed, direction=2)
        away = [np.linalg.norm(m.position(clock(m)) - END[:3], axis=-1) for m in (a, b)]
        np.testing.assert_allclose(away[0], away[1], atol=1e-9)
        speeds = [np.linalg.norm(m.velocity(clock(m, 50)), axis=-1) for m in (a, b)]
        np.testing.assert_allclose(speeds[0], speeds[1], atol=1e-9)
        assert np.linalg.norm(a.position(0.0) - b.position(0.0)) > 1e-4


def law(speed, alpha=0.1):
    """Distribution function of clip(abs(N(0.8 alpha, alpha / 3)), 0.01, alpha), from the normal
    one."""
    normal = stats.norm(0.8 * alpha, alpha / 3)
    inside = normal.cdf(speed) - normal.cdf(-np.asarray(speed))
    return np.where(speed >= alpha, 1.0, np.where(speed < 0.01, 0.0, inside))


def accepted_in_some_layout(seed) -> PlanarMotion:
    """A slot's motion: its shape is kept over layouts with other meeting places until it fits. Half
    the table is blocked."""
    rng = np.random.default_rng((seed, 2))
    for attempt in range(100):
        x, y = rng.uniform((-0.25, -0.2), (0.25, 0.1))
        end = yawed((x, y, 0.77), 0.0)
        if found := drawn(
            1,
            seed,
            direction=attempt,
            end=end,
            free=lambda m, x=x: bool(m.position(0.0)[0] > x + 0.02),
        ):
            return found
    raise AssertionError("no layout has room")


def test_accepted_speeds_of_level_1_follow_the_papers_law_although_fast_motions_fit_more_seldom():
    speeds = np.sort([accepted_in_some_layout(seed).average_speed() for seed in range(400)])
    below = speeds < 0.1 - 1e-9
    share = (np.arange(1, 401) / 400)[below]
    assert np.abs(share - law(speeds[below])).max() < 1.36 / np.sqrt(400)
    assert abs((~below).mean() - (1 - law(0.1 - 1e-9))) < 0.07


def test_no_motion_counts_shapes_and_directions():
    with pytest.raises(NoMotion) as nothing:
        draw(2, visible=lambda p: np.zeros(len(p), bool))
    counts = nothing.value.counts
    assert counts["visibility"] > 50
    assert counts["visibility"] + counts.get("workspace", 0) == 2 * 256
    assert "visibility" in str(nothing.value)
    assert asdict(nothing.value.features) == pytest.approx(asdict(draw(2).features()))
    asked = []
    with pytest.raises(NoMotion) as nothing:
        draw(1, free=lambda m: bool(asked.append(m)))
    assert nothing.value.counts["blocked"] == len(asked) > 50
    assert sum(nothing.value.counts.values()) == 256
    with pytest.raises(NoMotion) as nothing:
        draw(3, speed_bound="maximum", end_speed_limit=1e-6, candidates=150)
    assert sum(nothing.value.counts.values()) == 150
    assert {"miss", "speed", "end_speed"} <= set(nothing.value.counts)
    assert nothing.value.features is None


def test_a_straight_motion_longer_than_the_table_is_not_tried():
    """At 0.3 m/s over 3 s the law's typical way is 0.7 m, and the farthest corner is 0.52 m away:
    slower draws are taken."""
    farthest = max(np.hypot(x - END[0], y - END[1]) for x in (-0.35, 0.35) for y in (-0.25, 0.15))
    motions = [m for m in (drawn(1, seed, alpha=0.3) for seed in range(40)) if m]
    assert len(motions) > 10
    assert max(m.features().displacement for m in motions) <= farthest
    with pytest.raises(NoMotion, match="no candidate"):
        draw(1, candidates=0)


@pytest.mark.parametrize("alpha", [0.2, 0.3])
def test_targets_that_start_late_keep_the_law_where_those_that_do_not_are_slower(alpha):
    """The speed of every slot is the first one that its stream draws, whatever the table has room
    for."""
    early, late = [], []
    for seed in range(60):
        law = np.clip(
            abs(np.random.default_rng((seed, 0)).normal(0.8 * alpha, alpha / 3)), 0.01, alpha
        )
        m = draw(1, seed, alpha=alpha, moving=LATE)
        assert m.features().average_speed == pytest.approx(law, rel=1e-9)
        np.testing.assert_allclose(m.pose(m.duration), END, atol=1e-12)
        assert TABLE.contains(m.position(clock(m))).all()
        if m.lead < 0:
            assert (
                not m.twist(np.linspace(0, -m.lead - 1e-9, 5)).any()
                and not np.ptp(m.pose([0.0, -m.lead]), axis=0).any()
            )
        late.append(m)
        early.append(drawn(1, seed, alpha=alpha))
    speeds = [np.mean([m.features().average_speed for m in group if m]) for group in (early, late)]
    assert speeds[0] < 0.85 * mean_speed(alpha) and speeds[1] == pytest.approx(
        mean_speed(alpha), rel=0.1
    )
    assert (
        any(m.lead < 0 for m in late)
        and motion_from_json(late[0].to_json()).to_json() == late[0].to_json()
    )


def test_jumps_of_level_3_can_be_capped():
    free, capped = (
        [draw(3, seed, alpha=0.3, jump_limit=limit) for seed in range(25)] for limit in (None, 1.2)
    )
    most = [max(velocity_jumps(m).max() for m in group) for group in (free, capped)]
    assert most[0] > 1.2 >= most[1]
    same = [a.to_json() == b.to_json() for a, b in zip(free, capped, strict=True)]
    assert same == [velocity_jumps(m).max() <= 1.2 for m in free]


def test_a_level_3_path_without_an_abrupt_change_is_rejected(monkeypatch):
    monkeypatch.setattr("pipeline.motion.models.planar.ABRUPT", 1e6)
    with pytest.raises(NoMotion) as nothing:
        draw(3, candidates=200)
    assert nothing.value.counts.keys() == {"miss", "smooth"}


def test_an_end_outside_the_workspace_is_named():
    with pytest.raises(NoMotion) as nothing:
        draw(1, end=yawed((0.4, 0, 0.77), 0))
    assert nothing.value.counts == {"end_outside": 1}


def test_a_level_that_the_model_does_not_have_is_refused():
    with pytest.raises(ValueError, match="level 4"):
        draw(4)
