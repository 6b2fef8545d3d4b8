"""Two arms for planning tests: six joints like the front arm of aloha-agilex, seven like a Panda
with fixed joints between."""

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]

from pipeline.data.joints import Joint
from pipeline.planning.budgets import IK, IkBudget
from pipeline.planning.kinematics import Chain, ik_many
from pipeline.poses import IDENTITY, Pose, pose, quat_about, quat_from_rpy
from pipeline.world.robots.contract import Arm, Gripper, Link, Mount
from pipeline.world.shapes import Collider

HALF = float(np.pi / 2)
SIX = (
    ((0, 0, 0.058), (0, 0, 0), (0, 0, 1), -3.14, 2.618),
    ((0.025013, 0.00060169, 0.042), (0, 0, 0), (0, 1, 0), -0.05, 3.5),
    ((-0.26396, 0.0044548, 0), (-3.14159, 0, -0.015928), (0, 1, 0), -0.1, 3.2),
    ((0.246, -0.00025, -0.06), (0, 0, 0), (0, 1, 0), -1.6, 1.55),
    ((0.06775, 0.0015, -0.0855), (0, 0, -0.015928), (0, 0, 1), -1.57, 1.57),
    ((0.03095, 0, 0.0855), (-3.14159, 0, 0), (1, 0, 0), -2.0, 2.0),
)
SEVEN = (
    ((0, 0, 0.333), (0, 0, 0), (0, 0, 1), -2.8973, 2.8973),
    ((0, 0, 0), (-HALF, 0, 0), (0, 0, 1), -1.7628, 1.7628),
    ((0, -0.316, 0), (HALF, 0, 0), (0, 0, 1), -2.8973, 2.8973),
    ((0.0825, 0, 0), (HALF, 0, 0), (0, 0, 1), -3.0718, -0.0698),
    ((-0.0825, 0.384, 0), (-HALF, 0, 0), (0, 0, 1), -2.8973, 2.8973),
    ((0, 0, 0), (HALF, 0, 0), (0, 0, 1), -0.0175, 3.7525),
    ((0.088, 0, 0), (HALF, 0, 0), (0, 0, 1), -2.8973, 2.8973),
)
# Capsules along the links of the six-joint arm: link name, radius, half length, pose in the link.
SIX_COLLISION = {
    "base": Collider("cylinder", (0.05, 0.028), pose((0, 0, 0.03))),
    "link2": Collider("capsule", (0.03, 0.10), pose((-0.13, 0, 0), quat_about((0, 1, 0), HALF))),
    "link3": Collider("capsule", (0.03, 0.08), pose((0.12, 0, -0.06), quat_about((0, 1, 0), HALF))),
    "link6": Collider("box", (0.04, 0.03, 0.03), pose((0.04, 0, 0))),
}


def six_arm(base: Pose | None = None) -> Arm:
    """Six joints, jaws along y of link6, capsules on the long links."""
    joints = [
        Joint(
            f"joint{i + 1}", "revolute", f"link{i}" if i else "base", f"link{i + 1}", *_joint(row)
        )
        for i, row in enumerate(SIX)
    ]
    for name, child, side in (("jaw_l", "finger_l", 1.0), ("jaw_r", "finger_r", -1.0)):
        origin = pose((0.0846, 0.0245 * side, 0))
        joints.append(
            Joint(name, "prismatic", "link6", child, origin, (0, side, 0), 0.0, 0.0476, 0.3, 100)
        )
    links = ["base", *(f"link{i}" for i in range(1, 7)), "finger_l", "finger_r"]
    collision = {name: (piece,) for name, piece in SIX_COLLISION.items()}
    collision["finger_l"] = (Collider("box", (0.03, 0.006, 0.01), pose((0.035, -0.016, 0))),)
    collision["finger_r"] = (Collider("box", (0.03, 0.006, 0.01), pose((0.035, 0.016, 0))),)
    return Arm(
        "six",
        pose((-0.3, -0.42, 0.78), quat_about((0, 0, 1), HALF + 0.02)) if base is None else base,
        tuple(
            Link(name, 0.3, (0, 0, 0), (1e-3, 1e-3, 1e-3), collision=collision.get(name, ()))
            for name in links
        ),
        tuple(joints),
        tuple(f"joint{i}" for i in range(1, 7)),
        "link6",
        pose((0.12, 0, 0)),
        Gripper(("jaw_l", "jaw_r"), ("finger_l", "finger_r"), (0, 0), (0.0476, 0.0476), 0.0953),
        (0.0, 0.9, 1.0, 0.3, 0.0, 0.0),
        Mount("link6", IDENTITY),
    )


def seven_arm() -> Arm:
    """Seven joints, a fixed flange in front of joint 4 and a fixed hand behind joint 7, tcp x along
    the hand's z."""
    joints = []
    parent = "link0"
    for i, row in enumerate(SEVEN):
        if i == 3:
            joints.append(
                Joint(
                    "spacer",
                    "fixed",
                    parent,
                    "spacer_link",
                    pose((0.01, 0.02, 0.03), quat_from_rpy(0.1, -0.2, 0.3)),
                )
            )
            parent = "spacer_link"
        joints.append(Joint(f"joint{i + 1}", "revolute", parent, f"link{i + 1}", *_joint(row)))
        parent = f"link{i + 1}"
    joints.append(
        Joint(
            "hand_joint",
            "fixed",
            parent,
            "hand",
            pose((0, 0, 0.107), quat_about((0, 0, 1), -np.pi / 4)),
        )
    )
    return Arm(
        "seven",
        pose((0.3, -0.65, 0.75), quat_about((0, 0, 1), HALF)),
        (),
        tuple(joints),
        tuple(f"joint{i}" for i in range(1, 8)),
        "hand",
        pose((0, 0, 0.1034), quat_from_rpy(0, -HALF, 0)),
        Gripper(("a", "b"), ("a", "b"), (0, 0), (0.04, 0.04), 0.08),
        (0.0, -0.3, 0.0, -2.2, 0.0, 2.0, 0.785),
        Mount("hand", IDENTITY),
    )


def ik(
    chain: Chain,
    target: Pose,
    seed: np.ndarray,
    *,
    tolerance: tuple[float, float] = IK.tolerance,
    restarts: int = 60,
) -> np.ndarray | None:
    """Joints (n,) of one tcp pose, searched harder than the planner does, or None."""
    budget = IkBudget(tolerance, restarts, give_up_after=None, iterations=40)
    q, ok = ik_many(chain, target[None], np.asarray(seed)[None], budget)
    return q[0] if ok[0] else None


def pin_model(arm: Arm) -> tuple[pin.Model, int]:
    """The arm in pinocchio, built joint by joint from the spec, with its tcp frame's id."""
    model = pin.Model()
    parents, before = {arm.joints[0].parent: 0}, {arm.joints[0].parent: se3(arm.base)}
    for joint in arm.joints:
        placement = before[joint.parent] * se3(joint.origin)
        if joint.kind == "fixed":
            parents[joint.child], before[joint.child] = parents[joint.parent], placement
            continue
        cls = (
            pin.JointModelRevoluteUnaligned
            if joint.kind == "revolute"
            else pin.JointModelPrismaticUnaligned
        )
        axis = np.asarray(joint.axis, float)
        parents[joint.child] = model.addJoint(
            parents[joint.parent], cls(axis), placement, joint.name
        )
        before[joint.child] = pin.SE3.Identity()
    frame = pin.Frame(
        "tcp", parents[arm.hand], 0, before[arm.hand] * se3(arm.tcp), pin.FrameType.OP_FRAME
    )
    return model, model.addFrame(frame)


def se3(p: Pose) -> pin.SE3:
    """Pose (7,) as a pinocchio placement."""
    return pin.XYZQUATToSE3(np.array([*p[:3], *p[4:], p[3]]))


def _joint(row: tuple) -> tuple:
    xyz, rpy, axis, lower, upper = row
    return pose(xyz, quat_from_rpy(*rpy)), axis, lower, upper, 3.0, 30.0
