"""Kinematics against pinocchio, finite differences and round trips."""

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.planning import ik_kernels
from pipeline.planning.budgets import IK, LINE, IkBudget
from pipeline.planning.kinematics import (
    Chain,
    chain_of,
    fk,
    fk_batch,
    ik_many,
    ik_path,
    limit_margin,
    line_poses,
)
from pipeline.poses import angle_between, compose, pose, quat_about, quat_multiply, quat_rotate
from tests.planning.arms import ik, pin_model, se3, seven_arm, six_arm

ARMS = {"six": six_arm(), "seven": seven_arm()}
CHAINS = {name: chain_of(arm) for name, arm in ARMS.items()}


@pytest.fixture(params=sorted(CHAINS))
def chain(request: pytest.FixtureRequest) -> Chain:
    return CHAINS[request.param]


def jacobian(chain: Chain, q: np.ndarray) -> np.ndarray:
    """The Jacobian (6,n) that inverse kinematics descends along, from its kernels."""
    axes, origins, rotation, position = (
        np.empty((len(chain.home), 3)),
        np.empty((len(chain.home), 3)),
        np.empty((3, 3)),
        np.empty(3),
    )
    ik_kernels.forward(chain.pre, chain.prismatic, chain.tool, q, axes, origins, rotation, position)
    out = np.zeros((6, len(chain.home)))
    for i in range(len(chain.home)):
        ik_kernels.column(axes[i], origins[i], position, chain.prismatic[i], 1.0, out[:, i])
    return out


def random_joints(chain: Chain, count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(chain.lower, chain.upper, (count, len(chain.home)))


@pytest.mark.parametrize("name", sorted(ARMS))
def test_fk_and_jacobian_agree_with_pinocchio(name: str) -> None:
    arm, chain = ARMS[name], CHAINS[name]
    model, frame = pin_model(arm)
    data = model.createData()
    for q in random_joints(chain, 50):
        full = np.concatenate([q, np.zeros(model.nq - len(chain.home))])
        pin.framesForwardKinematics(model, data, full)
        got, want = fk(chain, q), data.oMf[frame]
        np.testing.assert_allclose(got[:3], want.translation, atol=1e-12)
        np.testing.assert_allclose(se3(got).rotation, want.rotation, atol=1e-12)
        want_j = pin.computeFrameJacobian(
            model, data, full, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )[:, : len(chain.home)]
        np.testing.assert_allclose(jacobian(chain, q), want_j, atol=1e-12)


@settings(max_examples=25, deadline=None)
@given(unit=st.lists(st.floats(0.02, 0.98), min_size=6, max_size=6))
def test_jacobian_is_the_derivative_of_fk(unit: list[float]) -> None:
    chain = CHAINS["six"]
    q = chain.lower + np.array(unit) * (chain.upper - chain.lower)
    j, eps = jacobian(chain, q), 1e-6
    for i in range(len(chain.home)):
        step = np.eye(len(chain.home))[i] * eps
        a, b = fk(chain, q - step), fk(chain, q + step)
        turn = quat_multiply(b[3:], a[3:] * [1, -1, -1, -1])
        angular = 2 * np.sign(turn[0]) * turn[1:] / (2 * eps)
        np.testing.assert_allclose(
            np.concatenate([(b - a)[:3] / (2 * eps), angular]), j[:, i], atol=1e-7
        )


def test_prismatic_joints_are_handled() -> None:
    arm = six_arm()
    rail = arm.joints[0].__class__(
        "rail", "prismatic", "ground", "base", pose((0, 0, 0.1)), (1.0, 0, 0), -0.2, 0.2
    )
    on_rail = arm.__class__(
        **{
            **vars(arm),
            "joints": (rail, *arm.joints),
            "arm_joints": ("rail", *arm.arm_joints),
            "home": (0.0, *arm.home),
        }
    )
    chain, still = chain_of(on_rail), chain_of(arm)
    q = random_joints(still, 1)[0]
    along = quat_rotate(arm.base[3:], (1, 0, 0))
    got, want = fk(chain, np.array([0.15, *q])), fk(still, q)
    np.testing.assert_allclose(got[:3], want[:3] + 0.15 * along + [0, 0, 0.1], atol=1e-12)
    np.testing.assert_allclose(
        jacobian(chain, np.array([0.15, *q]))[:, 0], [*along, 0, 0, 0], atol=1e-12
    )
    goal = fk(chain, np.array([-0.15, *q]))
    found = ik(chain, goal, np.array(chain.home))
    assert found is not None
    np.testing.assert_allclose(fk(chain, found)[:3], goal[:3], atol=1e-4)


def test_ik_round_trip_on_random_reachable_poses(chain: Chain) -> None:
    q = random_joints(chain, 500)
    targets = fk_batch(chain, q)
    seed = 0.5 * (chain.lower + chain.upper)
    solved = 0
    for target in targets:
        found = ik(chain, target, seed)
        if found is None:
            continue
        solved += 1
        reached = fk(chain, found)
        assert np.linalg.norm(reached[:3] - target[:3]) < 1e-4
        assert angle_between(reached[3:], target[3:]) < 1e-3
        assert (found >= chain.lower).all() and (found <= chain.upper).all()
    assert solved >= 0.99 * len(targets)


def test_targets_do_not_influence_each_other_and_the_answer_is_always_the_same(
    chain: Chain,
) -> None:
    targets = fk_batch(chain, random_joints(chain, 60, seed=1))
    q, ok = ik_many(chain, targets, chain.home[None])
    again, ok_again = ik_many(chain, targets, chain.home[None])
    np.testing.assert_array_equal(q, again)
    np.testing.assert_array_equal(ok, ok_again)
    assert ok.mean() > 0.9
    for i, target in enumerate(targets):
        one, reached = ik_many(chain, target[None], chain.home[None])
        assert reached[0] == ok[i]
        np.testing.assert_array_equal(one[0], q[i])
    assert (q[~ok] == 0).all()


def test_ik_many_prefers_the_seed_and_works_without_seeds() -> None:
    chain = CHAINS["six"]
    q = random_joints(chain, 50, seed=2)
    targets = fk_batch(chain, q)
    for i in range(len(q)):
        found, ok = ik_many(chain, targets[i : i + 1], q[i : i + 1])
        assert ok[0]
        np.testing.assert_array_equal(found[0], q[i])
    assert ik_many(chain, targets, np.empty((0, 6)), IkBudget(give_up_after=None))[1].mean() > 0.9


def test_unreachable_and_half_turn_targets() -> None:
    chain = CHAINS["six"]
    assert ik(chain, pose((0, 2.0, 0.9)), chain.home) is None
    # inside the ball but pointing back at the robot: no solution, bounded effort
    assert ik(chain, pose((-0.3, 0.2, 0.8), quat_about((0, 0, 1), -np.pi / 2)), chain.home) is None
    seven = CHAINS["seven"]
    turned = compose(fk(seven, seven.home), pose((0, 0, 0), quat_about((1, 0, 0), np.pi)))
    assert ik(seven, turned, seven.home) is not None


def test_limits_keep_the_margin() -> None:
    chain = CHAINS["six"]
    assert chain.lower[0] == pytest.approx(-3.14 + IK.limit_margin)
    assert chain.upper[0] == pytest.approx(2.618 - IK.limit_margin)
    # this pose needs joint 6 at its hard limit exactly, which lies outside the margin
    target = fk(chain, np.array([0.0, 0.9, 1.0, 0.3, 0.0, 2.0]))
    found = ik(chain, target, chain.home, tolerance=(1e-6, 1e-5))
    assert found is None or (found <= chain.upper).all()
    assert ik(chain, target, chain.home, tolerance=(1e-3, 3e-3)) is not None


def test_ik_path_is_straight_and_continuous() -> None:
    chain = CHAINS["six"]
    start = fk(chain, chain.home)
    goal = compose(start, pose((0.10, 0.02, 0.03), quat_about((0, 0, 1), 0.2)))
    poses = line_poses(start, goal)
    q = ik_path(chain, poses, chain.home)
    assert q is not None and q.shape == (len(poses), 6)
    np.testing.assert_allclose(q[0], chain.home, atol=1e-6)
    assert np.abs(np.diff(q, axis=0)).max() < 0.2
    points = fk_batch(chain, q)[:, :3]
    along = (goal - start)[:3] / np.linalg.norm((goal - start)[:3])
    off = (points - start[:3]) - np.outer((points - start[:3]) @ along, along)
    assert np.linalg.norm(off, axis=1).max() < 1e-4
    assert (np.diff(points @ along) > 0).all()


def test_ik_path_fails_when_the_line_leaves_the_workspace_or_starts_elsewhere() -> None:
    chain = CHAINS["six"]
    start = fk(chain, chain.home)
    away = start.copy()
    away[1] += 0.9
    assert ik_path(chain, line_poses(start, away), chain.home) is None
    assert ik_path(chain, line_poses(start, start), chain.home + 1.0) is None


@pytest.mark.parametrize("metres", [0.5, 0.05])  # steps follow from the way, or from the turn
def test_line_poses_spacing_and_shorter_way_round(metres: float) -> None:
    a = pose((0, 0, 0), quat_about((0, 0, 1), 0.1))
    b = pose((0.6 * metres, 0.8 * metres, 0), -quat_about((0, 0, 1), 1.1))
    line = line_poses(a, b)
    np.testing.assert_allclose(line[0], a, atol=1e-15)
    np.testing.assert_allclose(line[-1, :3], b[:3], atol=1e-15)
    assert angle_between(line[-1, 3:], b[3:]) < 1e-7
    assert len(line) == 1 + int(np.ceil(max(metres / LINE.step, 1.0 / LINE.turn)))
    middle = line[len(line) // 2]
    fraction = (len(line) // 2) / (len(line) - 1)
    assert angle_between(middle[3:], quat_about((0, 0, 1), 0.1 + fraction)) < 1e-7
    assert len(line_poses(a, a)) == 2


def test_reach_ball_contains_every_tool_position(chain: Chain) -> None:
    points = fk_batch(chain, random_joints(chain, 2000))[:, :3]
    assert (np.linalg.norm(points - chain.reach[:3], axis=1) <= chain.reach[3]).all()


def test_limit_margin() -> None:
    chain = CHAINS["six"]
    middle = 0.5 * (chain.lower + chain.upper)
    np.testing.assert_allclose(
        limit_margin(chain, np.stack([middle, chain.lower])), [1.0, 0.0], atol=1e-12
    )


def test_wrong_hand_is_refused() -> None:
    arm = six_arm()
    with pytest.raises(ValueError, match="six"):
        chain_of(arm.__class__(**{**vars(arm), "hand": "link4"}))


def test_giving_up_early_loses_little_and_finds_nothing_else(chain: Chain) -> None:
    targets = fk_batch(chain, random_joints(chain, 300, seed=3))
    q, ok = ik_many(chain, targets, chain.home[None], IkBudget(restarts=60, give_up_after=None))
    early, found = ik_many(chain, targets, chain.home[None], IkBudget(restarts=60, give_up_after=4))
    assert not (found & ~ok).any()
    np.testing.assert_array_equal(early[found], q[found])
    assert 0.9 * ok.sum() <= found.sum() < ok.sum()
