"""How a Franka arm looks: white tubes of 11 cm whose joint housings cross at right angles, grey
caps, a black hand."""

import numpy as np

from pipeline.poses import Pose, pose, quat_about
from pipeline.world.shapes import Mesh
from scripts.robot_looks.kit import (
    BLACK,
    CHARCOAL,
    GREY,
    RUBBER,
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
R = 0.0545  # tube radius, m
# plates of the fingers are drawn in (y, z): their xy plane is the link's yz plane
IN_YZ = (0.5, 0.5, 0.5, 0.5)


def panda_visuals(camera: Pose) -> dict[str, Parts]:
    """Visuals by link name; `camera` is the wrist camera's pose in the hand frame."""
    return {
        "panda_link0": painted(
            (
                WHITE,
                [
                    _foot(),
                    lathe(
                        (0, 0, 0.05),
                        Z,
                        [(0, 0), (0.072, 0), (0.07, 0.04), (0.06, 0.086), (0, 0.088)],
                    ),
                ],
            ),
            (
                GREY,
                [
                    ring((0, 0, 0.136), Z, 0.0565, 0.008),
                    block((-0.152, -0.035, 0.005), (-0.118, 0.035, 0.05), 0.006),
                ],
            ),
        ),
        "panda_link1": painted(
            (WHITE, [_tube((0, 0, -0.19), (0, 0, 0.045)), _tube((0, -0.126, 0), (0, -0.01, 0))]),
            (GREY, [_cap((0, -0.126, 0), (0, -1, 0)), ring((0, 0, -0.188), Z, 0.0558, 0.006)]),
        ),
        "panda_link2": painted(
            (WHITE, [_tube((0, 0, -0.045), (0, 0, 0.126)), _tube((0, 0.045, 0), (0, -0.19, 0))]),
            (GREY, [_cap((0, 0, 0.126), Z), ring((0, -0.19, 0), Y, 0.0558, 0.006)]),
        ),
        "panda_link3": painted(
            (
                WHITE,
                [
                    _bend((0, 0, -0.118), (0, 0, -0.045), (0.0825, 0, 0.0)),
                    _tube((0.0825, -0.03, 0), (0.0825, 0.108, 0)),
                ],
            ),
            (GREY, [_cap((0.0825, 0.108, 0), Y), ring((0, 0, -0.12), Z, 0.0558, 0.006)]),
        ),
        "panda_link4": painted(
            (
                WHITE,
                [
                    _bend((-0.0825, 0.122, 0), (-0.0825, 0.05, 0), (0, 0, 0.0)),
                    _tube((0, 0, -0.03), (0, 0, 0.108)),
                ],
            ),
            (GREY, [_cap((0, 0, 0.108), Z), ring((-0.0825, 0.12, 0), Y, 0.0558, 0.006)]),
        ),
        "panda_link5": painted(
            (
                WHITE,
                [
                    _tube((0, 0, -0.262), (0, 0, -0.2)),
                    limb(
                        [
                            ((0, 0, -0.212), 0.0535, 0.0535),
                            ((0, 0.012, -0.17), 0.052, 0.054),
                            ((0, 0.045, -0.12), 0.046, 0.045),
                            ((0, 0.067, -0.07), 0.042, 0.036),
                            ((0, 0.075, -0.02), 0.044, 0.034),
                            ((0, 0.078, 0.02), 0.038, 0.034),
                        ],
                        (0, 1, 0),
                        0.75,
                    ),
                    _tube((0, 0.05, 0), (0, 0.124, 0), 0.05),
                ],
            ),
            (GREY, [_cap((0, 0.124, 0), Y, 0.046), ring((0, 0, -0.26), Z, 0.0558, 0.006)]),
        ),
        "panda_link6": painted(
            (
                WHITE,
                [
                    _tube((0, 0, -0.042), (0, 0, 0.05), 0.0475),
                    limb(
                        [
                            ((0, 0, 0.004), 0.04, 0.034),
                            ((0.05, 0.004, 0.004), 0.038, 0.032),
                            ((0.095, 0.008, 0), 0.036, 0.032),
                        ]
                    ),
                    _tube((0.088, -0.046, 0), (0.088, 0.076, 0), 0.044),
                ],
            ),
            (
                GREY,
                [
                    _cap((0, 0, 0.05), Z, 0.044),
                    _cap((0.088, 0.076, 0), Y, 0.04),
                    ring((0.088, -0.045, 0), Y, 0.0446, 0.005),
                ],
            ),
        ),
        "panda_link7": painted(
            (WHITE, [housing((0, 0, 0.053), (0, 0, 0.1), 0.0435, 0.006), _lug()]),
            (GREY, [ring((0, 0, 0.103), Z, 0.0355, 0.008)]),
        ),
        "panda_hand": (
            *painted(
                (BLACK, [_hand(), camera_rod(camera, (0.026, 0, 0.006))]),
                (
                    CHARCOAL,
                    [
                        block((-0.013, -0.092, 0.06), (0.013, 0.092, 0.0665), 0.002),
                        housing((0, 0, -0.004), (0, 0, 0.004), 0.034, 0.002),
                    ],
                ),
            ),
            *depth_camera(camera),
        ),
        "panda_leftfinger": _finger(1.0),
        "panda_rightfinger": _finger(-1.0),
    }


def _tube(a, b, radius: float = R) -> Mesh:
    return housing(a, b, radius, 0.01, 16)


def _cap(centre, axis, radius: float = 0.05) -> Mesh:
    return lathe(
        centre, axis, [(0, 0), (radius, 0), (radius, 0.002), (radius - 0.006, 0.005), (0, 0.006)]
    )


def _bend(a, b, c) -> Mesh:
    """A tube from `a` over `b` to `c`, round at first, a little flatter where it meets the next
    housing."""
    a, b, c = (np.asarray(p, float) for p in (a, b, c))
    across = np.cross(b - a, c - b)
    corner = 0.5 * b + 0.25 * (a + c)
    return limb(
        [
            (a, R, R),
            (0.35 * a + 0.65 * b, R, R),
            (corner, R, R),
            (0.45 * b + 0.55 * c, 0.05, 0.05),
            (c, 0.046, 0.046),
        ],
        across,
        1.0,
        4,
    )


def _foot() -> Mesh:
    outline = [
        (-0.15, -0.06),
        (-0.06, -0.093),
        (0.02, -0.093),
        (0.07, -0.05),
        (0.07, 0.05),
        (0.02, 0.093),
        (-0.06, 0.093),
        (-0.15, 0.06),
    ]
    return plate(outline, 0.056, pose(), 0.012)


def _lug() -> Mesh:
    return block((0.02, -0.016, 0.058), (0.076, 0.016, 0.1), 0.008).moved(
        pose((0, 0, 0), quat_about(Z, np.pi / 4))
    )


def _hand() -> Mesh:
    outline = [
        (-0.1, 0.0),
        (-0.09, -0.002),
        (-0.045, -0.004),
        (0.045, -0.004),
        (0.09, -0.002),
        (0.1, 0.0),
        (0.102, 0.03),
        (0.102, 0.062),
    ]
    outline += [(-0.102, 0.062), (-0.102, 0.03)]
    return plate(outline, 0.062, pose((-0.031, 0, 0), IN_YZ), 0.006)


def _finger(side: float) -> Parts:
    """Finger drawn in (y, z) of its frame; the pad's face is the collision pad's."""
    outline = [
        (0.0006, 0.036),
        (0.0006, 0.0545),
        (0.009, 0.0545),
        (0.0152, 0.046),
        (0.022, 0.034),
        (0.0265, 0.02),
        (0.0265, 0.0),
    ]
    outline += [(0.006, 0.0), (0.006, 0.025)]
    ordered = [(side * y, z) for y, z in (outline[::-1] if side > 0 else outline)]
    body = plate(ordered, 0.0205, pose((-0.01025, 0, 0), IN_YZ), 0.0015)
    low, high = sorted((0.0, side * 0.0022))
    return painted(
        (CHARCOAL, [body]), (RUBBER, [block((-0.0088, low, 0.037), (0.0088, high, 0.054), 0.0005)])
    )
