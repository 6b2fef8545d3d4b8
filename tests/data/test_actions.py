"""Representations of actions: round trips, rotations against SciPy, continuity, padding."""

from dataclasses import dataclass
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from pipeline.data.actions import (
    ACTIONS,
    FRAMES,
    ROTATIONS,
    ActionCodec,
    Representation,
    continuous_signs,
    quaternions_of,
    rotations_of,
)
from pipeline.data.chains import read_chains
from pipeline.poses import compose, inverse

ARMS = read_chains("aloha-agilex", raised=0.02)
NAMES = tuple(
    f"{side}_{name}" for side in ("left", "right") for name in (*ARMS["left"].joints, "gripper")
)
seeds = st.integers(0, 2**32 - 1)
few = settings(max_examples=10, deadline=None)


def quaternions(seed, count=20):
    rng = np.random.default_rng(seed)
    q = rng.normal(size=(count, 4))
    q[: count // 4, 1:] *= 10.0 ** rng.uniform(-14, 0, (count // 4, 1))  # near no rotation
    q[-count // 4 :, 0] *= 1e-9  # near half a turn
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def as_scipy(q):
    return Rotation.from_quat(q, scalar_first=True)


def apart(a, b):
    """The largest angle (rad) between two lists of quaternions, to first order."""
    return 2 * np.abs(compose(inverse(posed(a)), posed(b))[:, 4:]).max()


def posed(q):
    return np.hstack([np.zeros((len(q), 3)), q])


@settings(max_examples=40, deadline=None)
@given(seeds)
def test_rotations_are_those_of_scipy_and_come_back(seed):
    q = quaternions(seed)
    for name, numbers in ROTATIONS.items():
        values = rotations_of(q, name)
        assert values.shape == (len(q), len(numbers))
        assert apart(quaternions_of(values, name), q) < 1e-9
    matrix = as_scipy(q).as_matrix()
    assert np.allclose(
        rotations_of(q, "6d"), np.hstack([matrix[..., 0], matrix[..., 1]]), atol=1e-9
    )
    vectors = rotations_of(q, "axis-angle")
    assert np.linalg.norm(vectors, axis=1).max() <= np.pi + 1e-12
    assert apart(Rotation.from_rotvec(vectors).as_quat(scalar_first=True), q) < 1e-9


@settings(max_examples=40, deadline=None)
@given(seeds)
def test_6d_is_continuous_and_quaternions_follow(seed):
    two = as_scipy(quaternions(seed, 4)[:2])
    path = Slerp([0, 1], two)(np.linspace(0, 1, 400))
    q = path.as_quat(scalar_first=True, canonical=True)  # its signs jump
    step = (path[1:] * path[:-1].inv()).magnitude().max()
    assert np.abs(np.diff(rotations_of(q, "6d"), axis=0)).max() <= step + 1e-9
    followed = continuous_signs(q)
    assert followed[0, 0] >= 0
    assert np.abs(np.diff(followed, axis=0)).max() <= step
    assert (continuous_signs(q, along_time=False)[:, 0] >= 0).all()


@settings(max_examples=40, deadline=None)
@given(seeds)
def test_6d_of_a_network_is_made_orthonormal(seed):
    rng = np.random.default_rng(seed)
    values = rng.normal(size=(10, 6)) + 0.1
    q = quaternions_of(values, "6d")
    matrix = as_scipy(q).as_matrix()
    x = values[:, :3] / np.linalg.norm(values[:, :3], axis=1, keepdims=True)
    assert np.allclose(matrix[..., 0], x)
    assert (np.sum(matrix[..., 1] * values[:, 3:], 1) > 0).all()


@pytest.mark.parametrize(
    ("rotation", "values"), [("quaternion", np.zeros(4)), ("6d", np.array([1.0, 0, 0, 2, 0, 0]))]
)
def test_a_rotation_without_direction_is_refused(rotation, values):
    with pytest.raises(ValueError, match="length zero"):
        quaternions_of(values, rotation)


def episode(seed, frames=12):
    rng = np.random.default_rng(seed)
    commanded = 0.8 * np.cumsum(rng.normal(size=(frames, len(NAMES))) * 0.1, 0) + 0.3
    measured = commanded + rng.normal(size=commanded.shape) * 0.01
    return commanded, measured


@pytest.mark.parametrize(
    "representation", [Representation(*words) for words in product(ACTIONS, ROTATIONS, FRAMES)]
)
@few
@given(seed=seeds)
def test_actions_come_back(representation, seed):
    """One chunk against one state, as a policy answers."""
    commanded, measured = episode(seed)
    codec = ActionCodec(representation, NAMES, ARMS)
    state, before = measured[0], commanded[0] - 0.02
    against = {
        "absolute": commanded,
        "relative": np.broadcast_to(state, commanded.shape),
        "delta": np.vstack([before, commanded[:-1]]),
    }[representation.reference]
    actions = codec.encode(commanded, against)
    assert actions.shape == (len(commanded), len(codec.names))
    if not representation.poses:
        assert np.allclose(codec.decode_joints(actions, state, before), commanded, atol=1e-9)
        return
    poses, grippers = codec.decode_tools(actions, state, before)
    wanted, values = codec.tools(commanded)
    for side in range(2):
        assert np.abs(poses[:, side, :3] - wanted[:, side, :3]).max() < 1e-9
        assert apart(poses[:, side, 3:], wanted[:, side, 3:]) < 1e-9
    assert np.array_equal(grippers, values)


def test_the_rows_of_an_episode_against_their_references():
    commanded, measured = episode(1)
    for reference, against in (
        ("relative", measured),
        ("delta", np.vstack([measured[:1], commanded[:-1]])),
    ):
        codec = ActionCodec(Representation(f"joints-{reference}"), NAMES)
        rows = codec.encode(commanded, codec.references(commanded, measured))
        grippers = [i for i, name in enumerate(NAMES) if name.endswith("gripper")]
        others = [i for i in range(len(NAMES)) if i not in grippers]
        assert np.array_equal(rows[:, grippers], commanded[:, grippers])
        assert np.array_equal(rows[:, others], (commanded - against)[:, others])


def test_relative_poses_do_not_depend_on_the_frame_and_absolute_ones_are_of_the_base():
    commanded, measured = episode(2)
    rows = {}
    for actions, frame in product(("ee", "ee-relative"), FRAMES):
        codec = ActionCodec(Representation(actions, "quaternion", frame), NAMES, ARMS)
        rows[actions, frame] = codec.encode(commanded, codec.references(commanded, measured))
    assert np.array_equal(rows["ee-relative", "world"], rows["ee-relative", "base"])
    left = rows["ee", "base"][:, :7]
    back = compose(ARMS["left"].base, left)
    assert np.allclose(back[:, :3], rows["ee", "world"][:, :3], atol=1e-12)
    names = Representation("ee").names(NAMES)
    assert names[:4] == ("left_x", "left_y", "left_z", "left_qw")


def test_unknown_words_are_refused():
    with pytest.raises(ValueError, match="rotation 'euler'"):
        Representation("ee", "euler")


@dataclass
class Fixed:
    base: np.ndarray

    def poses(self, q):
        return np.broadcast_to(self.base, (len(q), 7))


def test_delta_poses_add_up():
    """Steps of 1 cm along the tool's own x axis, turned by a quarter around world z."""
    turned = np.array([0.0, 0, 0, np.sqrt(0.5), 0, 0, np.sqrt(0.5)])
    codec = ActionCodec(
        Representation("ee-delta", "axis-angle"),
        ("left_joint1", "left_gripper"),
        {"left": Fixed(turned)},
    )
    actions = np.tile([0.01, 0, 0, 0, 0, 0, 1.0], (3, 1))
    poses, _ = codec.decode_tools(actions, np.zeros(2), np.zeros(2))
    assert np.allclose(poses[:, 0, :3], [[0, 0.01, 0], [0, 0.02, 0], [0, 0.03, 0]])
