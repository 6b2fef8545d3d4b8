"""`domino-data robots add`: writes a robot's directory."""

import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pipeline.data.joints import Joint
from pipeline.data.names import NONE, is_name
from pipeline.data.process.limited import run_limited
from pipeline.poses import compose, frame, pose, quat_rotate
from pipeline.world.robots.contract import Arm, Gripper, Link, Mount, RobotError, arm_poses
from pipeline.world.robots.directory import TOML, WristCamera
from pipeline.world.robots.pairs import ALIASES, MODELS
from pipeline.world.robots.surfaces import load_visual
from pipeline.world.robots.urdf_file import Mimic, UrdfError, UrdfRobot, read_urdf

from .anatomy import Anatomy, anatomy, cloud
from .mjcf import FLANGE, MJCF, read_mjcf
from .place import find_site, overlaps
from .simplify import ConvexPieces
from .write import RobotDraft, write_robot

FASTEST, STRONGEST = 3.0, 150.0  # rad/s and N m: beyond these a URDF's limits are placeholders
SPEED, EFFORT = 2.0, 50.0  # of a joint whose limits are missing or placeholders
TURN = 2 * np.pi
# kg and kg m2: lighter links and smaller inertias make joints ring
LIGHTEST, SMALLEST = 0.005, 1e-5
DENSITY = 1000.0  # kg/m3, of a link whose inertia is missing
JAW_FORCE, JAW_SPEED, JAW_TORQUE = 60.0, 0.2, 10.0  # N, m/s and N m of a jaw
PREFIX = "gripper_"  # of every link and joint of a gripper that is joined to an arm
OVERLAPPING = 0.6  # share of configurations in which a pair of links that always touches does


@dataclass(frozen=True)
class RobotOptions:
    """Root link of the arm, driving joint of the gripper, a gripper's file, the link that carries
    it, and directories of packages by name."""

    name: str
    to: Path
    base: str | None = None
    jaw: str | None = None
    licence: str = "unknown"
    gripper: Path | None = None
    flange: str | None = None
    packages: Mapping[str, Path] = field(default_factory=dict)


class AddedRobot(NamedTuple):
    directory: Path
    notes: tuple[str, ...]


def add_robot(source: Path, options: RobotOptions) -> AddedRobot:
    """Read a robot in a limited child process and write it. Raises DominoError before writing."""
    directory = options.to / "robots" / options.name
    check_name(options.name, directory)
    draft = run_limited(str(source), draft_robot, source, options)
    write_robot(draft, directory)
    return AddedRobot(directory, draft.notes)


def check_name(name: str, directory: Path) -> None:
    if not is_name(name) or name != name.lower() or "_" in name or name == NONE:
        raise RobotError(f"--name {name!r}: is no name of a robot; use lower case and hyphens")
    if name in MODELS or name in ALIASES:
        raise RobotError(f"--name {name}: a robot of this name exists; choose another")
    if (directory / TOML).exists():
        raise RobotError(f"{directory}: exists; remove it first, or choose another --name")


def draft_robot(source: Path, options: RobotOptions) -> RobotDraft:
    for given in (source, options.gripper or source):
        if not (given.is_file() or given.is_dir()):
            raise RobotError(f"{given}: is neither a URDF, nor an MJCF, nor a directory")
    with tempfile.TemporaryDirectory() as scratch:
        root = source if source.is_dir() else None
        robot = _read(source, root, options, Path(scratch) / "arm")
        if options.gripper is not None:
            gripper = _read(options.gripper, None, options, Path(scratch) / "gripper")
            robot = mount(robot, gripper, options.flange)
        return _draft_of(robot, anatomy(robot, options.base, options.jaw), options)


def _read(source: Path, root: Path | None, options: RobotOptions, scratch: Path) -> UrdfRobot:
    if source.suffix in MJCF and source.is_file():
        scratch.mkdir()
        return read_mjcf(source, scratch, root)
    files = [source] if source.is_file() else sorted(source.rglob("*.urdf"))
    if len(files) != 1:
        names = ", ".join(str(p.relative_to(source)) for p in files[:6]) or "none"
        raise UrdfError(
            f"{source}: expected one .urdf, found {names}; give the path of the file to use"
        )
    return read_urdf(files[0], root, options.packages)


def mount(arm: UrdfRobot, gripper: UrdfRobot, flange: str | None) -> UrdfRobot:
    """Join the gripper to the arm's link `flange`, by default the last. Raises UrdfError."""
    roots = gripper.roots()
    if len(roots) != 1:
        raise gripper.fault(f"has {len(roots)} root links, a gripper one: {roots[:6]}")
    at = flange or _flange(arm)
    if at not in arm.links:
        last = ", ".join([*arm.links][-8:])
        raise arm.fault(f"--flange {at!r}: has no such link; the last ones are {last}")
    for joint in (arm.parent_joint[link] for link in arm.below(at)[1:]):
        if joint.kind != "fixed":
            raise arm.fault(f"joint {joint.name!r} moves beyond {at!r}: leave --gripper away")
    renamed = {
        PREFIX + link: replace(
            joint,
            name=PREFIX + joint.name,
            parent=PREFIX + joint.parent,
            child=PREFIX + joint.child,
        )
        for link, joint in gripper.parent_joint.items()
    }
    root = PREFIX + roots[0]
    renamed[root] = Joint(f"{PREFIX}mount", "fixed", at, root, pose())
    mimics = {
        PREFIX + name: Mimic(PREFIX + m.joint, m.multiplier, m.offset)
        for name, m in gripper.mimics.items()
    }
    links = arm.links | {PREFIX + name: link for name, link in gripper.links.items()}
    return UrdfRobot(arm.path, links, arm.parent_joint | renamed, arm.mimics | mimics)


def _flange(arm: UrdfRobot) -> str:
    named = [link for link in arm.links if FLANGE in link]
    above = arm.parent_joint
    parents = {joint.parent for joint in above.values()}
    moved = [joint.child for joint in above.values() if joint.kind != "fixed"]
    last = [tip for tip in moved if all(above[x].kind == "fixed" for x in arm.below(tip)[1:])]
    ends = [link for tip in last for link in arm.below(tip) if link not in parents]
    candidates = named if len(named) == 1 else ends
    if len(candidates) != 1:
        found = ", ".join(candidates[:8]) or "no link"
        raise arm.fault(f"found {found} to carry the gripper; give --flange LINK")
    return candidates[0]


def _draft_of(robot: UrdfRobot, parts: Anatomy, options: RobotOptions) -> RobotDraft:
    pieces, notes = ConvexPieces(), list[str]()
    links = tuple(_link(robot, name, pieces, notes) for name in parts.links)
    driven = {*parts.arm_joints, *parts.jaws}
    joints = tuple(
        _joint(joint, robot, parts) if joint.name in driven else replace(joint, kind="fixed")
        for joint in parts.joints
    )
    guessed = ", ".join(
        a.name
        for a, b in zip(joints, parts.joints, strict=True)
        if a.kind != "fixed" and (a.velocity, a.effort) != (b.velocity, b.effort)
    )
    if guessed:
        notes.append(f"limits of speed or effort are missing or placeholders: guessed {guessed}")
    position, approach, opening = (np.round(v, 5) for v in parts.tcp)
    tcp = frame(position, approach, opening)
    middle = tuple((j.lower + j.upper) / 2 for j in joints if j.name in parts.arm_joints)
    arm = Arm(
        *(options.name, pose(), links, joints, parts.arm_joints, parts.hand, tcp),
        *(_gripper(parts, joints), middle),
        Mount(parts.hand, WristCamera().at(tcp)),
    )
    touching = {pair for pair, share in overlaps(arm).items() if share > OVERLAPPING}
    arm = replace(arm, allowed_overlap=tuple(sorted(touching | {parts.fingers})))
    site = find_site(arm)
    if site is None:
        raise robot.fault("there is no place from which the arm reaches over the table freely")
    # the opening direction is turned so that the wrist camera is above the hand at home
    left = site.arms["left"]
    hand = arm_poses(left, left.home)[left.hand]
    above = quat_rotate(compose(hand, left.tcp)[3:], [0.0, 0.0, 1.0])[2] >= -0.01
    return RobotDraft(
        *(arm, site, (position, approach, opening if above else -opening)),
        _foot(robot, parts.links[0]),
        *(options.licence, robot.path.name, tuple(dict.fromkeys(notes))),
    )


def _gripper(parts: Anatomy, joints: tuple[Joint, ...]) -> Gripper:
    first = next(j for j in joints if j.name in parts.jaws)
    closed, opened = zip(*parts.jaws.values(), strict=True)
    drive = JAW_FORCE, JAW_SPEED, 1500.0, 60.0
    if first.kind == "revolute":
        travel = abs(np.subtract(*parts.jaws[first.name]))
        speed = float(round(min(FASTEST, JAW_SPEED * travel / max(parts.opening / 2, 0.01)), 4))
        drive = JAW_TORQUE, speed, 120.0, 5.0
    return Gripper(tuple(parts.jaws), parts.fingers, closed, opened, parts.opening, *drive)


def _joint(joint: Joint, robot: UrdfRobot, parts: Anatomy) -> Joint:
    velocity = joint.velocity if 0 < joint.velocity <= FASTEST else SPEED
    effort = joint.effort if 0 < joint.effort <= STRONGEST else EFFORT
    lower, upper = max(joint.lower, -TURN), min(joint.upper, TURN)
    if joint.name in parts.jaws:
        ends = parts.jaws[joint.name]
        lower, upper = min(ends) - 1e-3, max(ends) + 1e-3
    elif not lower < upper:
        limits = f"{joint.lower:g} to {joint.upper:g}"
        raise robot.fault(f"joint {joint.name!r} has limits {limits}: give it lower < upper")
    return replace(joint, lower=lower, upper=upper, velocity=velocity, effort=effort)


def _link(robot: UrdfRobot, name: str, pieces: ConvexPieces, notes: list[str]) -> Link:
    link = robot.links[name]
    solids = pieces.of(link.collisions or [shape for shape in link.visuals if shape.kind == "mesh"])
    if link.mass < 0 or (link.mass == 0 and link.inertia.any()):
        raise robot.fault(f"link {name!r} has mass {link.mass:g}: give it one above 0")
    mass, com, inertia = link.mass, link.com, link.inertia
    if mass == 0:
        points = cloud(robot, name)
        mass = max(DENSITY * sum(piece.volume() for piece in solids) / 2, LIGHTEST)
        com = points.mean(0) if len(points) else np.zeros(3)
        size = np.ptp(points, axis=0) if len(points) else np.full(3, 0.01)
        inertia = np.diag(mass / 12 * (np.sum(size**2) - size**2))
    values, axes = np.linalg.eigh(inertia)
    inertia = axes @ np.diag(np.maximum(values, SMALLEST)) @ axes.T
    (ixx, ixy, ixz), (_, iyy, iyz), (_, _, izz) = inertia.tolist()
    x, y, z = com.tolist()
    looks = load_visual(link.visuals, notes)
    mass = max(mass, LIGHTEST)
    return Link(name, mass, (x, y, z), (ixx, iyy, izz), looks, solids, (ixy, ixz, iyz))


def _foot(robot: UrdfRobot, root: str) -> float:
    points = cloud(robot, root)
    if not len(points):
        return 0.06
    low = points[points[:, 2] < points[:, 2].min() + 0.02]
    return float(np.clip(np.round(np.abs(low[:, :2]).max(), 3), 0.03, 0.15))


def describe(added: AddedRobot) -> Iterator[str]:
    directory = added.directory
    count = len((directory / TOML).read_text("utf-8").splitlines())
    yield from (f"note: {note}" for note in added.notes)
    yield f"wrote {directory}: {count} lines of {TOML}"
    yield f"use it with: --plugins {directory.parents[1]} --embodiment {directory.name}"
