"""How much of the room's light reaches each vertex of a body past the body itself, kept as the
length of its normal: rays from every vertex through a grid of filled cells, up to `REACH`."""

import hashlib
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.world.shapes import Mesh, Parts

CELLS = 44  # along the longest side of a body
CELL = (0.0015, 0.012)  # m, smallest and largest
REACH = 0.12  # m
RAYS = 40
LEAST = 0.3  # share of light that the deepest corner keeps: light that was scattered more than once

Grid = NDArray[np.bool_]
Points = NDArray[np.float64]


@dataclass(frozen=True)
class _Body:
    """Parts that are equal where their vertices, triangles and normals are."""

    digest: bytes
    parts: Parts = field(compare=False)


def opened(parts: Parts) -> Parts:
    """The parts with normals as long as the share of the room's light, 0-1, at their vertices."""
    if not parts:
        return parts
    content = hashlib.sha256()
    for mesh, _ in parts:
        for array in (mesh.vertices, mesh.triangles, mesh.normals):
            content.update(np.ascontiguousarray(array).tobytes())
    shares = _shares(_Body(content.digest(), parts))
    return [
        (_with(mesh, share), material)
        for (mesh, material), share in zip(parts, shares, strict=True)
    ]


def _with(mesh: Mesh, share: NDArray[np.float32]) -> Mesh:
    return replace(mesh, normals=mesh.normals * share[:, None])


@lru_cache(maxsize=256)
def _shares(body: _Body) -> tuple[NDArray[np.float32], ...]:
    """Share of light (N,) of the vertices of each mesh; a worker's robots come again in every
    episode."""
    points = [mesh.vertices.astype(float) for mesh, _ in body.parts]
    every = np.concatenate(points)
    lower, extent = every.min(0), np.ptp(every, axis=0).max()
    cell = float(np.clip(extent / CELLS, *CELL))
    lower = lower - 2 * cell
    shape = np.ceil((every.max(0) - lower) / cell).astype(int) + 3
    grid = np.zeros(tuple(shape), np.bool_)
    for (mesh, _), vertices in zip(body.parts, points, strict=True):
        _fill(grid, vertices, mesh.triangles.astype(np.int64), lower, cell)
    rays, reach = sphere(RAYS), min(REACH, 0.7 * float(extent))
    return tuple(
        _open(grid, vertices, mesh.normals.astype(float), lower, cell, rays, reach)
        for (mesh, _), vertices in zip(body.parts, points, strict=True)
    )


def sphere(count: int) -> Points:
    """Directions (count,3) spread evenly: a Fibonacci lattice."""
    k = np.arange(count)
    z = 1 - (2 * k + 1) / count
    turn = k * np.pi * (3 - np.sqrt(5))
    return np.stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z], 1)


@njit(cache=True, error_model="numpy")
def _fill(
    grid: Grid, points: Points, triangles: NDArray[np.int64], lower: Points, cell: float
) -> None:
    """Mark the cells that triangles pass through."""
    for a, b, c in triangles:
        u, v = points[b] - points[a], points[c] - points[a]
        longest = max(
            np.sqrt((u * u).sum()), np.sqrt((v * v).sum()), np.sqrt(((u - v) * (u - v)).sum())
        )
        n = int(longest / (0.6 * cell)) + 1
        for i in range(n + 1):
            for j in range(n + 1 - i):
                at = (points[a] + u * (i / n) + v * (j / n) - lower) / cell
                grid[int(at[0]), int(at[1]), int(at[2])] = True


@njit(cache=True, error_model="numpy")
def _open(
    grid: Grid,
    points: Points,
    normals: Points,
    lower: Points,
    cell: float,
    rays: Points,
    reach: float,
) -> NDArray[np.float32]:
    """Share of light (N,) from the half space of each normal, weighted by the cosine and
    nearness."""
    out = np.ones(len(points), np.float32)
    nx, ny, nz = grid.shape
    steps = int(reach / cell)
    for k in range(len(points)):
        normal = normals[k]
        sx, sy, sz = (points[k] + normal * (1.7 * cell) - lower) / cell
        whole, taken = 0.0, 0.0
        for r in range(len(rays)):
            dx, dy, dz = rays[r]
            cosine = dx * normal[0] + dy * normal[1] + dz * normal[2]
            if cosine < 0.08:
                continue
            whole += cosine
            for step in range(1, steps + 1):
                x, y, z = (
                    int(np.floor(sx + dx * step)),
                    int(np.floor(sy + dy * step)),
                    int(np.floor(sz + dz * step)),
                )
                if x < 0 or y < 0 or z < 0 or x >= nx or y >= ny or z >= nz:
                    break
                if grid[x, y, z]:
                    taken += cosine * (1.0 - step * cell / (1.3 * reach))
                    break
        if whole > 0:
            out[k] = LEAST + (1.0 - LEAST) * (1.0 - taken / whole)
    return out
