"""`check-robot`: a sound robot passes every clause, and each clause finds the fault that it is
for."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from pipeline.intake.robots import check
from pipeline.intake.robots.check import check_robot
from pipeline.world.robots import RobotError, get_embodiment
from pipeline.world.robots.contract import Arm, Embodiment
from tests.run.command import inside


def test_a_sound_robot_passes_every_clause():
    found = {finding.name: finding for finding in check_robot("piper", [])}
    assert list(found) == ["limits", "mass", "pair", "home", "reach", "grip", "camera"]
    assert [finding for finding in found.values() if not finding.ok] == []
    assert (
        "a can of 4 cm stops the jaws at 4." in found["grip"].detail
        or "at 3." in found["grip"].detail
    )
    masses = sum(link.mass for link in get_embodiment("piper").arms["left"].links)
    assert f"left arm {masses:.2f} kg" in found["mass"].detail


def with_left(change: Callable[[Arm], Arm]) -> Embodiment:
    """Piper with another left arm."""
    robot = get_embodiment("piper")
    return replace(robot, arms={**robot.arms, "left": change(robot.arms["left"])})


def fast(arm: Arm) -> Arm:
    return replace(arm, joints=(replace(arm.joints[0], velocity=1000.0), *arm.joints[1:]))


def heavy(arm: Arm) -> Arm:
    return replace(arm, links=tuple(replace(link, mass=1000.0) for link in arm.links))


def aside(arm: Arm) -> Arm:
    return replace(arm, base=arm.base + np.eye(7)[0] * 0.2)


def into_the_table(arm: Arm) -> Arm:
    return replace(arm, base=arm.base - np.eye(7)[2] * 0.5)


def blind(arm: Arm) -> Arm:
    behind = np.array([0, 0, 0, 0, 0, 0, 1.0])
    return replace(
        arm,
        camera=replace(arm.camera, pose=np.concatenate([arm.camera.pose[:3] + 1.0, behind[3:]])),
    )


def weak(arm: Arm) -> Arm:
    return replace(arm, gripper=replace(arm.gripper, force=0.0, stiffness=0.0))


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        ("_limits", fast, "placeholders at left joint1 (velocity 1000"),
        ("_masses", heavy, "left arm 9000.00 kg"),
        ("_pair", aside, "cm from the mirror image of the left one"),
        ("_home", into_the_table, "touches something with jaws at [0.0, 0.5, 1.0]"),
        ("_camera", blind, "misses a pad"),
        ("_grip", weak, "a can of 4 cm stops the jaws at"),
    ],
)
def test_each_clause_finds_its_fault(name, change, said):
    found = getattr(check, name)(with_left(change))
    assert not found.ok and said in found.detail


def test_one_arm_and_unknown_robots_are_refused():
    with pytest.raises(RobotError, match="is one arm of a robot"):
        list(check_robot("piper+none", []))
    assert "r2d2" in inside("check-robot", "r2d2")[2]
