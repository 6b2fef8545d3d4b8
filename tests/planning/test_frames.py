"""The three forward kinematics of the project against pinocchio, on every robot."""

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]
import pytest

from pipeline.data.names import SIDES
from pipeline.planning.collision_kernels import place_frames
from pipeline.planning.collision_pieces import frames_of
from pipeline.planning.kinematics import chain_of, fk, z_onto
from pipeline.poses import compose, from_matrix, quat_to_matrix
from pipeline.world.robots import MODELS, get_embodiment
from pipeline.world.robots.contract import arm_poses, jaw_positions
from tests.planning.arms import pin_model


@pytest.mark.parametrize("axis", [(0, 0, 1), (0, 1, 0), (0, -1, 0), (1, 0, 0), (0.3, -0.9, 0.2)])
def test_a_joint_axis_becomes_the_z_axis_of_a_rotation(axis: tuple[float, float, float]) -> None:
    m = z_onto(np.array(axis, float))[:3, :3]
    np.testing.assert_allclose(m @ [0, 0, 1], np.array(axis) / np.linalg.norm(axis), atol=1e-15)
    np.testing.assert_allclose(m @ m.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(m) == pytest.approx(1.0)


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("name", sorted(MODELS))
def test_tcp_collision_frames_and_link_poses_agree_with_pinocchio(name: str, side: str) -> None:
    arm = get_embodiment(name).arms[side]
    model, tcp = pin_model(arm)
    data = model.createData()
    chain = chain_of(arm)
    frames, placed = frames_of([("", arm)])
    out = np.empty((len(frames.names) + 1, 12))
    for q in np.random.default_rng(0).uniform(chain.lower, chain.upper, (10, len(chain.home))):
        jaws = jaw_positions(arm.gripper, 0.4)
        positions = dict(zip((*arm.arm_joints, *arm.gripper.joints), (*q, *jaws), strict=True))
        full = np.zeros(model.nq)
        for joint, value in positions.items():
            full[model.joints[model.getJointId(joint)].idx_q] = value
        pin.framesForwardKinematics(model, data, full)
        want = data.oMf[tcp]
        np.testing.assert_allclose(fk(chain, q)[:3], want.translation, atol=1e-9)
        np.testing.assert_allclose(quat_to_matrix(fk(chain, q)[3:]), want.rotation, atol=1e-9)
        links = arm_poses(arm, q, 0.4)
        place_frames(
            frames.parent,
            frames.origin,
            frames.prismatic,
            np.array([[positions[n] for n in frames.names]]),
            0,
            out,
        )
        for joint in arm.joints:
            if joint.kind == "fixed":
                continue
            moved = data.oMi[model.getJointId(joint.name)]
            index, at = placed[joint.child]
            transform = np.vstack(
                [np.column_stack([out[index, :9].reshape(3, 3), out[index, 9:]]), [0, 0, 0, 1]]
            )
            for got in (compose(from_matrix(transform), at), links[joint.child]):
                np.testing.assert_allclose(got[:3], moved.translation, atol=1e-9)
                np.testing.assert_allclose(quat_to_matrix(got[3:]), moved.rotation, atol=1e-9)
