"""A sliding disc, pushed, then left to friction and cushions."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pipeline.poses import Floats, pose, quat_multiply, quat_rotate, yawed

from ..closed_form import ClosedForm, ClosedFormModel, common, headings, turns, twists
from ..contract import MotionRequest, Streams
from ..scenery import Piece, Prop, standing
from . import register

PUSH = 0.12  # share of the time for which it is pushed
# share of its speed that friction leaves it at the meeting
KEPT = {1: (0.75, 0.95), 2: (0.15, 0.50), 3: (0.45, 0.80)}
BOUNCES = (((0.35, 0.5), (0.65, 0.85)), ((0.4, 0.85),))  # shares of the time: of two, of one
RESTITUTION, CUSHION_FRICTION = (0.5, 0.9), (0.05, 0.3)
GLANCE = (0.5, 1.2)  # rad between its path and the normal of a cushion
SLOWEST, LEAST_END = 0.5, 0.05  # shares of alpha: mean speed, and speed at the meeting
STEEL, FELT = (0.55, 0.56, 0.60), (0.10, 0.36, 0.22)
HIGH = 0.012  # m, half height of paddle and cushions


class Sliding(NamedTuple):
    """A piece of a path from time `t` (s): place (m), angles (rad), speed, spin, and their decrease
    by friction, negative in a push."""

    t: float
    x: float
    y: float
    yaw: float
    direction: float
    speed: float
    slowing: float
    spin: float
    spin_slowing: float

    def at(self, t: ArrayLike) -> tuple[Floats, Floats, Floats, Floats]:
        """Distance (m), speed, angle (rad), spin, (...,) each, at t >= self.t."""
        gone = np.asarray(t, float) - self.t
        moving = gone if self.slowing <= 0 else np.minimum(gone, self.speed / self.slowing)
        turning = gone
        if self.spin_slowing > 0:
            turning = np.minimum(gone, abs(self.spin) / self.spin_slowing)
        sense = np.sign(self.spin)
        return (
            self.speed * moving - self.slowing * moving**2 / 2,
            self.speed - self.slowing * moving,
            self.spin * turning - sense * self.spin_slowing * turning**2 / 2,
            self.spin - sense * self.spin_slowing * turning,
        )

    def later(self, t: float) -> "Sliding":
        distance, speed, turned, spin = (float(value) for value in self.at(t))
        x = float(self.x + distance * np.cos(self.direction))
        y = float(self.y + distance * np.sin(self.direction))
        return self._replace(t=t, x=x, y=y, yaw=self.yaw + turned, speed=speed, spin=spin)

    def bounced(
        self, normal: float, restitution: float, friction: float, radius: float
    ) -> "Sliding":
        """After a cushion with `normal` (rad): `restitution` of the velocity into it, and Coulomb
        friction on the disc (moment of inertia m r^2 / 2)."""
        into = -self.speed * np.cos(self.direction - normal)
        along = self.speed * np.sin(self.direction - normal)
        slip = along - radius * self.spin
        most = friction * (1 + restitution) * into
        rubbed = float(np.clip(slip / 3, -most, most))
        along -= rubbed
        direction = normal + np.arctan2(along, restitution * into)
        speed, spin = float(np.hypot(along, restitution * into)), self.spin + 2 * rubbed / radius
        return self._replace(direction=float(direction), speed=speed, spin=float(spin))


@dataclass(frozen=True)
class Pushed(ClosedForm):
    """Pieces of a slide in the world, yaw relative to the end's. `normals` (rad) are those of the
    cushions struck, `radius` (m) the target's."""

    kind: ClassVar[str] = "pushed"
    pieces: tuple[Sliding, ...]
    normals: tuple[float, ...]
    radius: float
    friction: float
    restitution: float

    def _located(self, t: Floats) -> tuple[Floats, Floats]:
        k = np.clip(np.searchsorted([p.t for p in self.pieces], t, side="right") - 1, 0, None)
        values = np.array([[*p.at(t), np.full(np.shape(t), p.direction)] for p in self.pieces])
        origin = np.array([(p.x, p.y, p.yaw) for p in self.pieces])[k]
        picked = np.take_along_axis(values, np.broadcast_to(k, (1, 5, *np.shape(t))), 0)[0]
        return np.moveaxis(picked, 0, -1), origin

    def place(self, t: Floats) -> Floats:
        located, origin = self._located(t)
        distance, _, turned, _, direction = np.moveaxis(located, -1, 0)
        poses = np.broadcast_to(np.array(self.end), (*np.shape(t), 7)).copy()
        poses[..., 0] = origin[..., 0] + distance * np.cos(direction)
        poses[..., 1] = origin[..., 1] + distance * np.sin(direction)
        turn = turns((0, 0, 1), origin[..., 2] + turned)
        poses[..., 3:] = quat_multiply(turn, np.array(self.end[3:]))
        return poses

    def rates(self, t: Floats) -> Floats:
        _, speed, _, spin, direction = np.moveaxis(self._located(t)[0], -1, 0)
        return twists(speed * np.cos(direction), speed * np.sin(direction), spin=spin)

    def breakpoints(self) -> Floats:
        return np.array([p.t for p in self.pieces[len(self.pieces) - len(self.normals) :]])

    def scenery(self) -> tuple[Prop, ...]:
        first, ended, back = self.pieces[0], self.pieces[1].t, self.radius + 0.005
        blade = Piece("box", (0.005, self.radius, HIGH), pose((-back, 0, HIGH)), STEEL)
        handle = Piece("box", (0.04, 0.006, 0.006), pose((-back - 0.045, 0, 2 * HIGH)), STEEL)
        props = [Prop("paddle", (blade, handle), partial(self._behind, first.direction, ended))]
        for k, normal in enumerate(self.normals):
            struck = self.pieces[len(self.pieces) - len(self.normals) + k]
            at = (struck.x - back * np.cos(normal), struck.y - back * np.sin(normal), self.end[2])
            wall = Piece("box", (0.005, 0.06, HIGH), pose((0, 0, HIGH)), FELT)
            props.append(Prop(f"cushion_{k + 1}", (wall,), standing(yawed(at, normal)), solid=True))
        return tuple(props)

    def _behind(self, direction: float, ended: float, t: ArrayLike) -> Floats:
        poses = self.pose(np.minimum(np.asarray(t, float), ended))
        poses[..., 3:] = yawed((0, 0, 0), direction)[3:]
        return poses


class PushedModel(ClosedFormModel[Pushed]):
    """One simulated slide is laid into the world in one direction after another."""

    def candidates(self, asked: MotionRequest, streams: Streams) -> Iterator[Pushed]:
        slides, normals, restitution = _simulated(asked, streams.shape)
        while asked.level and slides[-1].later(asked.duration).speed < LEAST_END * asked.alpha:
            slides, normals, restitution = _simulated(asked, streams.shape)
        end, (x, y, *_) = slides[-1].later(asked.duration), asked.end.tolist()
        for heading in headings(streams):
            turn, placed = yawed((0, 0, 0), heading)[3:], list[Sliding]()
            for one in slides:
                way = np.array([one.x - end.x, one.y - end.y, 0.0])
                dx, dy, _ = quat_rotate(turn, way).tolist()
                yaw, direction = one.yaw - end.yaw, one.direction + heading
                placed.append(one._replace(x=x + dx, y=y + dy, yaw=yaw, direction=direction))
            turned = tuple(normal + heading for normal in normals)
            fields = common(asked) | {"pieces": tuple(placed), "normals": turned}
            fields |= {"radius": asked.radius, "friction": slides[-1].slowing / 9.81}
            yield Pushed(**fields, restitution=restitution)


def _simulated(
    asked: MotionRequest, rng: np.random.Generator
) -> tuple[list[Sliding], list[float], float]:
    """Slides, normals and restitution, simulated at 1 m/s and scaled: all laws are linear."""
    total, kept = asked.lead + asked.duration, float(rng.uniform(*KEPT[max(asked.level, 1)]))
    pushed = PUSH * total
    restitution, friction = (float(rng.uniform(*r)) for r in (RESTITUTION, CUSHION_FRICTION))
    slowing = (1 - kept) / (total - pushed)
    first = Sliding(-asked.lead, 0.0, 0.0, 0.0, 0.0, 0.0, -1 / pushed, 0.0, 0.0)
    slides = [first, first.later(pushed - asked.lead)._replace(slowing=slowing)]
    normals = list[float]()
    if asked.level == 3:
        is_single = int(rng.integers(1, 3)) == 1
        for at in [rng.uniform(*share) for share in BOUNCES[is_single]]:
            struck = slides[-1].later(float(at) * total - asked.lead)
            normal = struck.direction + np.pi + float(rng.uniform(*GLANCE) * rng.choice([-1, 1]))
            after = struck.bounced(normal, restitution, friction, asked.radius)
            slides.append(after._replace(spin_slowing=4 / 3 * slowing / asked.radius))
            normals.append(float(normal))
    ends = [one.t for one in slides[1:]] + [asked.duration]
    way = sum(float(one.at(end)[0]) for one, end in zip(slides, ends, strict=True))
    speed = asked.alpha * rng.uniform(SLOWEST, 1.0) if asked.level else 0.0
    scale = speed * (1.0 if asked.speed_bound == "maximum" else total / way)
    scaled = (
        [v if name in ("t", "direction") else v * scale for name, v in one._asdict().items()]
        for one in slides
    )
    return [Sliding(*values) for values in scaled], normals, restitution


register(PushedModel(Pushed))
