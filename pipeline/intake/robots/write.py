"""Writes a robot's directory from an arm: `robot.urdf`, `meshes/` and `robot.toml`."""

import io
import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh

from pipeline.data.atomic import write_atomic
from pipeline.data.names import SIDES
from pipeline.world.files import write_glb
from pipeline.world.robots.contract import Arm, Embodiment
from pipeline.world.robots.directory import TOML, URDF

from .urdf_text import arm_urdf, mesh_file


@dataclass(frozen=True, eq=False)
class RobotDraft:
    """An arm before it is written, and two of it at their places. `tcp` is position, approach and
    opening in the hand's frame; `foot` is half its edge (m)."""

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
                written = io.BytesIO()
                hull = trimesh.convex.convex_hull(np.asarray(piece.vertices))
                hull.export(written, file_type="stl")
                write_atomic(directory / mesh_file(link.name, i), written.getvalue())
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
        *(f"{name} = {_row(values)}" for name, values in tool),
        "",
        "[gripper]",
        *(f"{name} = {json.dumps(list(getattr(grip, name)))}" for name in ("joints", "fingers")),
        *(f"{name} = {_row(getattr(grip, name))}" for name in ("closed", "opened")),
        f"opening = {grip.max_opening:.4f}",
        *(f"{name} = {getattr(grip, name):g}" for name in drive),
        "",
        "[home]",
        *(f"{side} = {_row(draft.site.arms[side].home)}" for side in SIDES),
    ]
    for side in SIDES:
        base = draft.site.arms[side].base
        lines += ["", f"[place.{side}]", f"position = {_row(base[:3])}"]
        lines.append(f"quaternion = {_row(base[3:], 15)}")
    return "\n".join(lines) + "\n"


def _row(values: Iterable[float], digits: int = 5) -> str:
    return "[" + ", ".join(repr(round(float(v), digits) + 0.0) for v in values) + "]"


def _plain(text: str) -> str:
    return "".join(c for c in text if c.isprintable() and c not in '"\\')[:200]
