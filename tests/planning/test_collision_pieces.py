"""The first contact of a moving body with recorded ones, against coal."""

import numpy as np
import pytest

from pipeline.planning.collision_pieces import Sweep, bounding_ball, pieces_of
from pipeline.poses import IDENTITY, Pose, pose, transform
from pipeline.world.shapes import Collider
from tests.planning.oracle import coal_distance, random_collider

KINDS = ("box", "sphere", "cylinder", "capsule", "convex")
MARGIN = 0.002


def passing_poses(rng: np.random.Generator, count: int) -> np.ndarray:
    """Poses (count,7) that turn on the way along a line near the origin."""
    start, goal = (np.append(rng.uniform(-0.05, 0.05, 2), z) for z in (0.5, -0.1))
    turns = rng.normal(size=4) + np.linspace(0, 1, count)[:, None] * rng.normal(size=4)
    return np.stack(
        [
            pose(start + s * (goal - start), turn)
            for s, turn in zip(np.linspace(0, 1, count), turns, strict=True)
        ]
    )


def first_by_coal(
    pieces: list[tuple[int, Collider]], poses: np.ndarray, own: list[Collider], at: np.ndarray
) -> tuple[int | None, float]:
    """First row within the margin, and the smallest difference of a distance up to that row from
    the margin."""
    closest = 9.0
    for row, here in enumerate(at):
        distance = min(coal_distance(c, poses[row, i], o, here) for i, c in pieces for o in own)
        closest = min(closest, abs(distance - MARGIN))
        if distance <= MARGIN:
            return row, closest
    return None, closest


@pytest.mark.parametrize("seed", range(12))
def test_the_first_contact_is_the_one_coal_finds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pieces = [(int(rng.integers(2)), random_collider(rng, kind)) for kind in KINDS]
    own = [random_collider(rng, str(kind)) for kind in rng.choice(KINDS, 2)]
    poses = np.stack([passing_poses(rng, 30) * [1, 1, 0.3, 1, 1, 1, 1] for _ in range(2)], axis=1)
    sweep = Sweep(pieces, poses, own, MARGIN)
    touched = []
    for _ in range(3):
        at = passing_poses(rng, 30) + np.append(rng.uniform(-0.25, 0.25, 3), np.zeros(4))
        want, closest = first_by_coal(pieces, poses, own, at)
        if closest > 1e-5:
            assert sweep.first_contact(at) == want
            touched.append(want)
    assert touched


@pytest.mark.parametrize(("gap", "contact"), [(0.0019, 0), (0.0021, None)])
def test_the_margin_counts_as_contact(gap: float, contact: int | None) -> None:
    cube = Collider("box", (0.05, 0.05, 0.05))
    sweep = Sweep([(0, cube)], IDENTITY[None, None], [cube], MARGIN)
    assert sweep.first_contact(pose((0.1 + gap, 0, 0))[None]) == contact


def test_poses_must_match_the_recorded_ones_in_number() -> None:
    cube = Collider("box", (0.05, 0.05, 0.05))
    sweep = Sweep([(0, cube)], np.tile(IDENTITY, (4, 1, 1)), [cube], MARGIN)
    with pytest.raises(ValueError, match="3 poses of a body, 4 recorded ones"):
        sweep.first_contact(np.tile(IDENTITY, (3, 1)))


def corners_of(c: Collider, at: Pose) -> np.ndarray:
    return transform(at, c.support_points())


def test_the_bounding_ball_holds_every_piece() -> None:
    rng = np.random.default_rng(5)
    for _ in range(20):
        colliders = [random_collider(rng, str(kind)) for kind in rng.choice(["box", "convex"], 3)]
        ball = bounding_ball(pieces_of([(0, 0, c, IDENTITY) for c in colliders]))
        points = np.concatenate([corners_of(c, IDENTITY) for c in colliders])
        assert (np.linalg.norm(points - ball[:3], axis=1) <= ball[3] + 1e-12).all()
        assert ball[3] < 3 * np.ptp(points, axis=0).max()
