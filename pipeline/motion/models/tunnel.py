"""The target is hidden in a tunnel, or turns back inside a hood."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from pipeline.poses import Floats, yawed

from ..closed_form import Along, ClosedFormModel, ahead_of, common, headings, twists
from ..contract import MotionRequest, Streams
from ..pace import draw_forward, two_speeds
from ..scenery import Prop, hood, standing
from . import register
from .conveyor import Conveyor

CLEAR = (0.035, 0.055)  # m between the exit and the target at the meeting
SHORTEST, LONGEST, SEEN = 0.045, 0.16, 0.03  # m: tunnel beyond the target, tunnel, path before
TRIES = 8
ROOM = 0.012  # m between the target and the walls


@dataclass(frozen=True)
class Tunnel(Conveyor):
    """Straight on through a tunnel of `length` m, whose exit is `clear` m before the end."""

    kind: ClassVar[str] = "tunnel"
    clear: float
    length: float
    height: float

    def scenery(self) -> tuple[Prop, ...]:
        middle = self.at(np.array(-self.clear - self.length / 2))
        pieces = hood(self.length / 2, self.width / 2, self.height)
        return (Prop("tunnel", pieces, standing(yawed(middle[:3], self.heading)), solid=True),)


class TunnelModel(ClosedFormModel[Tunnel]):
    """The target never goes back. The first of TRIES paces that begins before the tunnel counts."""

    def shape(self, asked: MotionRequest, streams: Streams) -> dict[str, Any]:
        radius, rng = asked.radius, streams.shape
        clear = radius + float(rng.uniform(*CLEAR))
        far = clear + 3 * radius + SHORTEST + SEEN
        paces = [draw_forward(asked, rng) for _ in range(TRIES)]
        longest = max(paces, key=lambda pace: pace.way)
        pace = next((pace for pace in paces if pace.way > far), longest)
        way = pace.way
        length = float(np.clip(way - clear - radius - SEEN, 2 * radius + SHORTEST, LONGEST))
        sizes = {"width": 2 * (radius + ROOM), "length": length, "height": asked.height + ROOM}
        return {"pace": pace, "clear": clear, **sizes}


LANES = (0.025, 0.035)  # m, half the distance of the two lanes
FASTER, TURNED = 1.6, 0.66  # speed of the second pass over the first, time share of the first
HALF = 0.45  # share of the way that the second pass takes


@dataclass(frozen=True)
class Twice(Along):
    """A first pass on a lane to the `side` (+1 left). A hood hides the half circle of `turn` m."""

    kind: ClassVar[str] = "twice"
    heading: float
    side: int
    turn: float
    back: float
    radius: float
    height: float

    def _parts(self, s: Floats) -> tuple[Floats, Floats, Floats]:
        """The angle turned back (rad) and what is left of the second and first pass (m)."""
        arc = np.pi * self.turn
        angle = np.clip((-self.back - s) / self.turn, 0.0, np.pi)
        return angle, np.maximum(s, -self.back), np.maximum(-self.back - arc - s, 0.0)

    def at(self, s: Floats) -> Floats:
        angle, second, first = self._parts(np.asarray(s))
        ahead = second - self.turn * np.sin(angle) + first
        aside = self.side * self.turn * (1 - np.cos(angle))
        return self.carried_by(*ahead_of(self.heading, ahead, aside))

    def slope(self, s: Floats) -> Floats:
        angle = self._parts(np.asarray(s))[0]
        return twists(*ahead_of(self.heading, np.cos(angle), -self.side * np.sin(angle)))

    def scenery(self) -> tuple[Prop, ...]:
        front, rear = -self.back + self.radius, -self.back - self.turn - self.radius - ROOM
        middle = np.array((front + rear) / 2), np.array(self.side * self.turn)
        x, y = ahead_of(self.heading, *middle)
        at = yawed(np.array([self.end[0] + x, self.end[1] + y, self.end[2]]), self.heading)
        wide = self.turn + self.radius + ROOM
        pieces = hood((front - rear) / 2, wide, self.height + ROOM)
        return (Prop("hood", pieces, standing(at), solid=True),)


class TwiceModel(ClosedFormModel[Twice]):
    def candidates(self, asked: MotionRequest, streams: Streams) -> Iterator[Twice]:
        rng = streams.shape
        pace = (
            two_speeds(asked, rng, TURNED, FASTER) if asked.level == 3 else draw_forward(asked, rng)
        )
        way = pace.way
        turn = max(0.01, min(float(rng.uniform(*LANES)), 0.12 * way))
        second = -float(pace.advance(np.array(pace.edges[0]))) if asked.level == 3 else HALF * way
        back = max(0.08, second - np.pi * turn / 2)
        for heading in headings(streams):
            yield Twice(
                **common(asked),
                pace=pace,
                heading=heading,
                side=int(streams.direction.choice([-1, 1])),
                turn=turn,
                back=back,
                radius=asked.radius,
                height=asked.height,
            )


register(TunnelModel(Tunnel))
register(TwiceModel(Twice))
