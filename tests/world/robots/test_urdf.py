import numpy as np
import pinocchio as pin
import pytest
import sapien
from hypothesis import given
from hypothesis import strategies as st

from pipeline.data.names import SIDES
from pipeline.intake.robots.write import arm_urdf, rpy_from_quat
from pipeline.poses import matrix, quat_from_rpy, quat_to_matrix
from pipeline.world.robots import MODELS, get_embodiment
from pipeline.world.robots.contract import Arm, arm_poses
from tests.world.robots.both_arms import embodiment_urdf
from tests.world.robots.limits import arm_limits

angles = st.floats(-np.pi, np.pi)


@given(angles, angles, angles)
def test_rpy_is_the_inverse_of_quat_from_rpy(roll, pitch, yaw):
    q = quat_from_rpy(roll, pitch, yaw)
    np.testing.assert_allclose(
        quat_to_matrix(quat_from_rpy(*rpy_from_quat(q))), quat_to_matrix(q), atol=1e-7
    )


def random_q(arm: Arm, rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(*arm_limits(arm).T)


@pytest.mark.parametrize("name", MODELS)
def test_pinocchio_agrees_with_forward_kinematics(name):
    e = get_embodiment(name)
    model = pin.buildModelFromXML(embodiment_urdf(e))
    data = model.createData()
    rng = np.random.default_rng(1)
    assert model.nq == sum(len(a.arm_joints) + 2 for a in e.arms.values())
    for _ in range(5):
        qs = {side: random_q(e.arms[side], rng) for side in SIDES}
        value = float(rng.uniform())
        q = np.zeros(model.nq)
        for side in SIDES:
            arm = e.arms[side]
            jaws = np.array(arm.gripper.closed) + value * (
                np.array(arm.gripper.opened) - np.array(arm.gripper.closed)
            )
            for joint, position in zip(
                (*arm.arm_joints, *arm.gripper.joints), (*qs[side], *jaws), strict=True
            ):
                q[model.joints[model.getJointId(f"{side}_{joint}")].idx_q] = position
        pin.framesForwardKinematics(model, data, q)
        for side in SIDES:
            for link, p in arm_poses(e.arms[side], qs[side], value).items():
                found = data.oMf[model.getFrameId(f"{side}_{link}")].homogeneous
                np.testing.assert_allclose(found, matrix(p), atol=1e-9)


@pytest.mark.parametrize("name", MODELS)
def test_sapien_agrees_with_forward_kinematics(name, tmp_path):
    e = get_embodiment(name)
    path = tmp_path / "robot.urdf"
    path.write_text(embodiment_urdf(e))
    scene = sapien.Scene([sapien.physx.PhysxCpuSystem()])
    loader = scene.create_urdf_loader()
    loader.fix_root_link = True
    robot = loader.load(str(path))
    names = [j.name for j in robot.active_joints]
    rng = np.random.default_rng(2)
    for _ in range(3):
        qs = {side: random_q(e.arms[side], rng) for side in SIDES}
        q = np.zeros(len(names), np.float32)
        for side in SIDES:
            arm = e.arms[side]
            for joint, position in zip(
                (*arm.arm_joints, *arm.gripper.joints),
                (*qs[side], *arm.gripper.opened),
                strict=True,
            ):
                q[names.index(f"{side}_{joint}")] = position
        robot.set_qpos(q)
        found = {link.name: link.entity_pose for link in robot.links}
        for side in SIDES:
            for link, p in arm_poses(e.arms[side], qs[side]).items():
                np.testing.assert_allclose(found[f"{side}_{link}"].p, p[:3], atol=3e-6)
                assert abs(np.dot(found[f"{side}_{link}"].q, p[3:])) > 1 - 1e-6


@pytest.mark.parametrize("name", MODELS)
def test_urdf_carries_masses_limits_and_prefix(name):
    arm = get_embodiment(name).arms["left"]
    model = pin.buildModelFromXML(arm_urdf(arm, "x_"))
    moving = {j.name: j for j in arm.joints if j.kind != "fixed"}
    assert {n for n in model.names if n != "universe"} == {f"x_{n}" for n in moving}
    for joint in moving.values():
        i = model.joints[model.getJointId(f"x_{joint.name}")].idx_q
        limits = (
            model.lowerPositionLimit[i],
            model.upperPositionLimit[i],
            model.velocityLimit[i],
            model.effortLimit[i],
        )
        np.testing.assert_allclose(limits, (joint.lower, joint.upper, joint.velocity, joint.effort))
    # pinocchio keeps the fixed root's mass on the universe, which is the first entry
    assert sum(inertia.mass for inertia in model.inertias) == pytest.approx(
        sum(link.mass for link in arm.links)
    )
