"""Grasp candidates for simple forms: the tcp in the object frame, x = approach, y = opening;
pitches are degrees below horizontal. One of two wrist rolls is listed; palms stay outside the
object."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from pipeline.poses import compose, yawed

from .contract import Grasp

AZIMUTHS = 2 * np.pi * np.arange(16) / 16
PITCHES = (0, 15, 30, 45, 60, 75, 90)
TILTED = (30, 45, 60, 75, 90)
PALM = 0.036  # m from tcp back to the nearest palm of the supported grippers
HALF_PALM = 0.018  # m, half thickness of the palm across the opening direction
WIDEST = 0.072  # m between the fingers
# m the tcp may stay short of the middle so that the palm keeps clear
RETREATS = (0.0, 0.004, 0.008)

Grasps = tuple[Grasp, ...]


def pinches(
    tcps: Sequence[tuple[ArrayLike, ArrayLike, ArrayLike]], width: float, kind: str = "side"
) -> Grasps:
    """Candidates from (position, approach, opening) of the tcp, fingers `width` (m) apart."""
    if not tcps:
        return ()
    position, x, y = np.array(tcps, float).transpose(1, 0, 2)
    x = x / np.linalg.norm(x, axis=1, keepdims=True)
    y = y - x * np.einsum("ij,ij->i", x, y)[:, None]
    y = y / np.linalg.norm(y, axis=1, keepdims=True)
    turn = Rotation.from_matrix(np.stack([x, y, np.cross(x, y)], axis=2)).as_quat(scalar_first=True)
    return tuple(
        Grasp(pose, float(width), kind) for pose in np.concatenate([position, turn], axis=1)
    )


def _low_enough(height: float, pitch: float, top: float) -> bool:
    """Whether the shortest fingers, at `pitch` (rad), reach 2 mm below `top`."""
    return height - 0.010 * np.sin(pitch) <= top - 0.002


def _tilts(pitches: Sequence[float]) -> Iterator[tuple[float, int]]:
    """Pitches (rad) to both sides (1, -1); straight down once."""
    for pitch in pitches:
        for side in (1, -1) if pitch < 90 else (1,):
            yield np.radians(pitch), side


def turned(grasps: Grasps, yaw: float) -> Grasps:
    """The grasps turned about z by `yaw` (rad)."""
    return tuple(replace(g, pose=compose(yawed((0, 0, 0), yaw), g.pose)) for g in grasps)


def low_heights(top: float) -> tuple[float, ...]:
    """Tcp heights (m) for taking from above; several for low things: finger ends reach 9 to 20 mm
    past it."""
    if top >= 0.035:
        return (max(0.022, top - 0.025),)
    return tuple(z for z in (0.012, 0.017, 0.022) if z <= top + 0.008)


def side_pinches(
    radius: float,
    heights: float | Sequence[float],
    pitches: Sequence[float] = PITCHES,
    outline: ArrayLike | None = None,
    kind: str = "side",
) -> Grasps:
    """Pinches across an upright round body; palms keep off `outline` (K,2) of (radius, z),
    ascending."""
    limits = np.array([(-1.0, 0.0)]) if outline is None else np.asarray(outline, float)

    def hits(r: np.ndarray, z: np.ndarray) -> bool:
        wide = np.interp(z, limits[:, 1], limits[:, 0], left=-1.0, right=-1.0)
        return bool(np.any(np.abs(r) < wide + 0.001))

    tcps = []
    for height, p in product(np.atleast_1d(np.asarray(heights, float)), np.radians(pitches)):
        retreat = _retreat(hits, height, p)
        if retreat is not None:
            for a in AZIMUTHS:
                out = np.array([np.cos(a), np.sin(a), 0.0])
                across = np.array([-np.sin(a), np.cos(a), 0.0])
                approach = -out * np.cos(p) - np.array([0, 0, np.sin(p)])
                position = out * retreat * np.cos(p) + [0, 0, height + retreat * np.sin(p)]
                tcps.append((position, approach, across))
    return pinches(tcps, 2 * radius, kind)


def _retreat(
    hits: Callable[[np.ndarray, np.ndarray], bool],
    height: float,
    pitch: float,
    retreats: Sequence[float] = RETREATS,
) -> float | None:
    t, c, s = np.linspace(-HALF_PALM, HALF_PALM, 7), np.cos(pitch), np.sin(pitch)
    backs = ((retreat, PALM + retreat) for retreat in retreats)
    free = (r for r, back in backs if not hits(back * c - t * s, height + back * s + t * c))
    return next(free, None)


def rim_pinches(
    radius: float,
    wall: float,
    height: float,
    depth: float = 0.012,
    pitches: Sequence[float] = (45, 60, 75, 90),
    flare: float = 0.0,
) -> Grasps:
    """One finger inside, one outside. The approach follows the wall, which leans outwards by
    `flare` degrees, to both sides; the tcp lies `depth` below the rim."""
    tcps = []
    f = np.radians(flare)
    for a in AZIMUTHS:
        out, along = np.array([np.cos(a), np.sin(a), 0.0]), np.array([-np.sin(a), np.cos(a), 0.0])
        up, across = out * np.sin(f) + [0, 0, np.cos(f)], out * np.cos(f) - [0, 0, np.sin(f)]
        position = out * radius + [0, 0, height] - up * depth - across * wall / 2
        for p, side in _tilts(pitches):
            tcps.append((position, side * along * np.cos(p) - up * np.sin(p), across))
    return pinches(tcps, wall, "rim")


def box_pinches(
    hx: float,
    hy: float,
    hz: float,
    centre: ArrayLike | None = None,
    heights: Sequence[float] | None = None,
    pitches: Sequence[float] = TILTED,
    offsets: Sequence[float] = (-0.4, 0.0, 0.4),
    axes: str = "xy",
    kind: str = "side",
    retreats: Sequence[float] = RETREATS,
) -> Grasps:
    """Box pinches from above, to both sides; without `centre` it stands on the table. Dimensions in
    `axes` of at most WIDEST are pinched at `offsets` times the other half extent; `heights` are
    above its base, `retreats` (m) short of the middle."""
    half = np.array([hx, hy, hz])
    base = np.array([0, 0, 0]) if centre is None else np.asarray(centre, float) - [0, 0, hz]
    grasps: Grasps = ()
    levels = low_heights(2 * hz) if heights is None else heights
    for axis in ("xy".index(a) for a in axes):
        if 2 * half[axis] > WIDEST:
            continue
        opening, along, reach = np.eye(3)[axis], np.eye(3)[1 - axis], half[1 - axis]
        tcps = []
        for shift, height, tilt in product(np.array(offsets) * reach, levels, _tilts(pitches)):
            p, side = tilt

            def hits(
                r: np.ndarray, z: np.ndarray, middle: float = side * shift, reach: float = reach
            ) -> bool:
                beside = np.abs(r - middle) < reach + 0.001
                return bool(np.any(beside & (z < 2 * hz + 0.001) & (z > 0)))

            retreat = _retreat(hits, height, p, retreats)
            if retreat is not None and _low_enough(height, p, 2 * hz):
                approach = side * along * np.cos(p) - np.array([0, 0, np.sin(p)])
                position = base + along * shift + [0, 0, height] - approach * retreat
                tcps.append((position, approach, opening))
        grasps += pinches(tcps, 2 * half[axis], kind)
    return grasps


def bar_pinches(
    positions: Sequence[float],
    radius: float,
    height: float,
    pitches: Sequence[float] = TILTED,
    rolls: Sequence[float] = (0,),
    kind: str = "bar",
) -> Grasps:
    """Pinches of a horizontal bar along x: the approach leans along it by `pitches`, turned about
    it by `rolls` (degrees)."""
    lifts = sorted({max(0.0, z - height) for z in low_heights(height + radius)})
    tcps = []
    for x, (p, side), t in product(positions, _tilts(pitches), np.radians(rolls)):
        down = np.array([0, np.sin(t), -np.cos(t)])
        across = np.array([0, np.cos(t), np.sin(t)])
        approach = np.array([side * np.cos(p), 0, 0]) + np.sin(p) * down
        low = [lift for lift in lifts if _low_enough(lift, p, 0.6 * radius)]
        tcps += [(np.array([x, 0, height]) - lift * down, approach, across) for lift in low]
    return pinches(tcps, 2 * radius, kind)


def handle_pinches(
    position: ArrayLike,
    along: ArrayLike,
    out: ArrayLike,
    thickness: float,
    leans: Sequence[float] = (-45, -30, -15, 0, 15, 30, 45),
    kind: str = "handle",
) -> Grasps:
    """Pinches of a grip `along` (3,); the approach is -`out` (3,), leaned by `leans` (degrees) in
    their plane."""
    along, out = np.asarray(along, float), np.asarray(out, float)
    along = along / np.linalg.norm(along)
    out = out - along * (out @ along)
    out /= np.linalg.norm(out)
    across, angles = np.cross(out, along), np.radians(leans)
    tcps = [(position, -out * np.cos(t) + along * np.sin(t), across) for t in angles]
    return pinches(tcps, thickness, kind)
