"""Reads a URDF, and refuses what a simulator would silently get wrong."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pipeline.data.errors import DominoError
from pipeline.data.joints import (
    LIMITS,
    Joint,
    joint_motion,
    number_of,
    origin_of,
    read_joint,
    vector_of,
)
from pipeline.poses import Floats, Pose, compose, pose, quat_to_matrix
from pipeline.world.meshes.files import Folders, folders_of, parse_xml, read_bytes
from pipeline.world.meshes.part import MeshError

MAX_URDF_BYTES = 8_000_000
MAX_LINKS = 500
MAX_NAME = 500  # characters of a link's or joint's name
_VECTORS = {"xyz": (3,), "rpy": (3,), "scale": (1, 3), "rgba": (3, 4), "size": (3,)}
_INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_NUMBERS = ("radius", "length", *LIMITS, "multiplier", "offset", *_INERTIA)

type Color = tuple[float, float, float]


class UrdfError(DominoError):
    """A URDF, or its mesh, is unusable."""


@dataclass(frozen=True, eq=False)
class UrdfShape:
    """One `<visual>` or `<collision>`: a mesh, box (half extents), cylinder (radius, half length)
    or sphere (radius), placed in the link by `origin`. A mesh has a file, which may name others
    below `within`. `color` is sRGB 0-1."""

    kind: str
    origin: Pose
    size: tuple[float, ...] = ()
    file: Path | None = None
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)
    color: Color | None = None
    within: Path | None = None


@dataclass(frozen=True, eq=False)
class UrdfLink:
    """Mass (kg), centre of mass (m), inertia about it (3,3) kg m2 along the link's axes, shapes."""

    mass: float
    com: Floats
    inertia: Floats
    visuals: tuple[UrdfShape, ...]
    collisions: tuple[UrdfShape, ...]


@dataclass(frozen=True)
class Mimic:
    """A joint that follows another: position = `multiplier` x that of `joint` + `offset`."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True, eq=False)
class UrdfRobot:
    """Links in file order, the joint above each link by the link's name, mimic rules by joint."""

    path: Path
    links: dict[str, UrdfLink]
    parent_joint: dict[str, Joint]
    mimics: dict[str, Mimic]

    def fault(self, what: str) -> UrdfError:
        return UrdfError(f"{self.path}: {what}")

    def roots(self) -> list[str]:
        return [link for link in self.links if link not in self.parent_joint]

    def link_poses(self, base: str, positions: Mapping[str, ArrayLike]) -> dict[str, Pose]:
        """Poses (..., 7) below `base` in its frame, for joint positions (...) rad or m by child
        link, else 0."""
        poses = {base: pose()}
        for link in self.below(base)[1:]:
            joint = self.parent_joint[link]
            local = compose(joint.origin, joint_motion(joint, positions.get(link, 0.0)))
            poses[link] = compose(poses[joint.parent], local)
        return poses

    def below(self, base: str) -> list[str]:
        """The link `base` and those on it, parents first."""
        below, known = [base], {base}
        pending = [link for link in self.links if link in self.parent_joint]
        while ready := [link for link in pending if self.parent_joint[link].parent in known]:
            below += ready
            known.update(ready)
            pending = [link for link in pending if link not in known]
        return below


def read_urdf(
    path: Path, root: Path | None = None, packages: Mapping[str, Path] | None = None
) -> UrdfRobot:
    """Read a plain URDF; meshes lie below `root`, by default its package or the second folder
    above. `packages` are directories by name. Raises UrdfError."""
    document = _parse(path)
    elements = document.findall("link")
    if len(elements) > MAX_LINKS:
        raise UrdfError(f"{path}: has {len(elements)} links; a robot has at most {MAX_LINKS}")
    named = (m for m in document.iter("material") if m.get("name") and _color(m))
    shapes = _Shapes(folders_of(path, root, packages), {m.get("name"): _color(m) for m in named})
    links = {_name(e, path): _link(e, shapes) for e in elements}
    names = [(e.tag, _name(e, path)) for e in (*elements, *document.findall("joint"))]
    for tag, name in {x for x in names if names.count(x) > 1}:
        raise UrdfError(f"{path}: two {tag}s are named {name!r}: give each its own name")
    joints: dict[str, Joint] = {}
    mimics: dict[str, Mimic] = {}
    for element in document.findall("joint"):
        try:
            joint = read_joint(element)
        except ValueError as error:
            raise UrdfError(f"{path}: {error}") from error
        for link in {joint.parent, joint.child} - links.keys():
            what = f"{path}: joint {joint.name!r} names link {link!r}"
            raise UrdfError(f"{what}, which the file does not have")
        if joint.child in joints:
            others = f"{joint.name!r} and {joints[joint.child].name!r}"
            raise UrdfError(f"{path}: joints {others} both move link {joint.child!r}")
        joints[joint.child] = joint
        if (rule := element.find("mimic")) is not None:
            factor, offset = float(rule.get("multiplier", 1)), float(rule.get("offset", 0))
            mimics[joint.name] = Mimic(rule.get("joint", ""), factor, offset)
    return UrdfRobot(path, links, joints, mimics)


def read_xml(path: Path) -> Any:
    """The root element. Raises UrdfError."""
    try:
        data = read_bytes(path)
        if len(data) > MAX_URDF_BYTES:
            raise MeshError(f"has {len(data)} bytes; it may have {MAX_URDF_BYTES}")
        return parse_xml(data)
    except MeshError as error:
        raise UrdfError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from error


def _parse(path: Path) -> Any:
    root = read_xml(path)
    elements = list(root.iter())
    if root.tag != "robot" or any("xacro" in element.tag for element in elements):
        raise UrdfError(f"{path}: not a plain URDF; expand it first: `xacro in.xacro > out.urdf`")
    for element in elements:
        _check_numbers(element, path)
    return root


def _check_numbers(element: Any, path: Path) -> None:
    numbers = (*_NUMBERS, "value") if element.tag == "mass" else _NUMBERS
    for key, counts in (_VECTORS | dict.fromkeys(numbers, (1,))).items():
        text = element.get(key)
        if text is None:
            continue
        try:
            values = [float(v) for v in text.split()]
        except ValueError:
            values = []
        if len(values) not in counts or not np.isfinite(values).all():
            what = f"{path}: line {element.sourceline}: <{element.tag}> has {key}={text[:60]!r}"
            raise UrdfError(f"{what}, not {' or '.join(map(str, counts))} finite numbers")


@dataclass(frozen=True)
class _Shapes:
    folders: Folders
    paints: Mapping[str | None, Color | None]

    def of(self, link: Any, tag: str) -> Iterator[UrdfShape]:
        for element in link.findall(tag):
            geometry, material = element.find("geometry"), element.find("material")
            solid = None if geometry is None else next(geometry.iterchildren(), None)
            if solid is not None:
                color = None
                if material is not None:
                    color = _color(material) or self.paints.get(material.get("name"))
                yield self._shape(solid, origin_of(element), color)

    def _shape(self, solid: Any, origin: Pose, color: Color | None) -> UrdfShape:
        urdf = self.folders.urdf
        if solid.tag == "mesh":
            x, y, z = np.broadcast_to(vector_of(solid, "scale", (1.0,)), 3).tolist()
            try:
                file, within = self.folders.find(solid.get("filename", ""))
            except MeshError as error:
                raise UrdfError(f"{urdf}: mesh {error}") from error
            return UrdfShape("mesh", origin, (), file, (x, y, z), color, within)
        radius, half = number_of(solid, "radius"), number_of(solid, "length") / 2
        x, y, z = (vector_of(solid, "size", (0.0, 0.0, 0.0)) / 2).tolist()
        sizes = {"box": (x, y, z), "cylinder": (radius, half), "sphere": (radius,)}
        size = sizes.get(solid.tag, (0.0,))
        if min(size) <= 0:
            what = f"{urdf}: line {solid.sourceline}: <{solid.tag}>"
            raise UrdfError(f"{what} is no mesh, box, cylinder or sphere with a size above 0")
        return UrdfShape(solid.tag, origin, size, color=color)


def _link(e: Any, shapes: _Shapes) -> UrdfLink:
    inertial = e.find("inertial")
    mass, com, inertia = 0.0, np.zeros(3), np.zeros((3, 3))
    if inertial is not None:
        origin = origin_of(inertial)
        mass, com = number_of(inertial.find("mass"), "value"), origin[:3]
        row = inertial.find("inertia")
        xx, xy, xz, yy, yz, zz = (number_of(row, k) for k in _INERTIA)
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        if (origin[3:] != (1, 0, 0, 0)).any():
            turn = quat_to_matrix(origin[3:])
            inertia = turn @ inertia @ turn.T
    visuals, collisions = (tuple(shapes.of(e, tag)) for tag in ("visual", "collision"))
    return UrdfLink(mass, com, inertia, visuals, collisions)


def _name(e: Any, path: Path) -> str:
    name = e.get("name", "")
    # files of a robot's directory are named after links
    if not name or len(name) > MAX_NAME or set(name) & set("/\\"):
        what = f"{path}: line {e.sourceline}: <{e.tag}> has name={name[:60]!r}"
        raise UrdfError(f"{what}: give it a short name without slashes")
    return name


def _color(material: Any) -> Color | None:
    color = material.find("color")
    if color is None or color.get("rgba") is None:
        return None
    r, g, b = np.clip(vector_of(color, "rgba", ())[:3], 0.0, 1.0).tolist()
    return (r, g, b)
