"""aloha-agilex: the Cobot Magic of RoboTwin 2.0, two ARX-5 front arms on a wheeled base behind the table.

Numbers: `arx5_description_isaac.urdf` and config.yml of RoboTwin 2.0. The rear (leader) arms are not modelled.
"""

from pipeline.poses import Pose, compose, pose
from pipeline.world.robots.arx_family import Variant, arx_arm
from pipeline.world.robots.contract import SIDES, Arm, Embodiment
from pipeline.world.robots.notation import FACING_TABLE, HEAD_CAMERA, at

ROOT = pose((0, -0.65, 0), FACING_TABLE)  # `footprint`, on the floor
MOUNTS = {"left": at((0.2305, 0.297, 0.782), (0, 0, 0.02)), "right": at((0.2315, -0.3063, 0.781), (0, 0, 0.01))}

FRONT_ARM = Variant(
    model="aloha-agilex",
    origins=(
        ((0.0, 0.0, 0.058), (0.0, 0.0, 0.0)),
        ((0.025013, 0.00060169, 0.042), (0.0, 0.0, 0.0)),
        ((-0.26396, 0.0044548, 0.0), (-3.141592653589793, 0.0, -0.015928)),
        ((0.246, -0.00025, -0.06), (0.0, 0.0, 0.0)),
        ((0.06775, 0.0015, -0.0855), (0.0, 0.0, -0.015928)),
        ((0.03095, 0.0, 0.0855), (-3.141592653589793, 0.0, 0.0)),
    ),
    jaw_origins=((0.08457, 0.024493, -0.00010349), (0.08457, -0.024496, -0.00010354)),
    jaw_limit=0.04765,
    jaw_open=0.045,
    finger_end=0.155,
    camera=at((0.07, 0.032, 0.065), (0.0, 0.4, 0.0)),
    home=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
)


def base_pose(side: str) -> Pose:
    """World pose (7,) of an arm's base link."""
    return compose(ROOT, MOUNTS[side])


def arm(side: str) -> Arm:
    """The left or right arm at its place on the base."""
    return arx_arm(FRONT_ARM, base_pose(side))


def embodiment() -> Embodiment:
    """Both front arms on the base."""
    return Embodiment("aloha-agilex", {side: arm(side) for side in SIDES}, HEAD_CAMERA, aliases=("aloha", "cobot-magic"))
