"""Joint paths: straight lines, RRT-Connect around walls with known answers, shortcuts,
determinism."""

import numpy as np
import pytest

from pipeline.planning.budgets import PathBudget
from pipeline.planning.collision import CollisionWorld
from pipeline.planning.kinematics import chain_of, fk
from pipeline.planning.path import connect, dense, shorten, straight
from pipeline.poses import pose
from pipeline.world.robots import get_embodiment
from pipeline.world.shapes import Collider

SQUARE = (np.array([-1.0, -1.0]), np.array([1.0, 1.0]))


def wall_with_gap(q: np.ndarray) -> bool:
    """Free unless in the wall |x| < 0.1 below y = 0.6."""
    q = np.atleast_2d(q)
    return not ((np.abs(q[:, 0]) < 0.1) & (q[:, 1] < 0.6)).any()


def length(path: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def test_straight_and_dense_spacing() -> None:
    a, b = np.array([0.0, 1.0, -1.0]), np.array([0.3, 1.0, -2.0])
    rows = straight(a, b, 0.05)
    assert len(rows) == 21
    np.testing.assert_array_equal(rows[[0, -1]], [a, b])
    np.testing.assert_allclose(np.diff(rows, axis=0), np.tile((b - a) / 20, (20, 1)), atol=1e-12)
    assert straight(a, a).shape == (2, 3)
    path = dense(np.stack([a, b, a]), 0.05)
    assert len(path) == 41 and np.abs(np.diff(path, axis=0)).max() <= 0.05 + 1e-12
    np.testing.assert_array_equal(path[20], b)


def test_a_free_line_is_taken_as_it_is() -> None:
    a, b = np.array([0.5, 0.5]), np.array([0.9, -0.9])
    path = connect(wall_with_gap, a, b, np.random.default_rng(0), SQUARE)
    np.testing.assert_array_equal(path, [a, b])


@pytest.mark.parametrize("seed", range(10))
def test_around_a_wall_free_at_finer_resolution_and_nearly_shortest(seed: int) -> None:
    a, b = np.array([-0.8, -0.5]), np.array([0.8, -0.5])
    path = connect(
        wall_with_gap, a, b, np.random.default_rng(seed), SQUARE, PathBudget(resolution=0.02)
    )
    assert path is not None and len(path) >= 3
    np.testing.assert_array_equal(path[[0, -1]], [a, b])
    assert (np.abs(path) <= 1).all()
    # between two states of the final check, 0.005 apart, a corner may be clipped by no more than
    # half of that
    fine = dense(path, 0.001)
    inside = (np.abs(fine[:, 0]) < 0.1 - 0.0025) & (fine[:, 1] < 0.6 - 0.0025)
    assert not inside.any()
    shortest = 2 * np.hypot(0.7, 1.1) + 0.2
    assert length(path) < 1.15 * shortest


def test_same_generator_same_path() -> None:
    a, b = np.array([-0.8, -0.5]), np.array([0.8, -0.5])
    first, second = (
        connect(wall_with_gap, a, b, np.random.default_rng(7), SQUARE) for _ in range(2)
    )
    np.testing.assert_array_equal(first, second)


def test_no_way_and_blocked_ends() -> None:
    def closed(q: np.ndarray) -> bool:
        return not (np.abs(np.atleast_2d(q)[:, 0]) < 0.1).any()

    rng = np.random.default_rng(0)
    a, b, inside = np.array([-0.8, 0.0]), np.array([0.8, 0.0]), np.array([0.0, 0.0])
    assert connect(closed, a, b, rng, SQUARE, PathBudget(iterations=60)) is None
    assert connect(closed, a, inside, rng, SQUARE) is None
    assert connect(closed, inside, b, rng, SQUARE) is None


def test_shorten_removes_detours() -> None:
    detour = np.array([[-0.8, 0.8], [-0.9, -0.9], [-0.5, 0.9], [0.3, 0.7], [0.8, 0.8]])

    def edge(p: np.ndarray, q: np.ndarray) -> bool:
        return wall_with_gap(straight(p, q, 0.01))

    np.testing.assert_array_equal(
        shorten(detour, edge, np.random.default_rng(0), 0), detour[[0, -1]]
    )


def test_an_arm_goes_around_a_post_and_two_arms_at_once() -> None:
    e = get_embodiment("aloha-agilex")
    chains = {side: chain_of(arm) for side, arm in e.arms.items()}
    home = {side: chain.home for side, chain in chains.items()}
    # joint 1 swings the forearm from one side of a block in front of the left arm to the other
    start, goal = (np.array([turn, 0.9, 0.7, 0.0, 0.0, 0.0]) for turn in (0.5, -0.5))
    tip = fk(chains["left"], 0.5 * (start + goal))
    post = {"post": ((Collider("box", (0.02, 0.05, 0.06)),), pose((tip[0], tip[1] - 0.04, tip[2])))}
    scene = CollisionWorld(e).with_objects(post)
    free = scene.free("left", home["right"])
    assert free(start) and free(goal) and not free(straight(start, goal))
    limits = (chains["left"].lower, chains["left"].upper)
    path = connect(free, start, goal, np.random.default_rng(0), limits)
    assert path is not None and len(path) > 2
    assert free(dense(path, 0.0125))
    assert ((path >= limits[0]) & (path <= limits[1])).all()

    def both(q: np.ndarray) -> bool:
        rows = np.atleast_2d(q)
        return scene.first_blocked(rows[:, :6], rows[:, 6:]) is None

    wide = tuple(
        np.concatenate([x, y])
        for x, y in zip(limits, (chains["right"].lower, chains["right"].upper), strict=True)
    )
    a, b = np.concatenate([start, home["right"]]), np.concatenate([goal, goal])
    path = connect(both, a, b, np.random.default_rng(1), (wide[0], wide[1]))
    assert path is not None and path.shape[1] == 12
    assert both(dense(path, 0.0125))
