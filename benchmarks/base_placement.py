"""Where each single arm should stand: scan base positions and print how much of the table it
reaches.

    python -m benchmarks.base_placement piper --y -0.5 -0.4 --z 0.75 0.85 --x 0.25 0.35

Reach is measured for the left arm (the right one mirrors it) over a 5 cm grid, x -0.4..0.4, y
-0.25..0.25, with the tool 3 and 15 cm above the table and the approach pitched 30, 45, 60 and 90
degrees below horizontal at any of several azimuths. `own` is the share of the arm's own half that
has an inverse kinematics solution in which the arm meets neither itself nor the table nor the other
arm at home, `mid` that of the strip |x| <= 0.1. `hidden` is the share of reached cells whose object
the arm covers from the head camera, `close` of those that bring a link within 12 cm of that camera.
"""

import argparse
from dataclasses import replace
from itertools import product

import numpy as np

from pipeline.intake.robots.place import Scan, lines, measure
from pipeline.poses import pose, quat_about, quat_multiply
from pipeline.world.robots import MODELS, get_embodiment
from pipeline.world.robots.contract import Embodiment

FULL = Scan(
    (0.03, 0.15),
    (30, 45, 60, 90),
    (0, 25, -25, 50, -50, 75, -75),
    lines(-0.4, 0.1, 0.05),
    lines(-0.25, 0.25, 0.05),
)


def moved(embodiment: Embodiment, x: float, y: float, z: float, yaw: float) -> Embodiment:
    """The robot with its bases at (-x, y, z) and (x, y, z), turned by `yaw` rad inwards, without
    its furniture."""
    arms = {
        side: replace(
            arm,
            base=pose((s * x, y, z), quat_multiply(quat_about((0, 0, 1), s * yaw), arm.base[3:])),
        )
        for (side, arm), s in zip(embodiment.arms.items(), (-1, 1), strict=True)
    }
    return replace(embodiment, arms=arms, furniture_collision=())


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("model", choices=list(MODELS))
    parser.add_argument(
        "--x",
        type=float,
        nargs="+",
        help="half distances of the bases, m (default: where it stands)",
    )
    parser.add_argument("--y", type=float, nargs="+", help="m")
    parser.add_argument("--z", type=float, nargs="+", help="m")
    parser.add_argument("--yaw", type=float, nargs="+", default=[0.0], help="degrees inwards")
    parser.add_argument("--best", type=int, default=8, help="rows to print")
    a = parser.parse_args()
    robot = get_embodiment(a.model)
    x, y, z = robot.arms["left"].base[:3] * (-1, 1, 1)
    rows = []
    for place in product(a.x or [x], a.y or [y], a.z or [z], a.yaw):
        rows.append((place, measure(moved(robot, *place[:3], np.radians(place[3])), FULL)))
    rows.sort(key=lambda row: -row[1].score)
    heads = " ".join(f"{p:>11}" for p in FULL.pitches)
    print(
        f"{a.model}: own/mid share of cells by pitch (degrees), at"
        f" {' and '.join(f'{100 * h:.0f} cm' for h in FULL.heights)}"
    )
    print(f"    x      y      z    yaw  score hidden close | {heads}  | {heads}")
    for place, reach in rows[: a.best]:
        cells = "  | ".join(
            " ".join(f"{o:.2f} / {m:.2f}" for o, m in zip(*row, strict=True))
            for row in zip(reach.own, reach.mid, strict=True)
        )
        numbers = " ".join(f"{v:6.3f}" for v in place[:3])
        print(
            f"{numbers} {place[3]:5.0f}  {reach.score:.3f}  {reach.hidden:.2f}  {reach.close:.2f} "
            f" | {cells}"
        )


if __name__ == "__main__":
    main()
