"""Ground truth of a stored episode in one camera."""

from pathlib import Path

from scipy.spatial import ConvexHull

from pipeline.data.cameras import world_poses
from pipeline.data.episode.file import Episode
from pipeline.data.episode.world import BodyFacts, WorldTruth
from pipeline.world.drawing.room import shell, table_legs, table_top
from pipeline.world.drawing.silhouettes import occluders_of, track_bodies
from pipeline.world.drawing.truth import surfaces_of
from pipeline.world.objects import FAMILIES
from pipeline.world.robots import get_embodiment
from pipeline.world.shapes import Collider, Shape, merge

from .redraw import read_stored
from .render import body_poses


def truth(path: Path, camera: str, bodies: Path) -> WorldTruth:
    """The truth of a camera, as its images show it: late, if they are. Raises as `redraw`."""
    episode, appearance, log = read_stored(path, camera, bodies)
    (seen_from,), visuals = appearance.cameras, appearance.visuals
    fixed = [*appearance.furniture, *table_legs(), *table_top(visuals)]
    room = [part for parts in shell(visuals).values() for part in parts]
    shown, poses = appearance.bodies, body_poses(log)
    objects = tuple(name for name in episode.meta.objects if shown.get(name))
    at = world_poses(seen_from, poses, len(log))
    track = track_bodies(occluders_of(shown, fixed), poses, objects, seen_from.type, at)
    facts = _facts(episode)
    meshes = {name: merge([mesh for mesh, _ in parts]) for name, parts in shown.items() if parts}
    known = {
        n: BodyFacts(m.vertices, m.triangles, *facts.get(n, (None, None)))
        for n, m in meshes.items()
    }
    surfaces = surfaces_of(occluders_of(shown, [*fixed, *room]), poses, seen_from)
    return WorldTruth(known, surfaces, objects, track.box, track.visible)


def _facts(episode: Episode) -> dict[str, tuple[float | None, float | None]]:
    found = dict[str, tuple[float | None, float | None]]()
    for name, info in episode.meta.objects.items():
        if info.family in FAMILIES:
            shape = FAMILIES[info.family](**info.parameters).shape()
            found[name] = (simulated_mass(shape), float(shape.friction))
    try:
        robot = get_embodiment(episode.spec.embodiment)
    except KeyError:
        return found
    for side, arm in robot.arms.items():
        found |= {f"{side}_{link.name}": (link.mass, None) for link in arm.links}
    return found


def simulated_mass(shape: Shape) -> float:
    """The mass (kg) in the simulation, whose densities are those of stated volumes."""
    stated = sum(c.weight * c.volume() for c in shape.collision)
    return shape.mass * sum(c.weight * _volume(c) for c in shape.collision) / stated


def _volume(piece: Collider) -> float:
    if piece.kind != "convex" or piece.vertices is None:
        return piece.volume()
    return float(ConvexHull(piece.vertices).volume)
