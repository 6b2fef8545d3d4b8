"""Joins an arm and a gripper into one robot."""

from dataclasses import replace

from pipeline.poses import pose
from pipeline.world.robots.contract import Joint
from pipeline.world.robots.urdf_file import Mimic, UrdfRobot

PREFIX = "gripper_"  # of every link and joint of the gripper
FLANGE = "attach"  # in the name of the frame that the arms of MuJoCo Menagerie have for a gripper


def mount(arm: UrdfRobot, gripper: UrdfRobot, flange: str | None) -> UrdfRobot:
    """Join the gripper to the arm's link `flange`, by default the last. Raises UrdfError."""
    roots = gripper.roots()
    if len(roots) != 1:
        raise gripper.fault(f"has {len(roots)} root links, a gripper one: {roots[:6]}")
    at = flange or _flange(arm)
    if at not in arm.links:
        last = ", ".join([*arm.links][-8:])
        raise arm.fault(f"--flange {at!r}: has no such link; the last ones are {last}")
    for joint in (arm.parent_joint[link] for link in arm.below(at)[1:]):
        if joint.kind != "fixed":
            raise arm.fault(f"joint {joint.name!r} moves beyond {at!r}: leave --gripper away")
    renamed = {
        PREFIX + link: replace(
            joint,
            name=PREFIX + joint.name,
            parent=PREFIX + joint.parent,
            child=PREFIX + joint.child,
        )
        for link, joint in gripper.parent_joint.items()
    }
    root = PREFIX + roots[0]
    renamed[root] = Joint(f"{PREFIX}mount", "fixed", at, root, pose())
    mimics = {
        PREFIX + name: Mimic(PREFIX + m.joint, m.multiplier, m.offset)
        for name, m in gripper.mimics.items()
    }
    links = arm.links | {PREFIX + name: link for name, link in gripper.links.items()}
    return UrdfRobot(arm.path, links, arm.parent_joint | renamed, arm.mimics | mimics)


def _flange(arm: UrdfRobot) -> str:
    named = [link for link in arm.links if FLANGE in link]
    above = arm.parent_joint
    parents = {joint.parent for joint in above.values()}
    moved = [joint.child for joint in above.values() if joint.kind != "fixed"]
    last = [tip for tip in moved if all(above[x].kind == "fixed" for x in arm.below(tip)[1:])]
    ends = [link for tip in last for link in arm.below(tip) if link not in parents]
    candidates = named if len(named) == 1 else ends
    if len(candidates) != 1:
        found = ", ".join(candidates[:8]) or "no link"
        raise arm.fault(f"found {found} to carry the gripper; give --flange LINK")
    return candidates[0]
