"""The paper's motions: constant velocity, polynomials, and abrupt pieces, in x and y at constant
height and orientation."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from pipeline.motion.contract import (
    MotionRequest,
    SpeedBound,
    Streams,
    TargetMotion,
    Verdict,
    bounded,
    described,
)
from pipeline.motion.models import register
from pipeline.motion.planar.draw import draw_motion
from pipeline.motion.planar.motion import PlanarMotion


class Planar:
    """Section 2.3 and appendix D.3 of the paper; see motion/planar/."""

    name = "planar"
    version = 1
    levels = described("constant velocity", "polynomial", "two or three abrupt segments")

    def draw(self, asked: MotionRequest, streams: Streams) -> PlanarMotion:
        return draw_motion(asked, streams)

    def stand(self, asked: MotionRequest, streams: Streams) -> PlanarMotion:
        return PlanarMotion.still(asked.end_pose, asked.duration, asked.lead)

    def judge(self, motion: TargetMotion, speed_bound: SpeedBound) -> Iterator[Verdict]:
        # a constant velocity has one speed, so that both bounds are the stricter one
        yield bounded(motion, speed_bound if motion.level > 1 else "maximum")
        if motion.level == 3 and isinstance(motion, PlanarMotion):
            jumps = np.atleast_1d(motion.velocity_jumps())
            abrupt = bool(len(jumps)) and float(jumps.max()) > 0
            yield Verdict("abrupt", abrupt, "a level-3 target never changes velocity abruptly")

    def describe(self, motion: TargetMotion) -> str:
        pieces = len(motion.breakpoints()) + 1
        return f"{self.levels[motion.level].text}, {motion.features().average_speed:.3f} m/s" + (
            f", {pieces} pieces" if pieces > 1 else ""
        )

    def read(self, values: Mapping[str, Any]) -> PlanarMotion:
        return PlanarMotion.from_values(values)


register(Planar())
