"""Collision-free joint paths, and straight lines into contact. `is_free` is called once an edge,
for speed.
"""

from collections.abc import Callable
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from pipeline.poses import Floats

from .budgets import PATH, PathBudget

BISECTIONS = 14  # of a line into contact: of 10 cm, to a hundredth of a millimetre
IsFree = Callable[[ArrayLike], bool]
Edge = Callable[[Floats, Floats], bool]


def straight(q0: ArrayLike, q1: ArrayLike, resolution: float = PATH.resolution) -> Floats:
    """Rows (K,n), K >= 2, from q0 to q1, at most `resolution` apart in every joint."""
    a, b = np.asarray(q0, float), np.asarray(q1, float)
    count = 1 + max(1, int(np.ceil(np.abs(b - a).max() / resolution - 1e-9)))
    rows = np.asarray(a + np.linspace(0.0, 1.0, count)[:, None] * (b - a), np.float64)
    rows[-1] = b
    return rows


def dense(waypoints: ArrayLike, resolution: float = PATH.resolution) -> Floats:
    """Rows (M,n) through `waypoints` (K,n), at most `resolution` apart."""
    corners = np.atleast_2d(np.asarray(waypoints, float))
    edges = [straight(a, b, resolution)[1:] for a, b in pairwise(corners)]
    return np.concatenate([corners[:1], *edges])


def connect(
    is_free: IsFree,
    q0: ArrayLike,
    q1: ArrayLike,
    rng: np.random.Generator,
    limits: tuple[ArrayLike, ArrayLike],
    budget: PathBudget = PATH,
) -> Floats | None:
    """Waypoints (K,n) of a free polyline from q0 to q1 (n,), or None: the line, else RRT-Connect
    (Kuffner and LaValle, ICRA 2000) and shortcuts.
    """
    a, b = np.asarray(q0, float), np.asarray(q1, float)
    if not is_free(np.stack([a, b])):
        return None
    box = np.asarray(limits[0], float), np.asarray(limits[1], float)
    for halving in range(budget.searches):
        edge = partial(_edge_free, is_free, budget.resolution / 2**halving)
        path = np.stack([a, b])
        if not edge(a, b):
            path = _search(edge, _Tree(a, budget.step), _Tree(b, budget.step), rng, box, budget)
        if path is None:
            return None
        path = shorten(path, edge, rng, budget.shortcuts)
        if is_free(dense(path, budget.resolution / budget.final_division)):
            return path
    return None


def _edge_free(is_free: IsFree, resolution: float, p: Floats, q: Floats) -> bool:
    rows = straight(p, q, resolution)
    # far apart states first: a checker that stops at the first contact finds it sooner
    return is_free(np.concatenate([rows[::8], rows[4::8], rows[2::4], rows[1::2]]))


def _search(
    edge: Edge,
    grow: "_Tree",
    aim: "_Tree",
    rng: np.random.Generator,
    limits: tuple[Floats, Floats],
    budget: PathBudget,
) -> Floats | None:
    """From the root of `grow` to that of `aim`, or None."""
    for iteration in range(budget.iterations):
        new = grow.extend(rng.uniform(*limits), edge)
        if new is not None:
            met = aim.reach(grow.points[new], edge)
            if met is not None:
                path = [*grow.branch(new)[::-1], *aim.branch(met)[1:]]
                return np.array(path if iteration % 2 == 0 else path[::-1])
        grow, aim = aim, grow
    return None


def shorten(path: Floats, edge: Edge, rng: np.random.Generator, tries: int) -> Floats:
    """Corners skipped, then random pairs of points joined, where edges are free."""
    path = _skip_corners(path, edge)
    for _ in range(tries):
        if len(path) < 3:
            break
        lengths = np.linalg.norm(np.diff(path, axis=0), axis=1)
        marks = np.concatenate([[0.0], np.cumsum(lengths)])
        s, t = np.sort(rng.uniform(0.0, marks[-1], 2))
        i, j = (
            int(np.clip(np.searchsorted(marks, x, side="right") - 1, 0, len(lengths) - 1))
            for x in (s, t)
        )
        if i == j:
            continue
        p, q = (
            path[k] + (x - marks[k]) / lengths[k] * (path[k + 1] - path[k])
            for k, x in ((i, s), (j, t))
        )
        if np.linalg.norm(q - p) < 0.999 * (t - s) and edge(p, q):
            path = np.concatenate([path[: i + 1], [p, q], path[j + 1 :]])
    return _skip_corners(path, edge)


def _skip_corners(path: Floats, edge: Edge) -> Floats:
    kept, i = [0], 0
    while i < len(path) - 1:
        i = next(j for j in range(len(path) - 1, i, -1) if j == i + 1 or edge(path[i], path[j]))
        kept.append(i)
    return path[kept]


class _Tree:
    def __init__(self, root: Floats, step: float) -> None:
        self.points, self.step = root[None].copy(), step
        self.parents = [-1]

    def extend(self, goal: Floats, edge: Edge) -> int | None:
        """One step from the nearest state; its index, or None when blocked."""
        near = int(np.argmin(np.sum((self.points - goal) ** 2, axis=1)))
        return self._grow(near, goal, edge)

    def reach(self, goal: Floats, edge: Edge) -> int | None:
        """Grow step by step until `goal` is in the tree; its index, or None when blocked before."""
        at = int(np.argmin(np.sum((self.points - goal) ** 2, axis=1)))
        while True:
            new = self._grow(at, goal, edge)
            if new is None or np.array_equal(self.points[new], goal):
                return new
            at = new

    def branch(self, index: int) -> list[Floats]:
        out = []
        while index >= 0:
            out.append(self.points[index])
            index = self.parents[index]
        return out

    def _grow(self, near: int, goal: Floats, edge: Edge) -> int | None:
        start = self.points[near]
        far = np.abs(goal - start).max()
        new = goal if far <= self.step else start + (self.step / far) * (goal - start)
        if not edge(start, new):
            return None
        self.points = np.concatenate([self.points, new[None]])
        self.parents.append(near)
        return len(self.parents) - 1


def first_touch(apart: IsFree, line: Floats) -> float:
    """Share of joint rows (K,n) into contact at which `apart` ceases to hold, else 1."""
    if apart(line[-1]):
        return 1.0
    before, behind = 0.0, 1.0
    for _ in range(BISECTIONS):
        middle = 0.5 * (before + behind)
        before, behind = (middle, behind) if apart(_at(line, middle)) else (before, middle)
    return before


def between(line: Floats, first: float, last: float) -> Floats:
    """The part of joint rows (K,n) between two shares of the way."""
    inner = np.arange(len(line)) / (len(line) - 1)
    return np.vstack([_at(line, first), line[(inner > first) & (inner < last)], _at(line, last)])


def ending_clear(line: Floats, clear: IsFree, least: float) -> Floats | None:
    """Up to where `clear` ceases to hold; None if that is before `least`."""
    if clear(line):
        return line
    end = first_touch(clear, line)
    cut = between(line, 0.0, end)
    return cut if end >= least and clear(cut) else None


def _at(line: Floats, share: float) -> Floats:
    place = share * (len(line) - 1)
    k = min(int(place), len(line) - 2)
    return line[k] + (place - k) * (line[k + 1] - line[k])
