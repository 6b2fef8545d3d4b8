"""A round target rolls without slipping: straight on, or towards a goal line, maybe off a wall."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from pipeline.poses import Floats, pose, quat_multiply, quat_rotate, yawed

from ..closed_form import Along, ClosedFormModel, common, headings, turns, ways
from ..contract import MotionRequest, Streams
from ..pace import draw_forward, draw_pace, two_speeds
from ..scenery import Piece, Prop, flat, standing
from . import register


@dataclass(frozen=True)
class Rolling(Along):
    """A roll without slipping along `heading` (rad), its centre `radius` m above the origin; speeds
    are the centre's."""

    kind: ClassVar[str] = "rolling"
    heading: float
    radius: float

    def centre(self, s: Floats) -> Floats:
        """World position (..., 3) of the body's centre at advances s (...,)."""
        middle = np.array(self.end[:3]) + np.array([0.0, 0.0, self.radius])
        return middle + np.asarray(s)[..., None] * ways(self.heading)[0]

    def _turn(self, s: Floats) -> Floats:
        """The turn (..., 4) from the end pose at advances s."""
        return turns(ways(self.heading)[1], s / self.radius)

    def _leg(self, s: Floats) -> tuple[Floats, Floats]:
        """Direction and axis (..., 3) of the roll at advances s (...,)."""
        forward, axis = ways(self.heading)
        return forward, np.broadcast_to(axis, (*np.shape(s), 3))

    def at(self, s: Floats) -> Floats:
        turn = self._turn(np.asarray(s))
        place = self.centre(s) - quat_rotate(turn, np.array([0.0, 0.0, self.radius]))
        return np.concatenate([place, quat_multiply(turn, np.array(self.end[3:]))], -1)

    def slope(self, s: Floats) -> Floats:
        forward, axis = self._leg(np.asarray(s))
        spin = axis / self.radius
        arm = self.at(s)[..., :3] - self.centre(s)
        return np.concatenate([forward + np.cross(spin, arm), spin], -1)

    def speed(self, t: ArrayLike) -> Floats:
        return np.abs(self.pace.rate(np.maximum(t, -self.lead))) * (np.asarray(t) >= -self.lead)


class RollingModel(ClosedFormModel[Rolling]):
    """The target must be a ball or a lying cylinder."""

    def shape(self, asked: MotionRequest, streams: Streams) -> dict[str, Any]:
        return {"pace": draw_pace(asked, streams.shape), "radius": asked.height / 2}


register(RollingModel(Rolling))

OFTEN = 0.6  # share of the shapes that rebound
TURN = (0.9, 1.9)  # rad by which a rebound turns the path
SLOWED = (0.4, 0.6)  # share of its speed that a rebound leaves at level 3
LATE = (1.4, 2.2)  # s from the meeting to the line
NEAREST, BESIDE = 0.06, 0.05  # m: the line from the meeting, a wall that is passed from the ball
WALL, GOAL = 0.07, 0.09  # m, half lengths
EDGE = (0.34, 0.27)  # m from the middle of the table within which the line is seen
BRICK, WHITE, RED = (0.55, 0.30, 0.24), (0.93, 0.93, 0.90), (0.80, 0.12, 0.12)


@dataclass(frozen=True)
class Rebound(Rolling):
    """A roll along `incoming` (rad) until `bounce` m before the end, then along `heading`. `wall`
    is its middle (x, y; m) and normal (rad); the goal is `line` m beyond the end."""

    kind: ClassVar[str] = "rebound"
    incoming: float
    bounce: float
    wall: tuple[float, float, float]
    line: float

    @property
    def _came(self) -> tuple[Floats, Floats]:
        """Direction and axis (3,) of the roll before the wall."""
        return ways(self.incoming)

    def _split(self, s: Floats) -> tuple[Floats, Floats]:
        """The parts of advances s (...,) after and before the wall."""
        s = np.asarray(s)
        return np.maximum(s, -self.bounce), np.minimum(s + self.bounce, 0.0)

    def centre(self, s: Floats) -> Floats:
        after, before = self._split(s)
        return super().centre(after) + before[..., None] * self._came[0]

    def _turn(self, s: Floats) -> Floats:
        after, before = self._split(s)
        came = turns(self._came[1], before / self.radius)
        return quat_multiply(came, super()._turn(after))

    def _leg(self, s: Floats) -> tuple[Floats, Floats]:
        struck = (s >= -self.bounce)[..., None]
        forward, axis = super()._leg(s)
        return np.where(struck, forward, self._came[0]), np.where(struck, axis, self._came[1])

    @property
    def _struck(self) -> float:
        """Time (s) of the rebound."""
        times = np.linspace(-self.lead, self.duration, 20001)
        return float(np.interp(-self.bounce, self.pace.advance(times), times))

    def breakpoints(self) -> Floats:
        edges = super().breakpoints()
        return edges if len(edges) or not self.bounce else np.array([self._struck])

    def scenery(self) -> tuple[Prop, ...]:
        """The wall, and the goal line, whose x axis points the way that the ball must not go."""
        x, y, normal = self.wall
        brick = Piece("box", (0.004, WALL, 0.02), pose((-0.004, 0, 0.02)), BRICK)
        stripe = flat("box", (0.004, GOAL), 0.0015, WHITE)
        places = (pose((0, side * GOAL, 0.02)) for side in (1, -1))
        posts = [Piece("cylinder", (0.005, 0.02), place, RED) for place in places]
        goal = yawed(np.array(self.end[:3]) + self.line * ways(self.heading)[0], self.heading)
        return (
            Prop("wall", (brick,), standing(yawed((x, y, self.end[2]), normal)), solid=True),
            Prop("goal_line", (stripe, *posts), standing(goal)),
        )


class ReboundModel(ClosedFormModel[Rebound]):
    """A rebound keeps the speed at levels 1 and 2; at level 3 the speed drops there."""

    def candidates(self, asked: MotionRequest, streams: Streams) -> Iterator[Rebound]:
        rng = streams.shape
        strikes = bool(asked.level) and rng.random() < OFTEN
        if strikes and asked.level == 3:
            kept, share = float(rng.uniform(*SLOWED)), float(rng.uniform(0.4, 0.6))
            pace = two_speeds(asked, rng, share, kept)
        else:
            pace = draw_forward(asked, rng)
        way = pace.way
        bounce = way * float(rng.uniform(0.35, 0.55)) if strikes else 0.0
        if strikes and len(pace.edges) == 2:
            bounce = -float(pace.advance(np.array(pace.edges[0])))
        turn = float(rng.uniform(*TURN)) if strikes else 0.0
        margin = float(rng.uniform(*LATE) * pace.rate(np.array(asked.duration)))
        line = max(margin, NEAREST if asked.level else 2 * NEAREST)
        end, radius = np.asarray(asked.end_pose, float)[:2], asked.height / 2
        both = product(headings(streams), streams.direction.permutation([-1, 1]).tolist())
        for heading, side in both:
            h = np.array([np.cos(heading), np.sin(heading)])
            goal = end + line * h + np.array([[GOAL], [-GOAL]]) * [-h[1], h[0]]
            if (np.abs(goal) > EDGE).any():
                continue
            incoming = heading - side * turn
            normal = heading + side * (np.pi - turn) / 2 if strikes else heading + side * np.pi / 2
            gap = radius if strikes else radius + BESIDE
            n = np.array([np.cos(normal), np.sin(normal)])
            x, y = (end - (bounce if strikes else way / 2) * h - gap * n).tolist()
            path: dict[str, Any] = {"heading": heading, "incoming": incoming, "line": line}
            wall = (x, y, float(normal))
            yield Rebound(
                **common(asked), pace=pace, radius=radius, bounce=bounce, wall=wall, **path
            )


register(ReboundModel(Rebound))
