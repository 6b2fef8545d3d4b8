"""The mesh kit of the robots: housings, beams, plates and shells placed in a link frame, painted
and joined per material."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from pipeline.poses import Pose, pose, quat_from_matrix, transform
from pipeline.world.objects import geometry
from pipeline.world.robots.pairs import CHARCOAL, GREY, SILVER, block, painted
from pipeline.world.shapes import Material, Mesh, Parts

BLACK = Material((0.075, 0.078, 0.085), roughness=0.45)
WHITE = Material((0.93, 0.93, 0.92), roughness=0.4)
RUBBER = Material((0.12, 0.12, 0.12), roughness=0.9)
GLASS = Material((0.02, 0.025, 0.04), roughness=0.1)

FACETS = 18  # of a round housing: enough to read as round at 320 x 240


def lathe(
    start: ArrayLike, axis: ArrayLike, profile: Sequence[tuple[float, float]], facets: int = FACETS
) -> Mesh:
    """Turned part: `profile` of (radius, distance along `axis`) from `start`, bottom centre first,
    closed at the top centre."""
    return geometry.revolve(profile, facets, 50.0).moved(_upright(start, axis))


def housing(
    start: ArrayLike, end: ArrayLike, radius: float, bevel: float = 0.004, facets: int = FACETS
) -> Mesh:
    """Motor housing: a cylinder between two points (m) with chamfered rims."""
    a, b = np.asarray(start, float), np.asarray(end, float)
    length = float(np.linalg.norm(b - a))
    return geometry.cylinder(radius, length, facets, bevel).moved(_upright(a, b - a))


def ring(
    centre: ArrayLike, axis: ArrayLike, radius: float, width: float, facets: int = FACETS
) -> Mesh:
    """A plain band of `width` m around a housing, without end faces that show."""
    n = np.asarray(axis, float) / np.linalg.norm(axis)
    start = np.asarray(centre, float) - n * width / 2
    return geometry.cylinder(radius, width, facets).moved(_upright(start, n))


def limb(
    stations: Sequence[tuple[ArrayLike, float, float]],
    up: ArrayLike = (0, 0, 1),
    roundness: float = 0.8,
    n: int = 3,
) -> Mesh:
    """Shell lofted through stations (centre m, half width, half height), sections square to the
    path.

    Heights point along `up` as far as the path allows, widths across both; corners round by
    `roundness` times the smaller half.
    """
    points = np.array([s[0] for s in stations], float)
    step = np.diff(points, axis=0)
    step /= np.linalg.norm(step, axis=1, keepdims=True)
    tangent = np.concatenate([step[:1], step[:-1] + step[1:], step[-1:]])
    sections = []
    for centre, t, (_, width, height) in zip(points, tangent, stations, strict=True):
        outline = geometry.rounded_rectangle(width, height, roundness * min(width, height), n)
        across = np.cross(np.asarray(up, float), t)
        placed = _columns(centre, across, np.cross(t, across), t)
        sections.append(transform(placed, np.column_stack([outline, np.zeros(len(outline))])))
    return geometry.loft(sections)


def plate(outline: ArrayLike, thickness: float, place: Pose, bevel: float = 0.0015) -> Mesh:
    """Flat plate over an outline (K,2) m in the xy plane of `place`, from z = 0 to `thickness`."""
    return geometry.extrude(outline, thickness, bevel).moved(place)


def link_outline(
    a: Sequence[float], b: Sequence[float], ra: float, rb: float, n: int = 6
) -> np.ndarray:
    """Outline (2(n+1),2) m of a flat connecting rod: half circles of radii `ra` round `a` and `rb`
    round `b`, counter-clockwise."""
    p, q = np.asarray(a, float), np.asarray(b, float)
    heading = np.degrees(np.arctan2(*(q - p)[::-1]))
    near = geometry.arc(tuple(p), ra, heading + 90, heading + 270, n)
    far = geometry.arc(tuple(q), rb, heading - 90, heading + 90, n)
    return np.array(near + far)


def depth_camera(place: Pose, width: float = 0.09) -> Parts:
    """A D435-like camera whose colour lens is at `place` (x forward, y left); the body stays behind
    the lens plane."""
    body = block(
        (-0.027, -width / 2 - 0.0175, -0.0125), (-0.003, width / 2 - 0.0175, 0.0125), 0.004
    )
    front = block((-0.0035, -width / 2 - 0.012, -0.009), (-0.0025, width / 2 - 0.023, 0.009))
    return ((body.moved(place), SILVER), (front.moved(place), GLASS))


def camera_rod(camera: Pose, root: ArrayLike) -> Mesh:
    """Rod from a point on the hand (m) to the rear of the camera body, out of the camera's own
    view."""
    return housing(root, transform(camera, (-0.018, -0.004, -0.006)), 0.008, 0.001, 8)


def _upright(start: ArrayLike, axis: ArrayLike) -> Pose:
    z = np.asarray(axis, float) / np.linalg.norm(axis)
    x = np.cross((0.0, 1.0, 0.0) if abs(z[1]) < 0.9 else (1.0, 0.0, 0.0), z)
    return _columns(start, x, np.cross(z, x), z)


def _columns(centre: ArrayLike, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> Pose:
    axes = np.stack([np.asarray(v, float) / np.linalg.norm(v) for v in (x, y, z)], axis=1)
    return pose(centre, quat_from_matrix(axes))


__all__ = [
    "BLACK",
    "CHARCOAL",
    "FACETS",
    "GLASS",
    "GREY",
    "RUBBER",
    "SILVER",
    "WHITE",
    "Parts",
    "block",
    "camera_rod",
    "depth_camera",
]
__all__ += ["housing", "lathe", "limb", "link_outline", "painted", "plate", "ring"]
