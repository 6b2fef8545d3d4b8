"""The way of a tool: its length, when it is a detour, and how much of it is out of view."""

import numpy as np
import pytest

from pipeline.planning.budgets import DETOURS
from pipeline.planning.collision import Carried
from pipeline.planning.kinematics import chain_of, fk, fk_batch
from pipeline.planning.path import dense
from pipeline.planning.planner import unseen_length
from pipeline.poses import pose
from pipeline.world.robots import get_embodiment

ARM = get_embodiment("aloha").arms["left"]


def way(points: list[tuple[float, float, float]]) -> np.ndarray:
    return np.array([pose(point) for point in points])


def test_the_way_passes_through_its_waypoints():
    chain, home = chain_of(ARM), np.array(ARM.home, float)
    turned = home + np.array([0.7, *[0.0] * (len(home) - 1)])
    found = fk_batch(chain, dense(np.stack([home, turned]), DETOURS.resolution))
    np.testing.assert_allclose(found[[0, -1]], [fk(chain, home), fk(chain, turned)], atol=1e-9)
    # the first joint turns about an axis: the tool moves on an arc
    straight = float(np.linalg.norm(found[-1, :3] - found[0, :3]))
    arc = straight * 0.35 / np.sin(0.35)
    length = np.linalg.norm(np.diff(found[:, :3], axis=0), axis=1).sum()
    assert straight < length == pytest.approx(arc, rel=2e-3)


def test_only_what_leaves_the_view_on_the_way_counts():
    piece = type("Piece", (), {"pose": pose((0, 0, 0.1))})
    carried = Carried("left", (piece,), pose((0, 0, 0)))  # pyright: ignore[reportArgumentType]
    path = way([(0, 0, 0), (0.1, 0, 0), (0.3, 0, 0), (0.6, 0, 0), (1.0, 0, 0)])
    hidden = unseen_length(path, carried, lambda p: (p[:, 0] < 0.2) | (p[:, 0] > 0.9))
    # the steps that end at .3 and .6 m
    assert hidden == pytest.approx(0.5)
    assert unseen_length(path, carried, lambda p: p[:, 0] > 0.2) == 0.0
    # what is seen is the middle of the body, not the tool
    assert unseen_length(path, carried, lambda p: p[:, 2] > 0.05) == 0.0
