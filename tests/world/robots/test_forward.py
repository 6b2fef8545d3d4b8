"""Forward kinematics of the specs against tables that were written down by other people in other
conventions."""

import numpy as np
import pytest

from pipeline.poses import compose, inverse, matrix
from pipeline.world.robots import MODELS, get_embodiment
from pipeline.world.robots.contract import Arm, arm_poses
from tests.world.robots.both_arms import tcp_pose
from tests.world.robots.limits import arm_limits

DEG = np.pi / 180


def rot(axis: str, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    m = np.eye(4)
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    m[i, i] = m[j, j] = c
    m[i, j], m[j, i] = -s, s
    return m


def shift(x: float, y: float, z: float) -> np.ndarray:
    m = np.eye(4)
    m[:3, 3] = x, y, z
    return m


def modified_dh(rows, q) -> np.ndarray:
    """Craig: Rx(alpha) Tx(a) Rz(theta) Tz(d) per row (a, alpha, d, theta offset)."""
    m = np.eye(4)
    for (a, alpha, d, offset), angle in zip(rows, q, strict=True):
        m = m @ rot("x", alpha) @ shift(a, 0, 0) @ rot("z", angle + offset) @ shift(0, 0, d)
    return m


def standard_dh(rows, q) -> np.ndarray:
    """Denavit-Hartenberg: Rz(theta) Tz(d) Tx(a) Rx(alpha) per row (a, d, alpha)."""
    m = np.eye(4)
    for (a, d, alpha), angle in zip(rows, q, strict=True):
        m = m @ rot("z", angle) @ shift(0, 0, d) @ shift(a, 0, 0) @ rot("x", alpha)
    return m


def chained(rows, q) -> np.ndarray:
    """URDF: T(xyz) Rz Ry Rx R(axis, q) per row (xyz, rpy, axis)."""
    m = np.eye(4)
    for (xyz, (r, p, y), axis), angle in zip(rows, q, strict=True):
        m = m @ shift(*xyz) @ rot("z", y) @ rot("y", p) @ rot("x", r) @ rot(axis, angle)
    return m


def configurations(arm: Arm, n: int = 50) -> np.ndarray:
    return np.random.default_rng(7).uniform(*arm_limits(arm).T, (n, len(arm.arm_joints)))


def in_base(arm: Arm, q: np.ndarray, link: str) -> np.ndarray:
    return matrix(compose(inverse(arm.base), arm_poses(arm, q)[link]))


def errors(found: np.ndarray, expected: np.ndarray) -> tuple[float, float]:
    """Position error (m) and rotation error (rad)."""
    turn = found[:3, :3].T @ expected[:3, :3]
    return float(np.linalg.norm(found[:3, 3] - expected[:3, 3])), float(
        np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1))
    )


def test_panda_flange_is_frankas_modified_dh():
    h = np.pi / 2
    rows = [
        (0, 0, 0.333, 0),
        (0, -h, 0, 0),
        (0, h, 0.316, 0),
        (0.0825, h, 0, 0),
        (-0.0825, -h, 0.384, 0),
        (0, h, 0, 0),
        (0.088, h, 0, 0),
    ]
    arm = get_embodiment("panda").arms["left"]
    for q in configurations(arm):
        np.testing.assert_allclose(
            in_base(arm, q, "panda_link8"), modified_dh(rows, q) @ shift(0, 0, 0.107), atol=1e-6
        )


def test_ur5_flange_is_urs_standard_dh_on_a_base_turned_by_pi():
    h = np.pi / 2
    rows = [
        (0, 0.089159, h),
        (-0.425, 0, 0),
        (-0.39225, 0, 0),
        (0, 0.10915, h),
        (0, 0.09465, -h),
        (0, 0.0823, 0),
    ]
    arm = get_embodiment("ur5").arms["left"]
    flange_in_ee = rot("z", -h) @ rot("x", -h)  # `tool0` as seen from `ee_link`
    for q in configurations(arm):
        np.testing.assert_allclose(
            in_base(arm, q, "ee_link") @ flange_in_ee,
            rot("z", np.pi) @ standard_dh(rows, q),
            atol=1e-6,
        )


def test_piper_is_piper_sdks_modified_dh_but_for_the_cad_term():
    table = [
        (0, 0, 123, 0),
        (0, -90, 0, -174.22),
        (285.03, 0, 0, -100.78),
        (-21.98, 90, 250.75, 0),
        (0, -90, 0, 0),
        (0, 90, 91, 0),
    ]
    rows = [(a / 1000, alpha * DEG, d / 1000, offset * DEG) for a, alpha, d, offset in table]
    arm = get_embodiment("piper").arms["left"]
    found = np.array(
        [errors(in_base(arm, q, "link6"), modified_dh(rows, q)) for q in configurations(arm)]
    )
    assert found[:, 0].max() < 1.45e-3
    assert found[:, 0].min() > 1.39e-3, "the CAD term of joint6 is part of the spec"
    assert found[:, 1].max() < 0.003 * DEG


VENDOR_X5 = [
    ((0, 0, 0.0603), (0, 0, 0), "z"),
    ((0.02, 0, 0.0402), (0, 0, 0), "y"),
    ((-0.264, 0, 0), (np.pi, 0, 0), "y"),
    ((0.245, 0, -0.056), (0, 0, 0), "y"),
    ((0.06575, -0.001, -0.0825), (0, 0, 0), "z"),
    ((0.02845, 0, 0.0825), (-np.pi, 0, 0), "x"),
]


def test_arx_x5_is_the_vendors_x5_to_3_mm():
    arm = get_embodiment("arx").arms["left"]
    found = np.array(
        [errors(in_base(arm, q, "link6"), chained(VENDOR_X5, q)) for q in configurations(arm)]
    )
    assert 2e-3 < found[:, 0].mean() < 2.9e-3
    assert found[:, 0].max() < 3.01e-3
    assert found[:, 1].max() < 0.002 * DEG


def test_aloha_front_arms_are_close_relatives_of_the_x5():
    aloha, arx = get_embodiment("aloha").arms, get_embodiment("arx").arms["right"]
    found = np.array(
        [
            errors(in_base(aloha["left"], q, "link6"), in_base(arx, q, "link6"))
            for q in configurations(arx)
        ]
    )
    assert 5e-3 < found[:, 0].mean() < 11e-3
    assert found[:, 0].max() < 15e-3
    for q in configurations(arx, 5):
        np.testing.assert_allclose(
            in_base(aloha["left"], q, "link6"), in_base(aloha["right"], q, "link6"), atol=1e-12
        )


def test_aloha_bases_stand_where_the_footprint_chain_puts_them():
    root = shift(0, -0.65, 0) @ rot("z", np.pi / 2)
    for side, xyz, yaw in (
        ("left", (0.2305, 0.297, 0.782), 0.02),
        ("right", (0.2315, -0.3063, 0.781), 0.01),
    ):
        expected = root @ shift(*xyz) @ rot("z", yaw)
        np.testing.assert_allclose(
            matrix(get_embodiment("aloha").arms[side].base), expected, atol=1e-12
        )


@pytest.mark.parametrize("name", MODELS)
def test_the_tool_lies_between_the_fingers(name):
    for arm in get_embodiment(name).arms.values():
        tcp = tcp_pose(arm, np.array(arm.home))
        for value in (0.0, 1.0):
            poses = arm_poses(arm, np.array(arm.home), value)
            local = [
                np.concatenate(
                    [
                        (matrix(compose(inverse(tcp), poses[f])) @ np.c_[p, np.ones(len(p))].T).T[
                            :, :3
                        ]
                        for p in points
                    ]
                )
                for f, points in (
                    (link.name, [c.support_points() for c in link.collision]) for link in arm.links
                )
                if f in arm.gripper.fingers
            ]
            near = [points[np.abs(points[:, 0]) < 0.06] for points in local]
            ends = [points[:, 0].max() for points in local]
            assert all(0.005 < end < 0.025 for end in ends), ends
            (low, high) = sorted(near, key=lambda points: points[:, 1].mean())
            gap = high[:, 1].min() - low[:, 1].max()
            assert gap == pytest.approx(value * arm.gripper.opening, abs=1e-4)
            assert (high[:, 1].min() + low[:, 1].max()) / 2 == pytest.approx(0.0, abs=1e-4)
