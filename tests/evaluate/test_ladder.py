"""The sanity ladder: what networks see, what they learn, and a small one end to end."""

import json

import numpy as np
import pytest

from pipeline.data.recipe import Cell, Recipe
from pipeline.evaluate.evaluate import inline
from pipeline.evaluate.ladder.demonstrations import Demonstration
from pipeline.evaluate.ladder.features import State, chunks, features, target_first
from pipeline.evaluate.ladder.network import Network, Settings, train
from pipeline.evaluate.policies import make_policy, policy_name
from pipeline.evaluate.policy import PolicyError
from pipeline.run.ladder import Ladder, climb, samples, summary, table

RNG = np.random.default_rng(0)


def state(frames=4, bodies=2):
    poses = RNG.normal(size=(frames, bodies, 7))
    poses[..., 3:] /= np.linalg.norm(poses[..., 3:], axis=-1, keepdims=True)
    return State(RNG.normal(size=(frames, 14)), RNG.normal(size=(frames, 2, 3)), poses, RNG.normal(size=(frames, 3)))


def test_only_the_upper_rungs_can_see_velocity():
    s = state()
    other = State(s.joints, s.tools, s.poses, -s.velocity)
    assert (features(s, "position") == features(other, "position")).all()
    assert (features(s, "velocity")[:, -3:] == s.velocity).all()
    now, two = features(s, "position"), features(s, "two_frames", back=2)
    np.testing.assert_array_equal(two[:, : now.shape[1]], now)
    np.testing.assert_array_equal(two[:, now.shape[1] :], now[[0, 0, 0, 1]])
    assert now.shape == (4, 14 + 2 * 2 * 3 + 2 * 9)


def test_what_is_learnt_are_the_next_actions_as_differences():
    joints, actions = np.arange(12.0).reshape(4, 3), np.arange(12.0).reshape(4, 3) + 100
    found = chunks(joints, actions, 2, grippers=[2])
    assert found.shape == (3, 2, 3)
    np.testing.assert_array_equal(found[0], [[100, 100, 102], [103, 103, 105]])
    # after the end the last action that was executed stands
    np.testing.assert_array_equal(found[2, 1], actions[2] - [6, 7, 0])


def test_the_target_comes_first():
    assert target_first(("pot", "bin", "can"), "can") == [2, 1, 0]


def test_a_network_learns_and_is_the_same_when_read_again(tmp_path):
    x = RNG.normal(size=(400, 3))
    y = np.stack([x[:, :2] * 0.1 + 5, np.zeros((400, 2))], 1)
    network = train(x, y, Settings(chunk=2, width=32, epochs=30, batch=64))
    assert np.abs(network(x) - y).mean() < 0.3 * np.abs(y - y.mean(0)).mean()
    path = tmp_path / "n.npz"
    path.write_bytes(network.to_bytes())
    np.testing.assert_array_equal(Network.read(path)(x), network(x))
    assert Network.read(path).settings == network.settings
    again = train(x, y, Settings(chunk=2, width=32, epochs=30, batch=64))
    np.testing.assert_array_equal(again(x), network(x))
    with pytest.raises(PolicyError, match="from 1 to 2"):
        make_policy(policy_name(f"ladder:{path}?execute=3"))
    path.write_bytes(b"no network")
    with pytest.raises(PolicyError, match="no network"):
        make_policy(policy_name(f"ladder:{path}"))


def test_a_demonstration_is_the_same_when_read_again(tmp_path):
    s = state()
    shown = Demonstration(
        Cell("click_bell", "aloha-agilex", 1, 0.1, "clean"), ("a", "b"), "b", s.joints, s.joints, s.tools, s.poses, s.velocity
    )
    path = tmp_path / "d.npz"
    path.write_bytes(shown.to_bytes())
    again = Demonstration.read(path)
    assert (again.cell, again.bodies, again.target) == (shown.cell, shown.bodies, shown.target)
    x, y = samples([again, shown], Settings(inputs="velocity", chunk=3))
    assert x.shape[0] == y.shape[0] == 6
    np.testing.assert_array_equal(x[:3], x[3:])


def test_seeds_are_summed_up_with_an_interval():
    row = {"task": "t", "embodiment": "e", "alpha": 0.1, "level": 1, "inputs": "position", "chunk": 8, "execute": 4}
    row |= {"demonstrations": 9, "episodes": 10}
    (found,) = summary([row | {"solved": 3}, row | {"solved": 5}])
    assert (found["success_rate"], found["episodes"], found["by_seed"]) == (40, 20, [30, 50])
    assert found["success_interval"][0] == pytest.approx(21.9, abs=0.1)  # Wilson by hand
    assert table([found]).splitlines()[-1] == "| t | position | 8 | 4 | 40 (22-61) |"


def test_a_small_ladder_end_to_end(tmp_path):
    recipe = Recipe(tasks=("click_bell",), levels=(0, 1), episodes=1)
    wanted = Ladder(recipe, ("position", "two_frames"), ((8, 4),), 1, 1, Settings(epochs=1, width=32), code="c")
    rows = climb(wanted, tmp_path, inline)
    assert [(r["level"], r["inputs"], r["episodes"], r["demonstrations"]) for r in rows] == [
        (level, kind, 1, 2) for kind in ("position", "two_frames") for level in (0, 1)
    ]
    lines = (tmp_path / "episodes.jsonl").read_text().splitlines()
    assert all(json.loads(line)["sees_truth"] for line in lines)
    times = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.npz")}
    assert len(times) == 4
    assert climb(wanted, tmp_path, inline) == rows
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.npz")} == times
    assert (tmp_path / "episodes.jsonl").read_text().splitlines() == lines
