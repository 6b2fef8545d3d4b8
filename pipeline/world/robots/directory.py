"""A robot is a directory: `robot.urdf`, `meshes/`, `robot.toml` (what a URDF cannot say)."""

from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from pipeline.data.joints import joints_to
from pipeline.poses import Pose, compose, frame, pose, quat_from_rpy
from pipeline.world.files import GlbError, Table, read_glb, read_toml
from pipeline.world.shapes import Collider, Parts

from .contract import Arm, Gripper, Link, Mount, RobotError
from .urdf_file import UrdfError, UrdfLink, UrdfShape, read_urdf

URDF, TOML, MESHES = "robot.urdf", "robot.toml", "meshes"

# RoboTwin 2.0 `static_camera_list`: the same head camera for every robot
HEAD_CAMERA = frame((-0.032, -0.45, 1.35), (0, 0.6, -0.8), (-1, 0, 0))
HEAD_CAMERA.setflags(write=False)

Triple = tuple[float, float, float]
Stand = tuple[Parts, tuple[Collider, ...]]

type Side = Annotated[str, Field(pattern="^(left|right)$")]
type BySide[T] = Annotated[dict[Side, T], Field(min_length=2)]


class Tcp(Table):
    """The tool frame in the hand's link (m): `approach` is its x axis, `opening` its y axis."""

    position: Triple
    approach: Triple
    opening: Triple


class WristCamera(Table):
    """Metres `behind` and `above` the tool frame, pitched down by `pitch` (rad): fingers and held
    things up to 9 cm are in view."""

    behind: float = 0.095
    above: float = 0.085
    pitch: float = 0.55

    def at(self, tcp: Pose) -> Pose:
        """Pose (7,) in the link in which the tool is at `tcp` (7,)."""
        local = pose((-self.behind, 0, self.above), quat_from_rpy(0.0, self.pitch, 0.0))
        return compose(tcp, local)


class RootPlace(Table):
    """World pose: position (m) and unit quaternion wxyz."""

    position: Triple
    quaternion: tuple[float, float, float, float]


class JointDrives(Table):
    """N m/rad, N m s/rad; acceleration rad/s2 is a limit of planning."""

    stiffness: float = 5000.0
    damping: float = 500.0
    acceleration: float = 10.0


class JointLimit(Table):
    """Replaces the URDF's: rad or m, rad/s or m/s, N m or N."""

    lower: float | None = None
    upper: float | None = None
    velocity: float | None = None
    effort: float | None = None


class Torso(Table):
    """What carries both arms in place of stands: a GLB and boxes (lower and upper corner, m), world
    frame."""

    mesh: str
    boxes: tuple[tuple[Triple, Triple], ...]


class RobotToml(Table):
    aliases: tuple[str, ...] = ()
    licence: str = "unknown"
    source: str = ""
    hand: str
    tcp: Tcp
    gripper: Gripper
    home: BySide[tuple[float, ...]]
    place: BySide[RootPlace]
    foot: float = Field(gt=0)
    original: BySide[Triple] | None = None
    camera: WristCamera = WristCamera()
    drive: JointDrives = JointDrives()
    limits: dict[str, JointLimit] = Field(default_factory=dict)
    allowed_overlap: tuple[tuple[str, str], ...] = ()
    body: Torso | None = None


class RobotModel:
    """A robot of a directory, read on demand."""

    def __init__(self, directory: Path, name: str | None = None) -> None:
        self.directory = directory
        self.name = name or directory.name
        self.settings = read_toml(directory / TOML, RobotToml, RobotError)

    def arm(self, side: str) -> Arm:
        """The left or right arm at its place. Raises RobotError and UrdfError."""
        settings, place = self.settings, self.settings.place[side]
        base = np.array([*place.position, *place.quaternion])
        return replace(self._arm, base=base, home=settings.home[side])

    def body(self) -> Stand | None:
        """What carries both arms instead of two stands."""
        body = self.settings.body
        if body is None:
            return None
        mesh = (self.directory / body.mesh).resolve()
        if not mesh.is_relative_to(self.directory.resolve()) or not mesh.is_file():
            raise UrdfError(f"{self.directory / TOML}: {body.mesh!r} is no file of the directory")
        return read_glb(mesh), tuple(box(*corners) for corners in body.boxes)

    @cached_property
    def _arm(self) -> Arm:
        settings = self.settings
        robot = read_urdf(self.directory / URDF, self.directory)
        hand, tool = settings.hand, settings.tcp
        up = np.cross(tool.approach, tool.opening)
        tcp = frame(tool.position, tool.approach, np.cross(up, tool.approach))
        limits = {k: limit.model_dump(exclude_none=True) for k, limit in settings.limits.items()}
        joints = robot.parent_joint.values()
        return Arm(
            model=self.name,
            base=HEAD_CAMERA,  # of no side yet
            links=tuple(_link(name, link) for name, link in robot.links.items()),
            joints=tuple(replace(joint, **limits.get(joint.name, {})) for joint in joints),
            arm_joints=tuple(j.name for j in joints_to(hand, joints) if j.kind != "fixed"),
            hand=hand,
            tcp=tcp,
            gripper=settings.gripper,
            home=(),
            camera=Mount(hand, settings.camera.at(tcp)),
            **dict(settings.drive),
            allowed_overlap=settings.allowed_overlap,
        )


def box(lower: ArrayLike, upper: ArrayLike) -> Collider:
    """Box between two corners (3,), m."""
    a, b = np.asarray(lower, float), np.asarray(upper, float)
    return Collider("box", tuple(((b - a) / 2).tolist()), pose((a + b) / 2))


def _link(name: str, link: UrdfLink) -> Link:
    (ixx, ixy, ixz), (_, iyy, iyz), (_, _, izz) = link.inertia.tolist()
    x, y, z = link.com.tolist()
    looks, solids = _looks(link.visuals), tuple(map(_solid, link.collisions))
    return Link(name, link.mass, (x, y, z), (ixx, iyy, izz), looks, solids, (ixy, ixz, iyz))


def _looks(visuals: tuple[UrdfShape, ...]) -> Parts:
    parts, others = [], []
    for shape in visuals:
        try:
            parts += read_glb(shape.file) if shape.file is not None else ()
            others += [shape] * (shape.file is None)
        except GlbError:
            others.append(shape)
    if others:
        # trimesh takes longer than the rest of a robot
        from .surfaces import load_visual

        parts += load_visual(others)
    return tuple(parts)


def _solid(shape: UrdfShape) -> Collider:
    if shape.kind != "mesh":
        return Collider(shape.kind, shape.size, shape.origin)
    from .surfaces import hull

    return Collider("convex", (), vertices=hull(shape))
