"""Poses against scipy's rotations and against homogeneous matrices."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pipeline import poses

numbers = st.floats(-3, 3)
vectors = st.tuples(numbers, numbers, numbers).map(np.array)
quaternions = (
    st.tuples(numbers, numbers, numbers, numbers)
    .map(np.array)
    .filter(lambda q: np.linalg.norm(q) > 0.1)
    .map(lambda q: q / np.linalg.norm(q))
)
any_pose = st.builds(poses.pose, vectors, quaternions)


def scipy(q):
    return Rotation.from_quat(np.asarray(q), scalar_first=True)


def same_rotation(a, b):
    return abs(float(np.dot(a, b))) == pytest.approx(1.0, abs=1e-9)


@given(quaternions, quaternions, vectors)
def test_quaternion_products_and_rotations_agree_with_scipy(a, b, v):
    assert same_rotation(
        poses.quat_multiply(a, b), (scipy(a) * scipy(b)).as_quat(scalar_first=True)
    )
    np.testing.assert_allclose(poses.quat_rotate(a, v), scipy(a).apply(v), atol=1e-12)
    np.testing.assert_allclose(poses.quat_to_matrix(a), scipy(a).as_matrix(), atol=1e-12)
    assert poses.angle_between(a, b) == pytest.approx(
        (scipy(a).inv() * scipy(b)).magnitude(), abs=1e-6
    )


@given(quaternions)
def test_a_matrix_gives_its_quaternion_back_with_positive_w(q):
    back = poses.quat_from_matrix(scipy(q).as_matrix())
    assert back[0] >= 0
    assert same_rotation(back, q)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_half_turns_about_each_axis_come_back_from_their_matrix(axis):
    unit = np.eye(3)[axis]
    back = poses.quat_from_matrix(2 * np.outer(unit, unit) - np.eye(3))
    np.testing.assert_allclose(np.abs(back), [0, *unit], atol=1e-12)


@given(vectors.filter(lambda v: np.linalg.norm(v) > 0.1), st.floats(-6, 6), vectors)
def test_axis_angle_and_roll_pitch_yaw_agree_with_scipy(axis, angle, rpy):
    about = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis))
    assert same_rotation(poses.quat_about(axis, angle), about.as_quat(scalar_first=True))
    assert same_rotation(
        poses.quat_from_rpy(*rpy), Rotation.from_euler("xyz", rpy).as_quat(scalar_first=True)
    )


@given(any_pose, any_pose, vectors)
def test_composition_is_the_product_of_homogeneous_matrices(a, b, point):
    product = poses.matrix(a) @ poses.matrix(b)
    np.testing.assert_allclose(poses.matrix(poses.compose(a, b)), product, atol=1e-12)
    np.testing.assert_allclose(
        poses.transform(a, point), (poses.matrix(a) @ [*point, 1])[:3], atol=1e-12
    )
    np.testing.assert_allclose(
        poses.matrix(poses.inverse(a)), np.linalg.inv(poses.matrix(a)), atol=1e-12
    )
    np.testing.assert_allclose(poses.matrix(poses.from_matrix(product)), product, atol=1e-9)


def test_functions_broadcast_over_leading_dimensions():
    rng = np.random.default_rng(0)
    a = np.stack([poses.pose(rng.normal(size=3), rng.normal(size=4)) for _ in range(6)]).reshape(
        2, 3, 7
    )
    b = poses.yawed((0.1, 0.2, 0.3), 0.4)
    for index in np.ndindex(2, 3):
        np.testing.assert_allclose(
            poses.compose(a, b)[index], poses.compose(a[index], b), atol=1e-15
        )
        np.testing.assert_allclose(poses.inverse(a)[index], poses.inverse(a[index]), atol=1e-15)
        np.testing.assert_allclose(poses.matrix(a)[index], poses.matrix(a[index]), atol=1e-15)


@given(vectors, vectors, vectors)
def test_a_frame_has_its_x_axis_where_it_was_asked_for(position, x, y):
    if (
        np.linalg.norm(np.cross(x, y)) < 0.1 * np.linalg.norm(x) * np.linalg.norm(y)
        or np.linalg.norm(x) * np.linalg.norm(y) < 0.1
    ):
        return
    m = poses.matrix(poses.frame(position, x, y))
    np.testing.assert_allclose(m[:3, 0], x / np.linalg.norm(x), atol=1e-9)
    assert m[:3, 1] @ y > 0
    np.testing.assert_allclose(m[:3, :3] @ m[:3, :3].T, np.eye(3), atol=1e-9)
    assert np.linalg.det(m[:3, :3]) == pytest.approx(1)
    assert abs(m[:3, 2] @ y) < 1e-9 * np.linalg.norm(y) + 1e-9


def test_a_pose_normalises_its_quaternion_and_the_identity_cannot_be_changed():
    np.testing.assert_allclose(poses.pose((1, 2, 3), (0, 0, 0, 5)), [1, 2, 3, 0, 0, 0, 1])
    with pytest.raises(ValueError, match="read-only"):
        poses.IDENTITY[0] = 1.0
