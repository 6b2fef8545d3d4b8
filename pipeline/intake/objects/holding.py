"""Where two fingers can hold an object: opposite sides on horizontal lines through its convex
pieces.

Both sides must face each other, with material beside and room for fingers and palm.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import cache
from itertools import product

import numpy as np

from pipeline.poses import Bools, Floats, Ints
from pipeline.world.objects.contract import Grasp
from pipeline.world.objects.grasping import HALF_PALM, PALM, RETREATS, WIDEST, pinches
from pipeline.world.shapes import Collider

from .standing import bounds, inside, planes

OPENINGS = 16  # directions in the half circle
PITCHES = np.radians([0, 15, 30, 45, 60, 75, 90])
SPACING = 0.006  # m between lines, at least
LINES = 24  # per edge of the outline, at most
FACING = np.cos(np.radians(28))  # friction holds on sides that face each other within this
PAD, EVEN = 1, 0.004  # neighbours of a line that must be as wide, within m
FINGER = (0.002, 0.008, 0.014)  # m beyond the pads where a finger is
LOW = 0.022  # m: below, the tcp stays back so that fingers keep off the table
FROM_ABOVE = np.radians(45)  # how steeply a wall is taken at least
# m between pieces that touch, and behind a wall that a finger goes behind
SEAM, HOLLOW = 0.0005, 0.02
TIP, TABLE = 0.012, 0.004  # m the fingers reach past the tcp, and stay above the table
KEPT = 160

type Spans = tuple[Floats, Floats, Bools]


def two_finger_grasps(pieces: Sequence[Collider]) -> tuple[Grasp, ...]:
    """Grasps in the standing frame; none without a narrow part."""
    halves = np.pi * np.arange(OPENINGS) / OPENINGS
    found = [row for angle in halves for row in _along(pieces, angle, _spans, 0.0)]
    found += [row for angle in 2 * halves for row in _along(pieces, angle, _walls, FROM_ABOVE)]
    if not found:
        return ()
    rows = np.array([(*p, *a, *o, w) for p, a, o, w in found])
    chosen = _spread(rows, bounds(pieces))
    return tuple(pinches([(row[:3], row[3:6], row[6:9])], row[9])[0] for row in rows[chosen])


def _along(
    pieces: Sequence[Collider], angle: float, spans: Callable[..., Spans], least: float
) -> Iterator[tuple[Floats, Floats, Floats, float]]:
    """Grasps that open in one direction, pitched down by at least `least` (rad)."""
    opening = np.array([np.cos(angle), np.sin(angle), 0.0])
    level = np.array([-np.sin(angle), np.cos(angle), 0.0])
    top = float(bounds(pieces)[1, 2])
    corners = np.concatenate([one.support_points() for one in pieces]) @ level
    steps = _steps(corners.min(), corners.max()), _steps(0.0, top)
    grid = np.stack(np.meshgrid(*steps, indexing="ij"), -1)
    origins = grid[..., :1] * level + grid[..., 1:] * [0, 0, 1]
    lower, upper, facing = spans(pieces, origins.reshape(-1, 3), opening)
    shape = grid.shape[:2]
    lower, upper, facing = lower.reshape(shape), upper.reshape(shape), facing.reshape(shape)
    width = upper - lower
    good = (width > 0.002) & (width <= WIDEST) & facing & _even(lower) & _even(upper)
    for i, k in np.argwhere(good):
        at, wide = origins[i, k] + opening * (lower[i, k] + upper[i, k]) / 2, float(width[i, k])
        for approach in _approaches(level, float(at[2]), top):
            if -approach[2] >= np.sin(least) - 1e-6:
                tcp = _room(pieces, at, approach, opening, wide)
                if tcp is not None:
                    yield tcp, approach, opening, wide


def pinch_at(
    pieces: Sequence[Collider], at: Floats, approach: Floats, opening: Floats
) -> Grasp | None:
    """The grasp along `approach` and `opening` through `at` (3,), or None."""
    lower, upper, _ = (float(each[0]) for each in _spans(pieces, at[None], opening))
    if not 0.002 < upper - lower <= WIDEST:
        return None
    tcp = _room(pieces, at + opening * (lower + upper) / 2, approach, opening, upper - lower)
    return None if tcp is None else pinches([(tcp, approach, opening)], upper - lower)[0]


def _steps(low: float, high: float) -> Floats:
    count = int(np.clip((high - low) / SPACING, 3, LINES))
    return low + (np.arange(count) + 0.5) / count * (high - low)


def _approaches(level: Floats, height: float, top: float) -> Iterator[Floats]:
    for pitch in PITCHES:
        tip = height - TIP * np.sin(pitch)
        if tip < TABLE or (pitch > 0 and height - 0.010 * np.sin(pitch) > top - 0.002):
            continue
        for side in (1, -1) if pitch < PITCHES[-1] else (1,):
            yield side * level * np.cos(pitch) - np.array([0, 0, np.sin(pitch)])


def _spans(pieces: Sequence[Collider], origins: Floats, direction: Floats) -> Spans:
    """Where lines (N) enter and leave the pieces (m), and whether those sides face each other;
    inf if they miss.
    """
    lower, upper, enter, leave = _through(pieces, origins, direction)
    first, last = lower.argmin(0), upper.argmax(0)
    n = np.arange(len(origins))
    return lower[first, n], upper[last, n], (enter[first, n] > FACING) & (leave[last, n] > FACING)


def _walls(pieces: Sequence[Collider], origins: Floats, direction: Floats) -> Spans:
    """As `_spans`, of the first wall before a hollow."""
    lower, upper, enter, leave = _through(pieces, origins, direction)
    n, order = np.arange(len(origins)), lower.argsort(0)
    starts, ends = np.take_along_axis(lower, order, 0), np.take_along_axis(upper, order, 0)
    last, reach = order[0].copy(), ends[0].copy()
    joined = np.isfinite(starts[0])
    for start, end, number in zip(starts[1:], ends[1:], order[1:], strict=True):
        joined = joined & (start <= reach + SEAM)
        further = joined & (end > reach)
        last[further], reach[further] = number[further], end[further]
    beyond = np.where(starts > reach + SEAM, starts, np.inf).min(0)
    hollow = np.isfinite(beyond) & (beyond - reach > HOLLOW)
    facing = hollow & (enter[order[0], n] > FACING) & (leave[last, n] > FACING)
    return np.where(hollow, starts[0], np.inf), np.where(hollow, reach, -np.inf), facing


def _through(
    pieces: Sequence[Collider], origins: Floats, direction: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Where lines (N) enter and leave each piece (K,N), and its sides' cosines."""
    lower = np.full((len(pieces), len(origins)), np.inf)
    upper = np.full(lower.shape, -np.inf)
    enter, leave = np.zeros(lower.shape), np.zeros(lower.shape)
    for k, one in enumerate(pieces):
        normals, offsets = planes(one)
        slope, distance = normals @ direction, origins @ normals.T + offsets
        with np.errstate(divide="ignore", invalid="ignore"):
            t = -distance / slope
        first = np.where(slope < -1e-9, t, -np.inf)
        last = np.where(slope > 1e-9, t, np.inf)
        a, b = first.max(1), last.min(1)
        hit = (a < b) & ~((np.abs(slope) <= 1e-9) & (distance > 0)).any(1)
        lower[k, hit], enter[k, hit] = a[hit], -slope[first.argmax(1)][hit]
        upper[k, hit], leave[k, hit] = b[hit], slope[last.argmin(1)][hit]
    return lower, upper, enter, leave


def _even(side: Floats) -> Bools:
    """Where three of the four neighbours of a line end as it does."""
    padded, (rows, columns) = np.pad(side, PAD, constant_values=np.inf), side.shape
    corners = ((2, 1), (0, 1), (1, 2), (1, 0))
    near = [padded[i : i + rows, k : k + columns] for i, k in corners]
    with np.errstate(invalid="ignore"):
        return np.sum([np.abs(other - side) < EVEN for other in near], axis=0) >= 3


def _room(
    pieces: Sequence[Collider], at: Floats, approach: Floats, opening: Floats, width: float
) -> Floats | None:
    points, sides = _hand_at_rest()
    turn = np.stack([approach, opening, np.cross(approach, opening)])
    hand = (points + sides * width / 2) @ turn
    for retreat in sorted(RETREATS, reverse=bool(at[2] < LOW)):
        tcp = at - retreat * approach
        if not inside(pieces, hand + tcp).any():
            return tcp
    return None


@cache
def _hand_at_rest() -> tuple[Floats, Floats]:
    """Points (N,3) of a closed hand at the tcp, and their motion (N,3) per metre of opening."""
    deep, thick = np.linspace(-PALM, TIP, 13), (-0.007, 0.0, 0.007)
    fingers = [
        (x, side * out, t, side) for x, side, out, t in product(deep, (-1, 1), FINGER, thick)
    ]
    shares, high = (-1, -0.5, 0, 0.5, 1), (-HALF_PALM, 0, HALF_PALM)
    palm = [(-PALM - b, s * 0.016, t, s) for b, s, t in product((0.0, 0.02), shares, high)]
    rows = np.array([*fingers, *palm])
    return rows[:, :3], rows[:, 3:] * [0.0, 1.0, 0.0]


def _spread(rows: Floats, box: Floats) -> Ints:
    """Kept rows: the most central, then always the one most unlike the others."""
    size = float(np.linalg.norm(box[1] - box[0]))
    ways = [rows[:, :3] / size, 0.25 * rows[:, 3:6], 0.25 * np.abs(rows[:, 6:9])]
    places = np.concatenate(ways, axis=1)
    middle = (box[0] + box[1]) / 2
    first = int(np.argmin(np.linalg.norm(rows[:, :3] - middle, axis=1)))
    chosen, far = [first], np.linalg.norm(places - places[first], axis=1)
    while len(chosen) < min(KEPT, len(rows)) and far.max() > 1e-6:
        chosen.append(int(far.argmax()))
        far = np.minimum(far, np.linalg.norm(places - places[chosen[-1]], axis=1))
    return np.array(chosen)
