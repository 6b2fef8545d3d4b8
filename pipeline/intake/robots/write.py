"""Writes a robot's directory from an arm."""

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import trimesh
from numpy.typing import ArrayLike

from pipeline.data.atomic import write_atomic
from pipeline.data.joints import LIMITS, Joint
from pipeline.data.names import SIDES
from pipeline.poses import Pose, compose, pose, quat_to_matrix
from pipeline.world.files import write_glb
from pipeline.world.robots.contract import Arm, Embodiment, Link
from pipeline.world.robots.directory import TOML, URDF
from pipeline.world.shapes import Collider


@dataclass(frozen=True, eq=False)
class RobotDraft:
    """An arm, and two at their places; `tcp` is in the hand's frame, `foot` half its edge (m)."""

    arm: Arm
    site: Embodiment
    tcp: tuple[Iterable[float], Iterable[float], Iterable[float]]
    foot: float
    licence: str
    source: str
    notes: tuple[str, ...] = ()


def write_robot(draft: RobotDraft, directory: Path) -> None:
    """Write the directory; `robot.toml`, which makes it a robot, comes last."""
    arm = draft.arm
    for link in arm.links:
        if link.visual:
            write_atomic(directory / mesh_file(link.name), write_glb(link.visual))
        for i, piece in enumerate(link.collision):
            if piece.kind == "convex":
                hull = trimesh.convex.convex_hull(np.asarray(piece.vertices))
                stl = hull.export(file_type="stl")
                write_atomic(directory / mesh_file(link.name, i), stl)
    write_atomic(directory / URDF, (arm_urdf(arm, meshes=True) + "\n").encode())
    write_atomic(directory / TOML, _toml_of(draft).encode())


def _toml_of(draft: RobotDraft) -> str:
    arm, grip = draft.arm, draft.arm.gripper
    tool = zip(("position", "approach", "opening"), draft.tcp, strict=True)
    drive = ("force", "speed", "stiffness", "damping")
    lines = [
        f'licence = "{_plain(draft.licence)}"',
        f'source = "{_plain(draft.source)}"',
        f"hand = {json.dumps(arm.hand)}",
        f"foot = {draft.foot:g}  # m, half the edge of the arm's foot",
        "allowed_overlap = [",
        *(f"  {json.dumps(list(pair))}," for pair in arm.allowed_overlap),
        "]",
        "",
        "[tcp]",
        *(f"{name} = {_array(values)}" for name, values in tool),
        "",
        "[gripper]",
        *(f"{name} = {json.dumps(list(getattr(grip, name)))}" for name in ("joints", "fingers")),
        *(f"{name} = {_array(getattr(grip, name))}" for name in ("closed", "opened")),
        f"opening = {grip.opening:.4f}",
        *(f"{name} = {getattr(grip, name):g}" for name in drive),
        "",
        "[home]",
        *(f"{side} = {_array(draft.site.arms[side].home)}" for side in SIDES),
    ]
    for side in SIDES:
        base = draft.site.arms[side].base
        lines += ["", f"[place.{side}]", f"position = {_array(base[:3])}"]
        lines.append(f"quaternion = {_array(base[3:], 15)}")
    return "\n".join(lines) + "\n"


def _array(values: Iterable[float], digits: int = 5) -> str:
    return "[" + ", ".join(repr(round(float(v), digits) + 0.0) for v in values) + "]"


def _plain(text: str) -> str:
    return "".join(c for c in text if c.isprintable() and c not in '"\\')[:200]


def arm_urdf(arm: Arm, prefix: str = "", meshes: bool = False) -> str:
    """URDF of one arm at `arm.base`; all gripper joints are driven, none has <mimic>."""
    robot = ET.Element("robot", name=f"{prefix}{arm.model}")
    for link in arm.links:
        _add_link(robot, link, prefix, meshes)
    for joint in arm.joints:
        _add_joint(robot, joint, prefix)
    ET.indent(robot)
    return ET.tostring(robot, encoding="unicode")


def rpy_from_quat(q: ArrayLike) -> tuple[float, float, float]:
    """URDF roll, pitch, yaw (rad) of a quaternion wxyz; roll 0 at the pitch poles."""
    m = quat_to_matrix(q)
    pitch = float(np.arctan2(-m[2, 0], np.hypot(m[0, 0], m[1, 0])))
    if np.hypot(m[0, 0], m[1, 0]) < 1e-9:
        return 0.0, pitch, float(np.arctan2(-m[0, 1], m[1, 1]))
    return float(np.arctan2(m[2, 1], m[2, 2])), pitch, float(np.arctan2(m[1, 0], m[0, 0]))


def mesh_file(link: str, piece: int | None = None) -> str:
    return f"meshes/{link}.glb" if piece is None else f"meshes/{link}_{piece}.stl"


def _add_link(robot: ET.Element, link: Link, prefix: str, meshes: bool) -> None:
    e = ET.SubElement(robot, "link", name=prefix + link.name)
    inertial = ET.SubElement(e, "inertial")
    _origin(inertial, pose(link.com))
    ET.SubElement(inertial, "mass", value=_number(link.mass))
    xx, yy, zz = map(_number, link.inertia)
    xy, xz, yz = (_number(v) if v else "0" for v in link.products)
    ET.SubElement(inertial, "inertia", ixx=xx, ixy=xy, ixz=xz, iyy=yy, iyz=yz, izz=zz)
    if meshes and link.visual:
        _add_mesh(ET.SubElement(e, "visual"), mesh_file(link.name))
    for i, collider in enumerate(link.collision):
        if meshes and collider.kind == "convex":
            _add_mesh(ET.SubElement(e, "collision"), mesh_file(link.name, i))
        for origin, tag, attributes in _geometry(collider):
            piece = ET.SubElement(e, "collision")
            _origin(piece, origin)
            ET.SubElement(ET.SubElement(piece, "geometry"), tag, attributes)


def _geometry(c: Collider) -> list[tuple[Pose, str, dict[str, str]]]:
    if c.kind == "convex":
        return []
    if c.kind == "box":
        return [(c.pose, "box", {"size": _row(2 * np.array(c.size))})]
    rounding, half = {"radius": _number(c.size[0])}, c.size[-1]
    if c.kind == "sphere":
        return [(c.pose, "sphere", rounding)]
    tube = (c.pose, "cylinder", rounding | {"length": _number(2 * half)})
    ends = [(compose(c.pose, pose((0, 0, z))), "sphere", rounding) for z in (-half, half)]
    return [tube, *ends] if c.kind == "capsule" else [tube]


def _add_mesh(parent: ET.Element, name: str) -> None:
    ET.SubElement(ET.SubElement(parent, "geometry"), "mesh", filename=name)


def _add_joint(robot: ET.Element, joint: Joint, prefix: str) -> None:
    e = ET.SubElement(robot, "joint", name=prefix + joint.name, type=joint.kind)
    _origin(e, joint.origin)
    ET.SubElement(e, "parent", link=prefix + joint.parent)
    ET.SubElement(e, "child", link=prefix + joint.child)
    if joint.kind != "fixed":
        ET.SubElement(e, "axis", xyz=_row(joint.axis))
        ET.SubElement(e, "limit", {name: _number(getattr(joint, name)) for name in LIMITS})


def _origin(parent: ET.Element, p: Pose) -> None:
    ET.SubElement(parent, "origin", xyz=_row(p[:3]), rpy=_row(rpy_from_quat(p[3:])))


def _row(values: ArrayLike) -> str:
    return " ".join(_number(v) for v in np.asarray(values, float))


def _number(value: float) -> str:
    # 17 digits and no negative zero: the text carries the spec's doubles exactly and is the same on
    # every run
    return repr(float(value) + 0.0)
