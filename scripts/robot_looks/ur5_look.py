"""How a UR5 with a WSG-50 looks: light grey tubes and housings with blue caps, a silver box of a
gripper with dark fingers."""

from pipeline.poses import Pose, pose
from pipeline.world.shapes import Material, Mesh
from scripts.robot_looks.kit import (
    BLACK,
    CHARCOAL,
    RUBBER,
    SILVER,
    Parts,
    block,
    camera_rod,
    depth_camera,
    housing,
    lathe,
    painted,
    plate,
    ring,
)

TUBE = Material((0.74, 0.755, 0.77), 0.4, 0.25)
BLUE = Material((0.36, 0.56, 0.76), 0.45)
SEAM = Material((0.25, 0.26, 0.28), 0.6)

X, Y, Z = (1, 0, 0), (0, 1, 0), (0, 0, 1)
BACK = (0, -1, 0)
DOWN = (0, 0, -1)


def ur5_visuals(camera: Pose) -> dict[str, Parts]:
    """Visuals by link name; `camera` is the wrist camera's pose in wsg_50_base_link."""
    return {
        "base_link": painted(
            (
                TUBE,
                [
                    lathe(
                        (0, 0, 0),
                        Z,
                        [
                            (0, 0),
                            (0.0745, 0),
                            (0.0745, 0.012),
                            (0.062, 0.02),
                            (0.06, 0.024),
                            (0, 0.024),
                        ],
                    )
                ],
            ),
            (SEAM, [housing((0, -0.06, 0.01), (0, -0.1, 0.01), 0.009, 0.001, 10)]),
        ),
        "shoulder_link": painted(
            (
                TUBE,
                [
                    housing((0, 0, -0.063), (0, 0, 0.055), 0.0595, 0.004),
                    housing((0, 0, 0), (0, 0.07, 0), 0.0595, 0.002),
                ],
            ),
            (BLUE, [_cap((0, 0, 0.054), Z, 0.057)]),
            (SEAM, [ring((0, 0, -0.064), Z, 0.0575, 0.004), ring((0, 0.0705, 0), Y, 0.058, 0.004)]),
        ),
        "upper_arm_link": painted(
            (
                TUBE,
                [
                    housing((0, -0.063, 0), (0, 0.056, 0), 0.0595, 0.004),
                    lathe(
                        (0, 0, 0.03),
                        Z,
                        [
                            (0, 0),
                            (0.054, 0),
                            (0.054, 0.06),
                            (0.0495, 0.08),
                            (0.0495, 0.28),
                            (0.052, 0.3),
                            (0.052, 0.37),
                            (0, 0.37),
                        ],
                    ),
                    housing((0, -0.06, 0.425), (0, 0.05, 0.425), 0.0595, 0.004),
                ],
            ),
            (BLUE, [_cap((0, 0.055, 0), Y, 0.057), _cap((0, 0.049, 0.425), Y, 0.057)]),
            (SEAM, [ring((0, 0, 0.1), Z, 0.0505, 0.006), ring((0, 0, 0.335), Z, 0.0525, 0.006)]),
        ),
        "forearm_link": painted(
            (
                TUBE,
                [
                    housing((0, -0.043, 0), (0, 0.054, 0), 0.058, 0.004),
                    lathe(
                        (0, 0, 0.03),
                        Z,
                        [
                            (0, 0),
                            (0.044, 0),
                            (0.042, 0.07),
                            (0.0375, 0.09),
                            (0.0375, 0.27),
                            (0.038, 0.34),
                            (0, 0.34),
                        ],
                    ),
                    housing((0, -0.03, 0.39225), (0, 0.046, 0.39225), 0.039, 0.003),
                ],
            ),
            (BLUE, [_cap((0, -0.042, 0), BACK, 0.055), _cap((0, -0.029, 0.39225), BACK, 0.037)]),
            (SEAM, [ring((0, 0, 0.118), Z, 0.0385, 0.006), ring((0, 0, 0.32), Z, 0.0385, 0.006)]),
        ),
        "wrist_1_link": painted(
            (
                TUBE,
                [
                    housing((0, 0.049, 0), (0, 0.132, 0), 0.0387, 0.004),
                    housing((0, 0.093, -0.045), (0, 0.093, 0.046), 0.0387, 0.003),
                ],
            ),
            (BLUE, [_cap((0, 0.093, -0.044), DOWN, 0.037)]),
            (SEAM, [ring((0, 0.048, 0), Y, 0.0375, 0.004)]),
        ),
        "wrist_2_link": painted(
            (
                TUBE,
                [
                    housing((0, 0, 0.049), (0, 0, 0.133), 0.0387, 0.004),
                    housing((0, -0.045, 0.0946), (0, 0.046, 0.0946), 0.0387, 0.003),
                ],
            ),
            (BLUE, [_cap((0, -0.044, 0.0946), BACK, 0.037)]),
            (SEAM, [ring((0, 0, 0.048), Z, 0.0375, 0.004)]),
        ),
        "wrist_3_link": painted(
            (SEAM, [ring((0, 0.049, 0), Y, 0.036, 0.004)]),
            (TUBE, [housing((0, 0.05, 0), (0, 0.082, 0), 0.0375, 0.003)]),
        ),
        "wsg_50_base_link": (
            *painted(
                (SILVER, [block((-0.073, -0.025, 0.003), (0.073, 0.025, 0.056), 0.004)]),
                (
                    CHARCOAL,
                    [
                        block((-0.072, -0.024, 0.055), (0.072, 0.024, 0.068), 0.003),
                        camera_rod(camera, (0, 0.02, 0.03)),
                    ],
                ),
                (
                    BLACK,
                    [
                        block((-0.06, -0.008, 0.067), (0.06, 0.008, 0.0725)),
                        block((-0.05, 0.0245, 0.02), (0.05, 0.0256, 0.04)),
                    ],
                ),
            ),
            *depth_camera(camera),
        ),
        "gripper_left": _carriage(),
        "finger_left": _finger(),
        "gripper_right": _carriage(),
        "finger_right": _finger(),
    }


def _cap(start, axis, radius: float) -> Mesh:
    return lathe(
        start, axis, [(0, 0), (radius, 0), (radius, 0.005), (0.86 * radius, 0.0115), (0, 0.013)]
    )


def _carriage() -> Parts:
    return painted((SILVER, [block((-0.018, -0.0142, 0.0594), (0, 0.0142, 0.0965), 0.002)]))


def _finger() -> Parts:
    """An L of aluminium and a rubber pad whose face is the collision pad's; both jaws use it, the
    right one turned by pi."""
    outline = [
        (-0.02, 0.0575),
        (0.0, 0.0575),
        (0.0015, 0.08),
        (0.0015, 0.1305),
        (-0.005, 0.1305),
        (-0.011, 0.095),
        (-0.02, 0.08),
    ]
    # drawn in (x, z): a quarter turn about x carries the outline's y to z and the thickness to -y
    body = plate(
        outline, 0.03, pose((0, 0.015, 0), (0.7071067811865476, 0.7071067811865476, 0, 0)), 0.0015
    )
    return painted(
        (CHARCOAL, [body]),
        (RUBBER, [block((-0.001, -0.014, 0.086), (0.0027, 0.014, 0.13), 0.0006)]),
    )
