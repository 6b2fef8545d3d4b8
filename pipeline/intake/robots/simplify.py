"""Few convex collision pieces with few corners keep planning fast."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import trimesh

from pipeline.poses import Floats, pose, transform
from pipeline.world.robots.surfaces import surface
from pipeline.world.robots.urdf_file import UrdfError, UrdfShape
from pipeline.world.shapes import Collider

CORNERS = 32  # of a piece at most


@dataclass(frozen=True)
class Cut:
    """How coacd cuts a mesh whose hull is `hollow` times larger; with `tidy` open ones, too."""

    threshold: float = 0.1
    pieces: int = 4
    resolution: int = 1000
    iterations: int = 60
    hollow: float = 1.4
    tidy: bool = False


class ConvexPieces:
    """Convex pieces of shapes; a mesh is cut once for all links that have it."""

    def __init__(self) -> None:
        self._cut: dict[tuple[object, ...], list[Floats]] = {}

    def of(self, shapes: Sequence[UrdfShape]) -> tuple[Collider, ...]:
        found = []
        for shape in shapes:
            if shape.kind != "mesh":
                found.append(Collider(shape.kind, shape.size, shape.origin))
                continue
            key = shape.file, shape.scale
            if key not in self._cut:
                mesh = trimesh.Trimesh(*surface(replace(shape, origin=pose())))
                try:
                    self._cut[key] = [corners(part) for part in convex_parts(mesh, Cut())]
                except Exception as error:  # qhull reports a flat mesh in errors of its own
                    raise UrdfError(f"{shape.file}: is flat; give it a thickness") from error
            parts = [transform(shape.origin, part) for part in self._cut[key]]
            found += [Collider("convex", (), vertices=part) for part in parts]
        return tuple(found)


def corners(points: Floats) -> Floats:
    """Choose at most CORNERS corners of the hull, each the farthest in a direction."""
    hull = np.asarray(trimesh.convex.convex_hull(points).vertices, float)
    if len(hull) <= CORNERS:
        return hull
    chosen = list(dict.fromkeys(int(i) for i in (hull @ _directions().T).argmax(0)))[:CORNERS]
    return hull[sorted(chosen)]


def convex_parts(mesh: trimesh.Trimesh, how: Cut) -> list[Floats]:
    """Point sets whose hulls fill the mesh, several if coacd is installed. Raises qhull's
    errors."""
    whole = trimesh.convex.convex_hull(mesh.vertices)
    one = [np.asarray(whole.vertices, float)]
    if mesh.is_watertight and whole.volume < how.hollow * abs(mesh.volume):
        return one
    if not (mesh.is_watertight or how.tidy):
        return one
    try:
        import coacd
    except ImportError:
        return one
    coacd.set_log_level("error")
    options: dict[str, Any] = {
        "threshold": how.threshold,
        "max_convex_hull": how.pieces,
        "resolution": how.resolution,
        "mcts_iterations": how.iterations,
        "preprocess_mode": "auto" if how.tidy else "off",
        "mcts_nodes": 8,
        "mcts_max_depth": 2,
    }
    points, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    given = coacd.Mesh(points.reshape(-1, 3), faces.reshape(-1, 3))
    parts = coacd.run_coacd(given, seed=0, **options)
    return [np.asarray(vertices, float) for vertices, _ in parts] or one


@cache
def _directions() -> Floats:
    """CORNERS directions: six axes, then spread over the sphere."""
    k = np.arange(CORNERS - 6) + 0.5
    polar, turn = np.arccos(1 - 2 * k / len(k)), np.pi * (1 + 5**0.5) * k
    level = np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar)
    spread = np.stack([*level, np.cos(polar)], 1)
    return np.concatenate([np.eye(3), -np.eye(3), spread])
