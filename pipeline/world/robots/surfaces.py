"""A URDF's shapes as triangles in the link frame: drawn ones, and hulls."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import trimesh

from pipeline.poses import Floats, Ints, transform
from pipeline.world.meshes.part import MeshError, Part, stacked
from pipeline.world.meshes.reader import PLAIN, drawn, read_mesh
from pipeline.world.objects.surface import area_vectors
from pipeline.world.shapes import Parts

from .urdf_file import UrdfError, UrdfShape

TRIANGLES_PER_LINK = 1500
FEWEST = 50  # triangles of a part of a link
LARGEST = 10.0  # m: no vertex of a robot's link is farther from its frame


def load_visual(shapes: Sequence[UrdfShape], notes: list[str] | None = None) -> Parts:
    """Meshes (link frame, m) and materials, about 1500 triangles. A mesh file's colors come first,
    as in ROS. `notes` gets guesses and omissions. Raises UrdfError."""
    looks = list[Part]()
    for shape in shapes:
        parts, read = parts_of(shape)
        for part in parts:
            color = part.look.color or shape.color or PLAIN
            looks.append(replace(part, look=part.look._replace(color=color)))
        if notes is not None:
            notes += read
    return drawn(looks, TRIANGLES_PER_LINK, FEWEST)


def hull(shape: UrdfShape) -> Floats:
    """Corners (N,3) m of the hull in the link frame. Raises UrdfError."""
    points = surface(shape)[0]
    try:
        return np.asarray(trimesh.convex.convex_hull(points).vertices, float)
    except Exception as error:  # qhull reports a flat mesh in errors of its own
        raise UrdfError(f"{shape.file}: is flat; give it a thickness") from error


def surface(shape: UrdfShape) -> tuple[Floats, Ints]:
    """Points (P,3) m in the link frame and faces (M,3). Raises UrdfError."""
    return stacked(parts_of(shape)[0])


def parts_of(shape: UrdfShape) -> tuple[list[Part], tuple[str, ...]]:
    """Parts in the link frame (m), outward also when mirrored, and notes. Raises UrdfError."""
    if shape.file is None:
        return [_solid(shape)], ()
    try:
        read = read_mesh(shape.file, shape.within)
    except MeshError as error:
        raise UrdfError(str(error)) from error
    scaled = [part.moved(np.diag([*shape.scale, 1.0])) for part in read.parts]
    parts = [replace(part, points=transform(shape.origin, part.points)) for part in scaled]
    if not all((np.abs(part.points) <= LARGEST).all() for part in parts):
        raise UrdfError(f"{shape.file}: has a vertex more than {LARGEST:g} m away; mind its scale")
    if not any(area_vectors(part.points, part.faces).any() for part in parts):
        raise UrdfError(f"{shape.file}: all its triangles have no area; mind its scale")
    return parts, tuple(f"{shape.file.name}: {note}" for note in read.notes)


def _solid(shape: UrdfShape) -> Part:
    size = shape.size
    if shape.kind == "box":
        mesh = trimesh.creation.box(2 * np.array(size))
    elif shape.kind == "cylinder":
        mesh = trimesh.creation.cylinder(size[0], 2 * size[1])
    else:
        mesh = trimesh.creation.icosphere(subdivisions=2, radius=size[0])
    return Part(transform(shape.origin, mesh.vertices), np.asarray(mesh.faces, np.int64))
