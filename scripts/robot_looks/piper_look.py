"""How a Piper looks: slim white shells, dark grey joint discs, a wide dark gripper."""

import numpy as np

from pipeline.poses import Pose, pose
from scripts.robot_looks.kit import (
    BLACK,
    CHARCOAL,
    GREY,
    RUBBER,
    SILVER,
    WHITE,
    Parts,
    block,
    camera_rod,
    depth_camera,
    housing,
    lathe,
    limb,
    painted,
    plate,
    ring,
)

X, Y, Z = (1, 0, 0), (0, 1, 0), (0, 0, 1)
# plates of the fingers are drawn in (y, z) of the jaw frame
IN_YZ = (0.5, 0.5, 0.5, 0.5)


def piper_visuals(camera: Pose) -> dict[str, Parts]:
    """Visuals by link name; `camera` is the wrist camera's pose in link6."""
    elbow = np.array([0.28358, 0.028726, 0.0])
    return {
        "base_link": painted(
            (
                WHITE,
                [
                    block((-0.058, -0.04, 0.006), (0.04, 0.04, 0.05), 0.008),
                    lathe((0, 0, 0.045), Z, [(0, 0), (0.04, 0), (0.038, 0.034), (0, 0.036)]),
                ],
            ),
            (
                CHARCOAL,
                [
                    block((-0.06, -0.05, 0), (0.05, 0.05, 0.007), 0.002),
                    ring((0, 0, 0.081), Z, 0.0365, 0.008),
                ],
            ),
        ),
        "link1": painted(
            (WHITE, [housing((0, 0, -0.037), (0, 0, 0.012), 0.0365, 0.01)]),
            (CHARCOAL, [housing((-0.034, 0, 0.002), (0.034, 0, 0.002), 0.0265, 0.003)]),
        ),
        "link2": painted(
            (
                WHITE,
                [
                    limb(
                        [
                            ((-0.004, 0.002, 0), 0.03, 0.029),
                            ((0.055, -0.005, 0), 0.032, 0.028),
                            ((0.09, -0.02, 0), 0.034, 0.029),
                            ((0.125, -0.026, 0), 0.033, 0.027),
                            ((0.18, -0.02, 0), 0.031, 0.026),
                            ((0.245, 0.006, 0), 0.033, 0.029),
                            ((0.287, 0.034, 0), 0.03, 0.028),
                        ],
                        Y,
                        0.9,
                    )
                ],
            ),
            (
                CHARCOAL,
                [
                    housing((0, 0, -0.0475), (0, 0, 0.0475), 0.031),
                    housing(
                        elbow - np.array((0, 0, 0.0475)), elbow + np.array((0, 0, 0.0475)), 0.031
                    ),
                ],
            ),
            (
                SILVER,
                [
                    ring(p + np.array((0, 0, s * 0.0475)), Z, 0.014, 0.003, 14)
                    for p in (np.zeros(3), elbow)
                    for s in (-1, 1)
                ],
            ),
        ),
        "link3": painted(
            (
                WHITE,
                [
                    limb(
                        [
                            ((0.014, 0.012, 0), 0.031, 0.028),
                            ((-0.03, 0.0281, 0), 0.032, 0.03),
                            ((-0.1, 0.0414, 0), 0.03, 0.028),
                            ((-0.17, 0.0548, 0), 0.027, 0.026),
                            ((-0.21, 0.0624, 0), 0.0265, 0.0255),
                        ],
                        Y,
                        0.95,
                    )
                ],
            ),
            (
                CHARCOAL,
                [
                    housing((0, 0, -0.0385), (0, 0, 0.0385), 0.0295),
                    ring((-0.212, 0.0628, 0), (-0.9823, 0.187, 0), 0.0275, 0.01),
                ],
            ),
            (GREY, [block((-0.14, 0.03, -0.0315), (-0.06, 0.046, 0.0315), 0.004)]),
        ),
        "link4": painted(
            (WHITE, [housing((0, 0, -0.035), (0, 0, 0.018), 0.0285, 0.009)]),
            (CHARCOAL, [housing((0, -0.033, 0), (0, 0.0285, 0), 0.0255)]),
        ),
        "link5": painted(
            (
                WHITE,
                [
                    lathe(
                        (0, -0.018, 0),
                        Y,
                        [
                            (0, 0),
                            (0.018, 0),
                            (0.027, 0.012),
                            (0.028, 0.05),
                            (0.0255, 0.094),
                            (0, 0.096),
                        ],
                    )
                ],
            ),
            (CHARCOAL, [ring((0, 0.082, 0), Y, 0.0285, 0.016)]),
        ),
        "link6": (
            *painted(
                (SILVER, [housing((0, 0, 0), (0, 0, 0.01), 0.0265, 0.002)]),
                (
                    WHITE,
                    [
                        lathe(
                            (0, 0, 0.01),
                            Z,
                            [(0, 0), (0.029, 0), (0.03, 0.02), (0.026, 0.03), (0, 0.03)],
                        )
                    ],
                ),
                (
                    BLACK,
                    [
                        block((-0.024, -0.0725, 0.034), (0.024, 0.0725, 0.06), 0.005),
                        camera_rod(camera, (-0.02, 0, 0.022)),
                    ],
                ),
                (GREY, [block((-0.008, -0.07, 0.059), (0.008, 0.07, 0.066), 0.001)]),
            ),
            *depth_camera(camera),
        ),
        "link7": _finger(1.0),
        "link8": _finger(-1.0),
    }


def _finger(side: float) -> Parts:
    """Jaw in its own frame: y along the finger (from -0.0695 to 0.005 for link7), pad face at z =
    0, body towards -z."""

    def drawn(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
        turned = [(side * y, z) for y, z in points]
        return turned if side > 0 else turned[::-1]

    body = drawn(
        [
            (-0.069, -0.024),
            (-0.05, -0.024),
            (-0.035, -0.017),
            (-0.012, -0.011),
            (0.00497, -0.006),
            (0.00497, -0.002),
            (-0.069, -0.002),
        ]
    )
    carriage = sorted((side * -0.0695, side * -0.0515))
    pad = sorted((side * -0.047, side * 0.0045))
    return painted(
        (GREY, [block((-0.02, carriage[0], -0.0245), (0.02, carriage[1], 0), 0.002)]),
        (BLACK, [plate(body, 0.022, pose((-0.011, 0, 0), IN_YZ), 0.0015)]),
        (RUBBER, [block((-0.0105, pad[0], -0.0026), (0.0105, pad[1], 0.0), 0.0006)]),
    )
