"""How an ARX-5 arm looks: 57 mm motor housings joined by plates and box beams, a flat two-jaw
gripper, a camera above it.

Parts are placed from the joint origins of the variant, so both variants fit their own kinematics.
Frames: see arx_family.py.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.poses import Pose, pose
from pipeline.world.robots.directory import Triple
from pipeline.world.shapes import Material, Mesh
from scripts.robot_looks.kit import (
    BLACK,
    CHARCOAL,
    RUBBER,
    SILVER,
    Parts,
    block,
    depth_camera,
    housing,
    lathe,
    limb,
    link_outline,
    painted,
    plate,
    ring,
)

# a plate drawn in (x, z) of the link: its xy plane is the link's xz plane, its thickness runs along
# -y
SIDEWAYS = pose((0, 0, 0), (np.sqrt(0.5), np.sqrt(0.5), 0, 0))


@dataclass(frozen=True, eq=False)
class ColorScheme:
    """Colours: main housings, shells of the beams, stripes on the forearm, rings at the joints."""

    housing: Material = BLACK
    shell: Material = CHARCOAL
    stripe: Material = SILVER
    ring: Material = SILVER


def arx_visuals(
    origins: Sequence[Triple],
    jaws: Sequence[Triple],
    finger_end: float,
    camera: Pose,
    scheme: ColorScheme,
) -> dict[str, Parts]:
    """Visuals by link name: six joint origins (m), two jaw origins in link6, finger end along link6
    x, camera in link6."""
    shoulder, elbow, wrist, yaw, roll = origins[1:]
    x, y, z = (1, 0, 0), (0, 1, 0), (0, 0, 1)
    return {
        "base_link": painted(
            (
                scheme.housing,
                [
                    block((-0.05, -0.05, 0), (0.05, 0.05, 0.01), 0.003),
                    lathe((0, 0, 0.01), z, _stub(0.044, 0.037, origins[0][2] - 0.012)),
                ],
            ),
            (scheme.ring, [ring((0, 0, origins[0][2] - 0.004), z, 0.0375, 0.006)]),
        ),
        "link1": painted(
            (
                scheme.housing,
                [
                    housing((0, 0, 0), (0, 0, 0.016), 0.039, 0.003),
                    block((-0.01, -0.0415, 0.004), (shoulder[0] + 0.018, 0.0415, 0.014), 0.002),
                ],
            ),
            (
                scheme.shell,
                [
                    _cheek(
                        (shoulder[0] - 0.002, 0.012),
                        (shoulder[0], shoulder[2]),
                        0.026,
                        0.029,
                        s * 0.0385,
                    )
                    for s in (-1, 1)
                ],
            ),
            (
                scheme.ring,
                [ring((shoulder[0], s * 0.042, shoulder[2]), y, 0.014, 0.004, 14) for s in (-1, 1)],
            ),
        ),
        "link2": painted(
            (
                scheme.housing,
                [
                    housing((0, -0.034, 0), (0, 0.034, 0), 0.0292),
                    housing((elbow[0], -0.034, 0), (elbow[0], 0.034, 0), 0.0302),
                ],
            ),
            (
                scheme.shell,
                [
                    limb(
                        [
                            ((-0.012, 0, 0), 0.027, 0.026),
                            ((-0.05, 0, 0), 0.026, 0.026),
                            ((-0.09, 0, 0), 0.023, 0.022),
                            ((elbow[0] + 0.07, elbow[1], 0), 0.023, 0.022),
                            ((elbow[0] + 0.02, elbow[1], 0), 0.027, 0.026),
                        ],
                        roundness=0.45,
                        n=2,
                    )
                ],
            ),
            (
                scheme.ring,
                [
                    ring((0, 0, 0), y, 0.0297, 0.012),
                    ring((elbow[0], elbow[1], 0), y, 0.0307, 0.012),
                ],
            ),
        ),
        "link3": painted(
            (
                scheme.housing,
                [housing((wrist[0], -0.026, wrist[2]), (wrist[0], 0.026, wrist[2]), 0.0265)],
            ),
            (
                scheme.shell,
                [
                    *(_cheek((0, 0), (0.012, -0.058), 0.029, 0.024, s * 0.0395) for s in (-1, 1)),
                    limb(
                        [
                            ((-0.024, 0, -0.06), 0.03, 0.024),
                            ((0.03, 0, -0.06), 0.031, 0.0255),
                            ((0.1, 0, -0.06), 0.029, 0.025),
                            ((wrist[0] - 0.06, 0, wrist[2]), 0.024, 0.021),
                            ((wrist[0] - 0.018, 0, wrist[2]), 0.0235, 0.02),
                        ],
                        roundness=0.45,
                        n=2,
                    ),
                ],
            ),
            (
                scheme.stripe,
                [
                    block((0.055, s * 0.0285 - 0.002, -0.068), (0.165, s * 0.0285 + 0.002, -0.052))
                    for s in (-1, 1)
                ],
            ),
            (scheme.ring, [ring((0, s * 0.043, 0), y, 0.015, 0.004, 14) for s in (-1, 1)]),
        ),
        "link4": painted(
            (
                scheme.shell,
                [
                    *(
                        _cheek((0, 0), (0.018, yaw[2] + 0.018), 0.025, 0.02, s * 0.031)
                        for s in (-1, 1)
                    ),
                    block(
                        (-0.002, -0.034, yaw[2] - 0.003),
                        (yaw[0] + 0.004, 0.034, yaw[2] + 0.012),
                        0.003,
                    ),
                ],
            ),
            (
                scheme.housing,
                [housing((yaw[0], yaw[1], yaw[2] - 0.008), (yaw[0], yaw[1], yaw[2] + 0.036), 0.03)],
            ),
            (
                scheme.ring,
                [
                    ring((yaw[0], yaw[1], yaw[2] + 0.03), z, 0.0305, 0.008),
                    *(ring((0, s * 0.034, 0), y, 0.013, 0.004, 14) for s in (-1, 1)),
                ],
            ),
        ),
        "link5": painted(
            (
                scheme.shell,
                [
                    housing((0, 0, 0.036), (0, 0, 0.06), 0.026, 0.003),
                    block((-0.03, -0.024, 0.05), (0.012, 0.024, roll[2] + 0.02), 0.006),
                ],
            ),
            (
                scheme.housing,
                [housing((-0.034, 0, roll[2]), (roll[0] - 0.002, 0, roll[2]), 0.0288)],
            ),
            (scheme.ring, [ring((roll[0] - 0.006, 0, roll[2]), x, 0.0293, 0.006)]),
        ),
        "link6": (
            *painted(
                (scheme.ring, [housing((0, 0, 0), (0.012, 0, 0), 0.024, 0.002)]),
                (
                    scheme.housing,
                    [
                        lathe((0.01, 0, 0), x, _stub(0.03, 0.027, 0.03)),
                        block((0.036, -0.062, -0.021), (0.07, 0.062, 0.021), 0.005),
                    ],
                ),
                (
                    scheme.shell,
                    [
                        block((0.068, -0.076, -0.012), (0.077, 0.076, 0.012), 0.002),
                        limb(
                            [
                                ((0.04, 0, 0.019), 0.016, 0.008),
                                ((0.034, 0, 0.045), 0.016, 0.006),
                                ((0.022, -0.0175, 0.08), 0.016, 0.005),
                            ],
                            (1, 0, 0),
                            0.4,
                            1,
                        ),
                    ],
                ),
            ),
            *depth_camera(camera),
        ),
        "link7": _finger(jaws[0], finger_end, 1.0, scheme),
        "link8": _finger(jaws[1], finger_end, -1.0, scheme),
    }


def _finger(origin: Triple, end: float, side: float, scheme: ColorScheme) -> Parts:
    """Carriage, a finger that tapers towards its end, and a rubber pad whose face is the collision
    pad's."""
    base, tip = -0.007, end - origin[0]

    def along(x: float, y: float) -> tuple[float, float]:
        return (x, -origin[1] + side * y)

    outline = [
        along(base, 0.002),
        along(0.012, 0.002),
        along(0.03, 0.003),
        along(tip - 0.001, 0.003),
        along(tip - 0.001, 0.008),
    ]
    outline += [
        along(tip - 0.02, 0.014),
        along(0.026, 0.02),
        along(0.012, 0.033),
        along(base, 0.033),
    ]
    ordered = outline if side > 0 else outline[::-1]
    height = -origin[2]
    body = plate(ordered, 0.022, pose((0, 0, height - 0.011)), 0.0015)
    y = sorted((-origin[1], -origin[1] + side * 0.0032))
    pad = block((0.02, y[0], height - 0.0105), (tip, y[1], height + 0.0105), 0.0008)
    slide_y = sorted((along(0, 0.006)[1], along(0, 0.03)[1]))
    slide = block(
        (base - 0.004, slide_y[0], height - 0.017), (0.009, slide_y[1], height + 0.017), 0.002
    )
    return painted((scheme.shell, [slide]), (scheme.housing, [body]), (RUBBER, [pad]))


def _cheek(a: Sequence[float], b: Sequence[float], ra: float, rb: float, y: float) -> Mesh:
    """A connecting plate in the link's xz plane, 7 mm thick, centred at `y`."""
    return plate(link_outline(a, b, ra, rb), 0.007, pose((0, y + 0.0035, 0), SIDEWAYS[3:]))


def _stub(r0: float, r1: float, height: float) -> list[tuple[float, float]]:
    return [
        (0, 0),
        (r0, 0),
        (r0, 0.3 * height),
        (r1, 0.6 * height),
        (r1, height - 0.003),
        (r1 - 0.003, height),
        (0, height),
    ]
