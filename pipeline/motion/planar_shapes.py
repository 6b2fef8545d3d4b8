"""Candidates for the motion of levels 1, 2 and 3, drawn in batches after appendix D.3 of the paper.

Starts and intermediate points are drawn within alpha * total of the end: the paper's distribution
conditioned on acceptance. It accepts 1 level 3 candidate in 80, the plain draw 1 in 400."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

from pipeline.poses import Bools, Floats, Ints

from .contract import MotionRequest
from .planar import interpolation
from .workspace import Workspace, draw_within_reach

TERMS = 5
MAX_PIECES = 3
# A piece of Dirichlet length near zero is a teleport that no frame shows. 0.1 s is one and a half
# recorded frames.
SHORTEST_PIECE = 0.1
MISS = 1e-9
QUANTILES = 10_000


@dataclass(frozen=True, eq=False)
class DrawnPaths:
    """N paths of up to S pieces: `durations` (N,S) s, 0 if unused; `coefficients` (N,S,2,5) m over
    normalised time; `missed` (N,)."""

    durations: Floats
    coefficients: Floats
    missed: Bools

    def only(self, i: int) -> "DrawnPaths":
        one = slice(i, i + 1)
        return DrawnPaths(self.durations[one], self.coefficients[one], self.missed[one])


def turned(path: DrawnPaths, angles: Floats, mirrored: Bools, end: ArrayLike) -> DrawnPaths:
    """One path (a batch of 1) turned about its `end` by `angles` (N,) rad, reflected first if
    `mirrored`."""
    n, c, s = len(angles), np.cos(angles), np.sin(angles)
    flip = np.where(mirrored, -1.0, 1.0)
    turn = np.stack([np.stack([c, -s * flip], -1), np.stack([s, c * flip], -1)], 1)
    origin = np.zeros((2, TERMS))
    origin[:, 0] = np.asarray(end, float)
    used = (path.durations[0] > 0)[:, None, None]
    coefficients = np.einsum("nij,sjk->nsik", turn, (path.coefficients[0] - origin) * used)
    coefficients += origin * used
    return DrawnPaths(np.repeat(path.durations, n, 0), coefficients, np.repeat(path.missed, n))


def draw_level_1(rng: np.random.Generator, n: int, asked: MotionRequest) -> DrawnPaths:
    """Constant velocity: speed |N(0.8 alpha, alpha/3)| clipped to [0.01, alpha] m/s."""
    alpha = asked.alpha
    speed = np.clip(np.abs(rng.normal(0.8 * alpha, alpha / 3, n)), min(0.01, alpha), alpha)
    angle = rng.uniform(0.0, 2 * np.pi, n)
    travel = (speed * asked.total)[:, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    c = np.zeros((n, 1, 2, TERMS))
    c[:, 0, :, 0], c[:, 0, :, 1] = asked.end[:2] - travel, travel
    return DrawnPaths(np.full((n, 1), asked.total), c, np.zeros(n, bool))


def mean_speed(alpha: float) -> float:
    """The mean (m/s) of the speeds that `draw_level_1` draws."""
    z = ndtri((np.arange(QUANTILES) + 0.5) / QUANTILES)
    return float(np.clip(np.abs(0.8 * alpha + z * alpha / 3), min(0.01, alpha), alpha).mean())


def draw_level_2(rng: np.random.Generator, n: int, asked: MotionRequest) -> DrawnPaths:
    """One polynomial of degree 2-4; inner control points lie within 0.1 m of the chord per axis."""
    start, end = _near(rng, n, asked), np.broadcast_to(asked.end[:2], (n, 2))
    c = _curve(rng, start, end, (3, 4, 5), 0.1, asked.workspace)
    return DrawnPaths(np.full((n, 1), asked.total), c[:, None], np.zeros(n, bool))


def draw_level_3(rng: np.random.Generator, n: int, asked: MotionRequest) -> DrawnPaths:
    """Two or three pieces with Dirichlet(1) durations, none below 0.1 s (or total/6). Each has
    constant velocity (probability 0.2, clamped to alpha) or is a polynomial of degree 2-3. A
    clamped intermediate piece ends short of its target; a clamped last piece has missed."""
    end, workspace = asked.end[:2], asked.workspace
    count = rng.integers(2, MAX_PIECES + 1, n)
    durations = _durations(rng, count, asked.total)
    straight = rng.random((n, MAX_PIECES)) < 0.2
    current = _near(rng, n, asked)
    c = np.zeros((n, MAX_PIECES, 2, TERMS))
    missed = np.zeros(n, bool)
    for i in range(MAX_PIECES):
        near = _near(rng, n, asked)
        anywhere = rng.uniform(workspace.lower, workspace.upper, (n, 2))
        final = (count - 1 <= i)[:, None]
        target = np.where(final, end, np.where(straight[:, i, None], anywhere, near))
        way = target - current
        length, fastest = np.linalg.norm(way, axis=-1), asked.alpha * durations[:, i]
        way *= np.minimum(1.0, fastest / np.where(length > 0, length, 1.0))[:, None]
        line = np.zeros((n, 2, TERMS))
        line[..., 0], line[..., 1] = current, way
        curve = _curve(rng, current, target, (3, 4), 0.08, workspace)
        c[:, i] = np.where(straight[:, i, None, None], line, curve)
        reached = np.where(straight[:, i, None], current + way, target)
        used = i < count
        missed |= used & (i == count - 1) & (np.linalg.norm(reached - end, axis=-1) > MISS)
        c[:, i] *= used[:, None, None]
        current = reached
    return DrawnPaths(durations, c, missed)


DRAW = {1: draw_level_1, 2: draw_level_2, 3: draw_level_3}


def _near(rng: np.random.Generator, n: int, asked: MotionRequest) -> Floats:
    """Points (n, 2) from which the end can be reached in time."""
    return draw_within_reach(rng, n, asked.workspace, asked.end[:2], asked.alpha * asked.total)


def _curve(
    rng: np.random.Generator,
    start: NDArray,
    end: NDArray,
    sizes: tuple[int, ...],
    noise: float,
    workspace: Workspace,
) -> Floats:
    """Coefficients (n, 2, 5) of curves from `start` to `end` (n, 2) through a number of control
    points drawn from `sizes`."""
    n = len(start)
    size = rng.choice(sizes, n)
    offsets = rng.uniform(-noise, noise, (n, max(sizes) - 2, 2))
    c = np.zeros((n, 2, TERMS))
    for k in sizes:
        rows = np.flatnonzero(size == k)
        along = (np.arange(1, k - 1) / (k - 1))[:, None]
        a, b = start[rows, None], end[rows, None]
        inner = workspace.clip(a + along * (b - a) + offsets[rows, : k - 2])
        points = np.concatenate([a, inner, b], axis=1)
        c[rows, :, :k] = np.einsum("ij,njd->ndi", interpolation(k), points)
    return c


def _durations(rng: np.random.Generator, count: Ints, total: float) -> Floats:
    """Durations (n, 3) in s with sum `total`; 0 beyond `count`."""
    used = np.arange(MAX_PIECES) < count[:, None]
    # independent exponentials over their sum are Dirichlet(1)
    share = rng.exponential(size=used.shape) * used
    share /= share.sum(-1, keepdims=True)
    floor = min(SHORTEST_PIECE, total / (2 * MAX_PIECES))
    return (floor + (total - floor * count[:, None]) * share) * used
