"""Reads an MJCF, compiled by MuJoCo, as links, joints and mimic rules of a URDF."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path, PureWindowsPath
from typing import Any

import numpy as np
import trimesh

from pipeline.data.errors import DominoError
from pipeline.data.joints import Joint, joint_motion
from pipeline.poses import Floats, Pose, compose, pose, quat_to_matrix
from pipeline.world.meshes.files import folders_of, read_bytes
from pipeline.world.meshes.part import MeshError
from pipeline.world.robots.urdf_file import (
    Mimic,
    UrdfError,
    UrdfLink,
    UrdfRobot,
    UrdfShape,
    read_xml,
)

from .couplings import couplings

MJCF = (".xml", ".mjcf")
FLANGE = "attach"  # in the name of the frame that MuJoCo Menagerie's arms have for a gripper
GREY = (0.5, 0.5, 0.5, 1)  # MuJoCo's colour of a geom that has none


def read_mjcf(path: Path, scratch: Path, root: Path | None = None) -> UrdfRobot:
    """The robot of an MJCF with its files below `root`, by default the second folder above; meshes
    go to `scratch`. Raises UrdfError."""
    try:
        import mujoco
    except ImportError as error:
        raise DominoError(
            f"{path}: is an MJCF; to read it, run `uv sync --inexact --extra mjcf`"
        ) from error

    _check_files(path, folders_of(path, root).root)
    # without a listener MuJoCo writes its warnings to a file in the current directory
    listener = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _: None)
    try:
        model = mujoco.MjSpec.from_file(str(path)).compile()
        return _CompiledModel(path, model, scratch).robot()
    except (ValueError, mujoco.FatalError) as error:
        reason = " ".join(str(error).split())[:300]
        raise UrdfError(f"{path}: MuJoCo refuses it ({reason})") from error
    finally:
        mujoco.set_mju_user_warning(listener)


class _CompiledModel:
    """A compiled model; link frames are at joint anchors, as in a URDF."""

    def __init__(self, path: Path, model: Any, scratch: Path) -> None:
        self.path, self.model, self.scratch = path, model, scratch
        self.anchors = {int(model.jnt_bodyid[j]): pose(model.jnt_pos[j]) for j in range(model.njnt)}

    def robot(self) -> UrdfRobot:
        model = self.model
        moved = {int(model.body_rootid[body]) for body in model.jnt_bodyid}
        if not moved:
            raise UrdfError(f"{self.path}: no body of it has a joint")
        try:
            rules = couplings(model, partial(self._name, "joint"))
        except UrdfError as error:
            raise UrdfError(f"{self.path}: {error}") from error
        links, above, mimics = dict[str, UrdfLink](), dict[str, Joint](), dict[str, Mimic]()
        for body in (b for b in range(1, model.nbody) if int(model.body_rootid[b]) in moved):
            name = self._name("body", body)
            links[name] = self._link(body)
            for site in self._flanges(body):
                links[site.child] = UrdfLink(0.0, np.zeros(3), np.zeros((3, 3)), (), ())
                above[site.child] = site
            if model.body_parentid[body] == 0:
                continue
            joint = above[name] = self._joint(body)
            rule = rules.get(int(model.body_jntadr[body]))
            if rule is not None and rule.multiplier == 0:
                origin = compose(joint.origin, joint_motion(joint, rule.offset))
                above[name] = replace(joint, kind="fixed", origin=origin)
            elif rule is not None:
                mimics[joint.name] = rule
        return UrdfRobot(self.path, links, above, mimics)

    def _name(self, kind: str, i: int) -> str:
        given = getattr(self.model, kind)(i).name
        return given.replace("/", "_").replace("\\", "_") if given else f"{kind}_{i}"

    def _from_anchor(self, body: int, at: Pose) -> Pose:
        return compose(pose(-self.anchors.get(body, pose())[:3]), at)

    def _joint(self, body: int) -> Joint:
        model, name = self.model, self._name("body", body)
        parent = int(model.body_parentid[body])
        at = pose(model.body_pos[body], model.body_quat[body])
        origin = self._from_anchor(parent, compose(at, self.anchors.get(body, pose())))
        ends = self._name("body", parent), name
        if model.body_jntnum[body] == 0:
            return Joint(f"{name}_fixed", "fixed", *ends, origin)
        j = int(model.body_jntadr[body])
        kind = {2: "prismatic", 3: "revolute"}.get(int(model.jnt_type[j]))
        if model.body_jntnum[body] > 1 or kind is None:
            raise UrdfError(f"{self.path}: body {name!r} must have one joint, a hinge or a slide")
        turn = 2 * np.pi
        lower, upper = model.jnt_range[j].tolist() if model.jnt_limited[j] else (-turn, turn)
        x, y, z = model.jnt_axis[j].tolist()
        moves = (origin, (x, y, z), lower, upper, 0.0, self._effort(j))
        return Joint(self._name("joint", j), kind, *ends, *moves)

    def _effort(self, joint: int) -> float:
        """The largest force (N or N m) of a joint; 0 if unknown."""
        model, effort = self.model, 0.0
        here = (model.actuator_trnid[:, 0] == joint) & (model.actuator_trntype == 0)
        for a in np.flatnonzero(here):
            force = 0.0
            if model.actuator_forcelimited[a]:
                force = float(model.actuator_forcerange[a, 1])
            elif model.actuator_ctrllimited[a] and model.actuator_biastype[a] == 0:
                force = float(model.actuator_gainprm[a, 0] * model.actuator_ctrlrange[a, 1])
            effort = max(effort, abs(float(model.actuator_gear[a, 0])) * force)
        return effort

    def _flanges(self, body: int) -> Iterator[Joint]:
        model = self.model
        for site in np.flatnonzero(model.site_bodyid == body):
            name = self._name("site", int(site))
            if FLANGE in name:
                at = self._from_anchor(body, pose(model.site_pos[site], model.site_quat[site]))
                yield Joint(f"{name}_fixed", "fixed", self._name("body", body), name, at)

    def _link(self, body: int) -> UrdfLink:
        model = self.model
        at = self._from_anchor(body, pose(model.body_ipos[body], model.body_iquat[body]))
        turn = quat_to_matrix(at[3:])
        inertia = turn @ np.diag(model.body_inertia[body]) @ turn.T
        first = int(model.body_geomadr[body])
        geoms = range(first, first + int(model.body_geomnum[body]))
        seen = {g: shape for g in geoms if (shape := self._shape(g, body)) is not None}
        solid = {g for g in seen if model.geom_contype[g] or model.geom_conaffinity[g]}
        looks = [g for g in seen if g not in solid] or list(solid)
        fixed = model.body_jntnum[body] == 0 and model.body_mass[body] == 0
        return UrdfLink(
            *(0.0 if fixed else float(model.body_mass[body]), at[:3], inertia),
            tuple(seen[g] for g in looks if self._rgba(g)[3] > 0),
            tuple(seen[g] for g in sorted(solid)),
        )

    def _rgba(self, geom: int) -> Floats:
        own, material = self.model.geom_rgba[geom], int(self.model.geom_matid[geom])
        return self.model.mat_rgba[material] if material >= 0 and np.allclose(own, GREY) else own

    def _shape(self, geom: int, body: int) -> UrdfShape | None:
        model, size, kind = self.model, self.model.geom_size[geom].tolist(), f"geom_{geom}"
        match int(model.geom_type[geom]):
            case 2:
                mesh = trimesh.creation.icosphere(subdivisions=3, radius=size[0])
            case 3:
                mesh = trimesh.creation.capsule(2 * size[1], size[0])
            case 4:
                mesh = trimesh.creation.icosphere(subdivisions=3).apply_scale(size)
            case 5:
                mesh = trimesh.creation.cylinder(size[0], 2 * size[1])
            case 6:
                mesh = trimesh.creation.box(2 * np.array(size))
            case 7:
                i = int(model.geom_dataid[geom])
                points = model.mesh_vert[model.mesh_vertadr[i] :][: model.mesh_vertnum[i]]
                faces = model.mesh_face[model.mesh_faceadr[i] :][: model.mesh_facenum[i]]
                # a mesh that several geoms have is one file, which is cut once
                mesh, kind = trimesh.Trimesh(points, faces, process=False), f"mesh_{i}"
            case _:
                return None
        file = self.scratch / f"{kind}.stl"
        mesh.export(file)
        r, g, b = np.clip(self._rgba(geom)[:3], 0, 1).tolist()
        origin = self._from_anchor(body, pose(model.geom_pos[geom], model.geom_quat[geom]))
        return UrdfShape("mesh", origin, (), file, color=(r, g, b))


def _check_files(path: Path, root: Path) -> None:
    """Refuse files outside `root`, named twice, or not to be opened."""
    pending, seen = [path.resolve()], set[Path]()
    while pending:
        file = pending.pop()
        if file in seen:
            raise UrdfError(f"{path}: includes {file.name!r} twice or in a ring")
        seen.add(file)
        document = read_xml(file)
        if len(seen) == 1 and document.tag != "mujoco":
            raise UrdfError(f"{path}: is no MJCF: it begins with <{document.tag}>, not <mujoco>")
        keys = ("meshdir", "texturedir", "assetdir")
        folders = {c.get(key) or "" for c in document.iter("compiler") for key in keys} | {""}
        for element in document.iter("*"):
            for name in (value for key, value in element.items() if key.startswith("file")):
                places = [_within(path, root, Path(f) / name, name) for f in sorted(folders)]
                for one in filter(Path.exists, places):
                    try:  # a pipe, a device, a pointer of Git LFS, or too large
                        read_bytes(one)
                    except MeshError as error:
                        raise UrdfError(f"{path}: names {error}") from error
                    if element.tag in ("include", "model"):
                        pending.append(one)


def _within(path: Path, root: Path, place: Path, name: str) -> Path:
    target = (path.parent / place).resolve()
    if place.is_absolute() or PureWindowsPath(place).drive or not target.is_relative_to(root):
        raise UrdfError(f"{path}: names {name[:120]!r}, which is outside of {root}; copy it there")
    return target
