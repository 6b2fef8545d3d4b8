"""Grasp candidates for simple forms: round bodies, rims, boxes, bars, handles.

A candidate's pose is the tcp in the object frame: x = approach, y = opening direction. Pitch is the approach's angle below
horizontal in degrees: 90 is straight down. Candidates whose palm would certainly sit inside the object's own outline are left
out; everything else (table, reach, other bodies) is for the planner to reject. Both wrist rolls of a pinch are listed, except
where the azimuths already contain them.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from pipeline.poses import frame
from pipeline.world.objects.contract import Grasp

PITCHES = (0, 15, 30, 45, 60, 75, 90)
PALM = 0.036  # m from tcp back to the nearest palm of the supported grippers
HALF_PALM = 0.018  # m, half thickness of the palm across the opening direction
Outline = ArrayLike  # (K,2) of (radius, z): the silhouette of a round body

Grasps = tuple[Grasp, ...]


def pinch(position: ArrayLike, approach: ArrayLike, opening: ArrayLike, width: float, kind: str = "side") -> Grasp:
    """One candidate: tcp at `position`, coming along `approach`, fingers on both sides along `opening`, `width` (m) apart."""
    return Grasp(frame(position, approach, opening), float(width), kind)


def side_pinches(
    radius: float,
    heights: float | Sequence[float],
    azimuths: int = 16,
    pitches: Sequence[float] = PITCHES,
    outline: Outline | None = None,
    kind: str = "side",
) -> Grasps:
    """Pinches across the diameter of an upright round body of `radius` at `heights`, from all around, level to straight down.

    `outline` (K,2) of (radius, z) leaves out approaches whose palm would hit the body. For thick bodies the tcp stays up to 8 mm
    short of the axis so that the palm does not touch.
    """
    short = float(np.clip(radius + 0.004 - PALM, 0.0, 0.008))
    found = []
    for height in np.atleast_1d(np.asarray(heights, float)):
        for pitch in pitches:
            p = np.radians(pitch)
            retreat = short * np.cos(p)
            if outline is not None and _palm_hits(np.asarray(outline, float), retreat, height, p):
                continue
            for k in range(azimuths):
                a = 2 * np.pi * k / azimuths
                out, across = np.array([np.cos(a), np.sin(a), 0.0]), np.array([-np.sin(a), np.cos(a), 0.0])
                approach = -out * np.cos(p) - np.array([0, 0, np.sin(p)])
                position = out * retreat + [0, 0, height]
                width = 2 * radius
                found.append(pinch(position, approach, across, width, kind))
                if pitch < 90:
                    found.append(pinch(position, approach, -across, width, kind))
    return tuple(found)


def _palm_hits(outline: np.ndarray, retreat: float, height: float, pitch: float) -> bool:
    r, z = _palm_points(retreat, height, pitch)
    order = np.argsort(outline[:, 1], kind="stable")
    limit = np.interp(z, outline[order, 1], outline[order, 0], left=-1.0, right=-1.0)
    return bool(np.any(np.abs(r) < limit + 0.001))


def _palm_points(retreat: float, height: float, pitch: float) -> tuple[np.ndarray, np.ndarray]:
    t = np.linspace(-HALF_PALM, HALF_PALM, 7)
    return retreat + PALM * np.cos(pitch) - t * np.sin(pitch), height + PALM * np.sin(pitch) + t * np.cos(pitch)


def rim_pinches(
    radius: float,
    wall: float,
    height: float,
    depth: float = 0.012,
    azimuths: int = 16,
    pitches: Sequence[float] = (45, 60, 75, 90),
    flare: float = 0.0,
    kind: str = "rim",
) -> Grasps:
    """One finger inside, one outside a hollow round thing whose rim has outer `radius`, thickness `wall` and height `height`.

    The wall leans outwards by `flare` degrees; the opening is across it and the approach comes down along it, tilted along the
    rim to both sides. The tcp lies `depth` below the rim.
    """
    found = []
    f = np.radians(flare)
    for k in range(azimuths):
        a = 2 * np.pi * k / azimuths
        out, along = np.array([np.cos(a), np.sin(a), 0.0]), np.array([-np.sin(a), np.cos(a), 0.0])
        up, across = out * np.sin(f) + [0, 0, np.cos(f)], out * np.cos(f) - [0, 0, np.sin(f)]
        position = out * radius + [0, 0, height] - up * depth - across * wall / 2
        for pitch in pitches:
            p = np.radians(pitch)
            for side in (1, -1) if pitch < 90 else (1,):
                approach = side * along * np.cos(p) - up * np.sin(p)
                found += [pinch(position, approach, sign * across, wall, kind) for sign in (1, -1)]
    return tuple(found)


def box_pinches(
    hx: float,
    hy: float,
    hz: float,
    centre: ArrayLike = (0, 0, 0),
    pitches: Sequence[float] = (30, 45, 60, 75, 90),
    offsets: Sequence[float] = (-0.4, 0.0, 0.4),
    depth: float = 0.025,
    widest: float = 0.072,
    kind: str = "side",
    axes: str = "xy",
) -> Grasps:
    """Pinches of a box of half extents around `centre` (its middle) from above, tilted about the opening axis to both sides.

    Each horizontal dimension in `axes` that is at most `widest` m is pinched across, at `offsets` times the other half extent along
    the other. The tcp lies `depth` below the top, or in the middle if that is higher.
    """
    half, centre = np.array([hx, hy, hz]), np.asarray(centre, float)
    z = hz - min(depth, hz)
    found = []
    for axis in ("xy".index(a) for a in axes):
        if 2 * half[axis] > widest:
            continue
        opening, along = np.eye(3)[axis], np.eye(3)[1 - axis]
        for offset in offsets:
            shift = offset * half[1 - axis]
            for pitch in pitches:
                p = np.radians(pitch)
                for side in (1, -1):
                    a, b = _palm_points(-side * shift, z, p)
                    if np.any((np.abs(a) < half[1 - axis] + 0.001) & (np.abs(b) < hz + 0.001)):
                        continue
                    approach = side * along * np.cos(p) - np.array([0, 0, np.sin(p)])
                    if pitch == 90 and side < 0:
                        continue
                    position = centre + along * shift + [0, 0, z]
                    found += [pinch(position, approach, sign * opening, 2 * half[axis], kind) for sign in (1, -1)]
    return tuple(found)


def bar_pinches(
    positions: Sequence[float],
    radius: float,
    height: float,
    pitches: Sequence[float] = (30, 45, 60, 75, 90),
    rolls: Sequence[float] = (0,),
    kind: str = "bar",
    lift: float = 0.0,
) -> Grasps:
    """Pinches of a horizontal bar along x, axis at `height`, at x = `positions`, opening across the bar.

    The approach leans along the bar to both sides by `pitches`; `rolls` (degrees) turn the pinch about the bar, raising one finger.
    The tcp lies `lift` above the axis.
    """
    found = []
    for x in positions:
        for pitch in pitches:
            p = np.radians(pitch)
            for side in (1, -1) if pitch < 90 else (1,):
                for roll in rolls:
                    t = np.radians(roll)
                    down, across = np.array([0, np.sin(t), -np.cos(t)]), np.array([0, np.cos(t), np.sin(t)])
                    approach = np.array([side * np.cos(p), 0, 0]) + np.sin(p) * down
                    position = np.array([x, 0, height]) - lift * down
                    found += [pinch(position, approach, sign * across, 2 * radius, kind) for sign in (1, -1)]
    return tuple(found)


def handle_pinches(
    position: ArrayLike,
    along: ArrayLike,
    out: ArrayLike,
    thickness: float,
    leans: Sequence[float] = (-45, -30, -15, 0, 15, 30, 45),
    kind: str = "handle",
) -> Grasps:
    """Pinches of a straight grip at `position`: the grip runs `along`, `out` points from it towards the gripper.

    The opening is across both; the approach is -`out`, leaned by `leans` (degrees) in the plane of `along` and `out`.
    """
    along, out = np.asarray(along, float), np.asarray(out, float)
    along = along / np.linalg.norm(along)
    out = out - along * (out @ along)
    out /= np.linalg.norm(out)
    across = np.cross(out, along)
    found = []
    for lean in leans:
        t = np.radians(lean)
        approach = -out * np.cos(t) + along * np.sin(t)
        found += [pinch(position, approach, sign * across, thickness, kind) for sign in (1, -1)]
    return tuple(found)
