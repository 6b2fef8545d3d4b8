"""An arm and a gripper from two files as one robot."""

from dataclasses import replace

from pipeline.poses import pose
from pipeline.world.robots.contract import Joint
from pipeline.world.robots.urdf_file import Mimic, UrdfError, UrdfRobot

PREFIX = "gripper_"  # of every link and joint of the gripper
FLANGE = "attach"  # in the name of the frame that the arms of MuJoCo Menagerie have for a gripper


def mount(arm: UrdfRobot, gripper: UrdfRobot, flange: str | None) -> UrdfRobot:
    """The gripper's root link on the arm's link `flange`, by default the last link of the only arm.

    Raises UrdfError where the flange is missing or not clear, where something moves beyond it, and
    for a gripper of several roots.
    """
    roots = gripper.roots()
    if len(roots) != 1:
        raise UrdfError(
            f"{gripper.path}: a gripper has one root link, this file has {len(roots)}"
            f" ({', '.join(roots[:6])})"
        )
    at = flange or _flange(arm)
    if at not in arm.links:
        raise UrdfError(
            f"{arm.path}: --flange {at!r}: has no such link; the last ones are"
            f" {', '.join([*arm.links][-8:])}"
        )
    if moving := [
        j.name for link in arm.below(at)[1:] if (j := arm.parent_joint[link]).kind != "fixed"
    ]:
        raise UrdfError(
            f"{arm.path}: joint {moving[0]!r} moves beyond the flange {at!r}: leave --gripper away"
        )
    above = {
        PREFIX + link: replace(
            j, name=PREFIX + j.name, parent=PREFIX + j.parent, child=PREFIX + j.child
        )
        for link, j in gripper.parent_joint.items()
    }
    at_flange = Joint(PREFIX + "mount", "fixed", at, PREFIX + roots[0], pose())
    return UrdfRobot(
        arm.path,
        arm.links | {PREFIX + name: link for name, link in gripper.links.items()},
        arm.parent_joint | {at_flange.child: at_flange} | above,
        arm.mimics
        | {
            PREFIX + n: Mimic(PREFIX + m.joint, m.multiplier, m.offset)
            for n, m in gripper.mimics.items()
        },
    )


def _flange(arm: UrdfRobot) -> str:
    """The frame for a gripper: the one named so, or the only link that ends the chain of moving
    joints."""
    named = [link for link in arm.links if FLANGE in link]
    parents = {joint.parent for joint in arm.parent_joint.values()}
    moved = [joint.child for joint in arm.parent_joint.values() if joint.kind != "fixed"]
    last = [
        link
        for link in moved
        if not any(arm.parent_joint[x].kind != "fixed" for x in arm.below(link)[1:])
    ]
    ends = [link for tip in last for link in arm.below(tip) if link not in parents]
    candidates = named if len(named) == 1 else ends
    if len(candidates) != 1:
        names = ", ".join(candidates[:8]) or "none"
        raise UrdfError(
            f"{arm.path}: which link carries the gripper is not clear (found {names}); give"
            " --flange LINK"
        )
    return candidates[0]
