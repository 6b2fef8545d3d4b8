"""Both arms of a robot as one URDF, and the tool frame of an arm: for checks against other
libraries."""

from xml.etree import ElementTree as ET

from numpy.typing import ArrayLike

from pipeline.intake.robots.write import arm_urdf, rpy_from_quat
from pipeline.poses import Pose, compose
from pipeline.world.robots.contract import Arm, Embodiment, arm_poses, root_link


def embodiment_urdf(embodiment: Embodiment) -> str:
    """The arms, their names prefixed `left_` and `right_`, fixed to one link `world` at their base
    poses."""
    robot = ET.Element("robot", name=embodiment.name)
    ET.SubElement(robot, "link", name="world")
    for side, arm in embodiment.arms.items():
        joint = ET.SubElement(robot, "joint", name=f"{side}_mount", type="fixed")
        xyz, rpy = (
            " ".join(map(repr, map(float, values)))
            for values in (arm.base[:3], rpy_from_quat(arm.base[3:]))
        )
        ET.SubElement(joint, "origin", xyz=xyz, rpy=rpy)
        ET.SubElement(joint, "parent", link="world")
        ET.SubElement(joint, "child", link=f"{side}_{root_link(arm)}")
        robot.extend(ET.fromstring(arm_urdf(arm, f"{side}_")))
    return ET.tostring(robot, encoding="unicode")


def tcp_pose(arm: Arm, q: ArrayLike) -> Pose:
    """World pose (7,) of the tool frame for joints q (n,) in rad."""
    return compose(arm_poses(arm, q)[arm.hand], arm.tcp)
