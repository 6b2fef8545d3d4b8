"""A low shoe, its toe towards +x."""

import numpy as np

from pipeline.poses import quat_about
from pipeline.world.looks.materials import fabric, plastic, rubber, wrapped
from pipeline.world.shapes import Mesh, Shape

from ...colliders import convex_collider
from ...contract import Grasp, NamedFrames, register
from ...geometry import at, capsule, ellipse, extrude, loft, revolve, scaled, sphere
from ...grasping import box_pinches
from ...kit import COLOURS, LARGE, Parametric, between, drawn, mark, one_of, standing, texture
from ...surface import finish

# Along the shoe from heel (0) to toe (1): half width as a share of the ball's, height of the ridge
# as a share of the collar's.
STATIONS = np.array([0.0, 0.04, 0.12, 0.25, 0.38, 0.5, 0.62, 0.75, 0.87, 0.95, 1.0])
WIDTHS = np.array([0.42, 0.62, 0.74, 0.77, 0.78, 0.85, 0.95, 1.0, 0.88, 0.62, 0.3])
RIDGE = np.array([0.80, 0.96, 1.0, 0.97, 0.93, 0.82, 0.68, 0.57, 0.5, 0.42, 0.32])

FLANK = ((1.0, 0.0), (1.02, 0.25), (0.97, 0.5), (0.86, 0.72), (0.6, 0.92), (0.25, 1.0))
COLLAR = ((1.0, 0.0), (1.04, 0.45), (0.97, 0.95), (0.87, 0.95), (0.80, 0.4))
"""Radius and height, as shares, of the padding round the opening."""


@register("shoe")
class Shoe(Parametric):
    length: float = between(0.19, 0.24, size=LARGE)
    colour: str = one_of(COLOURS)
    half: float = between(0.036, 0.041)  # half width at the ball
    sole: float = between(0.016, 0.026)  # thickness of the sole
    height: float = between(0.075, 0.092)  # of the collar
    laces: int = drawn(lambda rng, so_far: int(rng.integers(3, 6)))
    sole_colour: str = one_of(("white", "black", "beige", "gray", "brown"), says="sole")
    stripe: str = one_of(COLOURS, other_than="colour", says="stripes")
    seed: int = texture()

    def x(self, share: np.ndarray | float) -> np.ndarray:
        """The x (m) at a share of the length from the heel."""
        return (np.asarray(share) - 0.5) * self.length

    def sections(self) -> np.ndarray:
        """Upright arches (S,K,3) from heel to toe."""
        flank = np.array(FLANK)
        arch = np.concatenate([flank, flank[::-1] * [-1, 1]])
        rings = []
        for s, w, r in zip(STATIONS, WIDTHS, RIDGE, strict=True):
            y = arch[:, 0] * w * self.half * 0.96
            z = 0.8 * self.sole + arch[:, 1] * (r * self.height - 0.8 * self.sole)
            rings.append(np.column_stack([np.full(len(arch), float(self.x(s)) * 0.985), y, z]))
        return np.array(rings)

    def outline(self, grow: float = 1.0) -> np.ndarray:
        """Outline (K,2) of the sole, counter-clockwise."""
        right = np.column_stack([self.x(STATIONS), -grow * WIDTHS * self.half])
        return np.concatenate([right, right[::-1] * [1, -1]])

    def _top(self, share: float) -> float:
        return float(np.interp(share, STATIONS, RIDGE)) * self.height

    def _details(self) -> list[tuple[Mesh, str]]:
        parts, across = [], quat_about((1, 0, 0), np.pi / 2)
        tilt = float(np.arctan2(self._top(0.42) - self._top(0.72), 0.3 * self.length))
        for k in range(self.laces):
            share = 0.47 + 0.2 * k / max(self.laces - 1, 1)
            place = (float(self.x(share)), 0, self._top(share) + 0.001)
            lace = at(capsule(0.0024, 0.36 * self.half, 3, 4), place, across)
            parts.append((lace, "charcoal" if self.colour in ("white", "beige") else "white"))
        x, z, level = float(self.x(0.21)), self._top(0.21), quat_about((0, 1, 0), 0.06)
        hole = extrude(ellipse(0.150 * self.length, 0.52 * self.half, 18), 0.004)
        collar = scaled(revolve(COLLAR, 14, 60), 0.174 * self.length, 0.64 * self.half, 0.015)
        parts.append((at(hole, (x, 0, z - 0.0018), level), "black"))
        parts.append((at(collar, (x, 0, z - 0.0085), level), self.colour))
        tongue = scaled(sphere(1.0, 5, 8), 0.032, 0.50 * self.half, 0.004)
        place = (float(self.x(0.415)), 0, self._top(0.415) + 0.001)
        parts.append((at(tongue, place, quat_about((0, 1, 0), tilt - 0.42)), self.colour))
        return parts

    def _stripes(self) -> list[Mesh]:
        rings = self.sections()
        flat = rings.reshape(len(rings), -1)
        stripes = []
        for share in (0.52, 0.58, 0.64):
            sides = (share - 0.014, share + 0.014)
            columns = [[np.interp(s, STATIONS, c) for c in flat.T] for s in sides]
            ends = np.array(columns).reshape(2, *rings.shape[1:])
            for flank in (slice(0, 4), slice(8, 12)):
                stripes.append(_ribbon(*(end[flank] * [1, 1.02, 1] for end in ends)))
        return stripes

    def shape(self) -> Shape:
        rings = self.sections()
        tread = 0.28 * self.sole
        sole = at(extrude(self.outline(1.03), self.sole - tread), (0, 0, tread))
        upper = loft(rings, crease=60)
        cloth = wrapped("upper", self.colour, self.seed, 0.75, 256)
        profile = extrude(self.outline(1.045), tread - 0.0003)
        solid = [convex_collider(_with_floor(rings[a:b])) for a, b in ((0, 5), (4, 8), (7, 11))]
        return Shape(
            (
                (sole, rubber(self.sole_colour)),
                (profile, rubber("brown" if self.sole_colour == "black" else "charcoal")),
                (upper, cloth),
                *((m, plastic(self.stripe)) for m in self._stripes()),
                *((m, fabric(c)) for m, c in self._details()),
            ),
            tuple(c for piece in solid for c in piece),
            mass=0.25 * self.length / 0.22,
            friction=0.8,
        )

    def frames(self) -> NamedFrames:
        x, grasps = float(self.x(0.2)), list[Grasp]()
        for share, out in ((0.2, 0.5), (0.45, 0.4)):  # the centre of mass is at 0.45
            wide, top = float(np.interp(share, STATIONS, WIDTHS)), self._top(share)
            half, middle = (0.1 * self.length, self.half * 0.97 * wide), float(self.x(share))
            heights, offsets = (0.5 * top, 0.65 * top), (-out, 0.0, out)
            place = (middle, 0, top / 2)
            grasps += box_pinches(*half, top / 2, place, heights, offsets=offsets, axes="y")
        return standing(
            self.height,
            grasps,
            top=mark(x, 0, self.height),
            toe=mark(self.length / 2, 0, self.sole, (1, 0, 0), (0, 0, 1)),
            heel=mark(x, 0, 0.62 * self.height),
        )


def _with_floor(rings: np.ndarray) -> np.ndarray:
    points = rings.reshape(-1, 3)
    floor = rings[:, [0, -1]].reshape(-1, 3) * [1.0, 1.05, 0.0]
    return np.concatenate([points, floor])


def _ribbon(a: np.ndarray, b: np.ndarray) -> Mesh:
    n = len(a)
    i = np.arange(n - 1)
    faces = np.concatenate([np.stack([i, i + n + 1, i + n], 1), np.stack([i, i + 1, i + n + 1], 1)])
    return finish(np.concatenate([a, b]), faces, crease=60)
