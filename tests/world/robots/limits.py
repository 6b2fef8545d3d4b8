"""Limits of an arm's joints."""

import numpy as np

from pipeline.world.robots.contract import Arm


def arm_limits(arm: Arm) -> np.ndarray:
    """Limits of the arm joints, (dof, 2) rad."""
    by_name = {joint.name: joint for joint in arm.joints}
    return np.array([(by_name[n].lower, by_name[n].upper) for n in arm.arm_joints])
