"""Dimensions of a hand that follow from its collision pieces."""

from functools import cache

import numpy as np

from pipeline.poses import compose, inverse, transform
from pipeline.world.robots.contract import Arm
from pipeline.world.robots.forward import arm_poses


@cache
def fingertip_reach(arm: Arm) -> float:
    """How far (m) the closed fingertips stand out of the tcp along the approach axis."""
    links = {link.name: link for link in arm.links}
    at = arm_poses(arm, arm.home, 0.0)
    tcp = inverse(compose(at[arm.hand], arm.tcp))
    points = [
        transform(compose(tcp, at[finger]), c.support_points()) for finger in arm.gripper.fingers for c in links[finger].collision
    ]
    return float(np.concatenate(points)[:, 0].max())
