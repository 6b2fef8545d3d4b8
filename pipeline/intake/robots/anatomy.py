"""Which joints of a URDF are the arm, which link is the hand, and how its fingers move."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.poses import Pose, transform
from pipeline.world.robots.contract import Joint
from pipeline.world.robots.surfaces import surface
from pipeline.world.robots.urdf_file import FREE, Mimic, UrdfError, UrdfRobot, UrdfShape

TIP = 0.02  # m: the part of a finger, from its end on, that is looked at for a pad
BEHIND_TIP = 0.018  # m: the tool frame's distance from the end of the fingers
SNAP = np.cos(np.radians(12.0))  # a direction this near to an axis of the hand is that axis
SWING = 0.9  # rad that a single hinged jaw opens
MOVES = 0.002  # m: a finger that moves less than this stands still
JAW_WORDS = ("jaw", "grip", "finger", "claw")

type Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Hints:
    """What the user, or a configuration beside the URDF, says: nothing of it is needed for a robot
    with one arm and one gripper.

    `base` is the root link of the arm, `jaw` the joint that drives the gripper, `mimics` how other
    joints follow it, `strokes` its positions closed and open.
    """

    base: str | None = None
    jaw: str | None = None
    mimics: Mapping[str, Mimic] = field(default_factory=dict)
    strokes: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class Anatomy:
    """The parts of an arm: its links, those of `joints` that make the arm, the hand's link, and the
    gripper as fractions of travel.

    `jaws` gives (position at 0, position at 1) of each driven joint of the gripper, 0 closed, 1
    open. `tcp` holds position, approach and opening direction in the hand's frame; `opening` (m) is
    the distance between the pads when open.
    """

    links: tuple[str, ...]
    joints: tuple[Joint, ...]
    arm_joints: tuple[str, ...]
    hand: str
    jaws: dict[str, tuple[float, float]]
    fingers: tuple[str, str]
    tcp: tuple[Floats, Floats, Floats]
    opening: float


def anatomy(robot: UrdfRobot, hints: Hints = Hints()) -> Anatomy:
    """The parts of the robot's arm. Raises UrdfError, one line, where there is no arm, no gripper,
    or more than two fingers."""
    base = _base(robot, hints)
    links = robot.below(base)
    joints = [robot.parent_joint[link] for link in links[1:]]
    mimics = {**robot.mimics, **hints.mimics}
    for joint in joints:
        if joint.kind in FREE:
            fix = f"make it fixed, or give --base {joint.child}, the root of the arm"
            raise UrdfError(
                f"{robot.path}: joint {joint.name!r} is {joint.kind}, and an arm stands on a fixed"
                f" base: {fix}"
            )
    arm, jaws = _split(robot, base, joints, mimics, hints)
    if not arm:
        raise UrdfError(
            f"{robot.path}: no joint moves between {base!r} and the gripper; give --base LINK, the"
            " root of the arm"
        )
    hand = next(j for j in joints if j.name in jaws).parent
    travel = _travel(robot, joints, jaws, mimics, hints)
    fingers, tcp, opening, travel = _grip(robot, hand, links, travel)
    return Anatomy(tuple(links), tuple(joints), tuple(arm), hand, travel, fingers, tcp, opening)


def _base(robot: UrdfRobot, hints: Hints) -> str:
    if hints.base is not None:
        if hints.base not in robot.links:
            raise UrdfError(
                f"{robot.path}: has no link {hints.base!r}; links are"
                f" {', '.join([*robot.links][:12])}"
            )
        return hints.base
    roots = robot.roots()
    if len(roots) != 1:
        message = (
            f"links {', '.join(map(repr, roots[:4]))} hang on no joint"
            if roots
            else "its joints form a ring"
        )
        raise UrdfError(
            f"{robot.path}: {message}: every link but the root needs one joint above it"
        )
    lost = set(robot.links) - set(robot.below(roots[0]))
    if lost:
        raise UrdfError(
            f"{robot.path}: link {min(lost)!r} hangs in a ring of joints: every link but the root"
            " needs one joint above it"
        )
    return roots[0]


def _split(
    robot: UrdfRobot, base: str, joints: Sequence[Joint], mimics: Mapping[str, Mimic], hints: Hints
) -> tuple[list[str], list[str]]:
    """Names of the arm's joints in order and of the gripper's moving joints."""
    arm: list[str] = []
    rigid = {base}
    while True:
        while more := {j.child for j in joints if j.kind == "fixed" and j.parent in rigid} - rigid:
            rigid |= more
        following = [j for j in joints if j.kind != "fixed" and j.parent in rigid]
        if not following:
            break
        arms = [
            j
            for j in following
            if j.name not in mimics and j.name != hints.jaw and j.kind == "revolute"
        ]
        jaw_here = (
            any(j.name == hints.jaw or j.name in mimics for j in following) or len(following) > 1
        )
        if jaw_here or not arms:
            return arm, _below(joints, following)
        arm.append(arms[0].name)
        rigid = {arms[0].child}
    last = next((j for j in joints if arm and j.name == arm[-1]), None)
    named = last is not None and any(
        word in f"{last.name} {last.child}".lower() for word in JAW_WORDS
    )
    if last is not None and (named or len(arm) > 7):
        return arm[:-1], [last.name]
    raise UrdfError(
        f"{robot.path}: has no gripper: no joint moves beyond {arm[-1] if arm else base!r}; add one"
        " to the URDF, or give --jaw"
    )


def _below(joints: Sequence[Joint], first: Sequence[Joint]) -> list[str]:
    links, names = {j.child for j in first}, [j.name for j in first]
    for joint in joints:
        if joint.parent in links:
            links.add(joint.child)
            if joint.kind != "fixed" and joint.name not in names:
                names.append(joint.name)
    return names


def _travel(
    robot: UrdfRobot,
    joints: Sequence[Joint],
    jaws: Sequence[str],
    mimics: Mapping[str, Mimic],
    hints: Hints,
) -> dict[str, tuple[float, float]]:
    """Position of each joint of the gripper at both ends of its travel."""
    by_name = {j.name: j for j in joints}
    free = [name for name in jaws if name not in mimics]
    slides = all(by_name[name].kind == "prismatic" for name in free)
    if len(free) > 2 or (len(free) == 2 and not slides):
        raise UrdfError(
            f"{robot.path}: {len(free)} joints of the hand move by themselves"
            f" ({', '.join(free[:6])}): only grippers of two coupled fingers are supported; couple"
            " them with <mimic>, or use another hand"
        )
    ends: dict[str, tuple[float, float]] = {}
    for name in free:
        joint = by_name[name]
        if not joint.lower < joint.upper:
            raise UrdfError(
                f"{robot.path}: joint {name!r} of the gripper needs limits lower < upper"
            )
        ends[name] = (
            hints.strokes
            if hints.strokes is not None and name == hints.jaw
            else (joint.lower, joint.upper)
        )
    if len(free) == 2 and _shift(robot, by_name[free[0]]) @ _shift(robot, by_name[free[1]]) > 0:
        lower, upper = ends[free[1]]
        ends[free[1]] = upper, lower  # of two slides one opens the way the other closes
    for name in (n for n in jaws if n in mimics):
        rule = mimics[name]
        if rule.joint not in ends:
            raise UrdfError(
                f"{robot.path}: joint {name!r} mimics {rule.joint!r}, which is no driven joint of"
                " the gripper"
            )
        a, b = ends[rule.joint]
        ends[name] = rule.multiplier * a + rule.offset, rule.multiplier * b + rule.offset
    return ends


def _shift(robot: UrdfRobot, slide: Joint) -> Floats:
    """How a slide moves its link, in the frame of the link above it."""
    return robot.link_poses(slide.parent, {slide.child: 1.0})[slide.child][:3] - slide.origin[:3]


def _grip(
    robot: UrdfRobot, hand: str, links: Sequence[str], travel: dict[str, tuple[float, float]]
) -> tuple[tuple[str, str], tuple[Floats, Floats, Floats], float, dict[str, tuple[float, float]]]:
    """Fingers, tool frame (position, approach, opening), opening (m) and the travel ordered closed
    to open."""
    gripper = [link for link in robot.below(hand)[1:] if link in links]
    clouds = {link: found for link in [hand, *gripper] if len(found := cloud(robot, link))}
    at = [_place_parts(robot, hand, travel, share) for share in (0.0, 0.5, 1.0)]
    shift = {
        link: at[2][link][:3] - at[0][link][:3] if link in clouds else np.zeros(3)
        for link in gripper
    }
    for link in (n for n in gripper if n in clouds):
        ends = [transform(poses[link], clouds[link]) for poses in (at[0], at[2])]
        shift[link] = (ends[1] - ends[0]).mean(0)
    moving = [link for link in gripper if link in clouds and np.linalg.norm(shift[link]) > MOVES]
    if not moving:
        raise UrdfError(f"{robot.path}: no finger of the hand {hand!r} moves and has a shape")
    approach = np.concatenate([transform(at[1][n], clouds[n]) for n in moving]).mean(0)
    if len(moving) == 1 and hand in robot.parent_joint:
        # beside a jaw that is part of the hand the middle of the fingers is elsewhere: the wrist
        # turns about the approach direction
        axis = np.array(robot.parent_joint[hand].axis)
        approach = axis * np.sign(axis @ approach)
    approach = snapped(approach)
    first = max(moving, key=lambda n: float((transform(at[1][n], clouds[n]) @ approach).max()))
    opening = shift[first] - approach * (shift[first] @ approach)
    if np.linalg.norm(opening) < MOVES:
        raise UrdfError(
            f"{robot.path}: the fingers of {hand!r} do not move across its approach direction"
        )
    opening = snapped(opening)
    other = (
        [n for n in moving if shift[n] @ opening < 0]
        or [n for n in clouds if n not in moving]
        or [hand]
    )
    second = max(
        other,
        key=lambda n: (
            float((transform(at[1][n], clouds[n]) @ approach).max()) if n in clouds else -1.0
        ),
    )

    def gap(poses: Mapping[str, Pose]) -> tuple[float, Floats]:
        """Distance between the pads along `opening`, and the point in the middle of them."""
        tips = []
        for link in (first, second):
            points = transform(poses[link], clouds[link])
            along = points @ approach
            tips.append(points[along > along.max() - TIP])
        middle = [np.median(tip @ opening) for tip in tips]
        sign = 1.0 if middle[0] >= middle[1] else -1.0
        inner = [(sign * (tips[0] @ opening)).min(), (sign * (tips[1] @ opening)).max()]
        side = np.cross(approach, opening)
        across = (
            float(np.concatenate(tips).dot(side).min() + np.concatenate(tips).dot(side).max()) / 2
        )
        return (
            inner[0] - inner[1],
            approach * (reach(poses) - BEHIND_TIP)
            + opening * sign * (inner[0] + inner[1]) / 2
            + side * across,
        )

    def reach(poses: Mapping[str, Pose]) -> float:
        """How far the shorter finger stands out of the hand."""
        return min(
            float((transform(poses[n], clouds[n]) @ approach).max()) for n in (first, second)
        )

    ends = [gap(poses)[0] for poses in (at[0], at[2])]
    widest = max((abs(b - a) for a, b in travel.values()), default=0.0)
    # a jaw that swings: beyond this its pad faces away from the other one
    if len(travel) == 1 and widest > SWING:
        closed_first = reach(at[0]) > reach(at[2])
        travel = {
            n: (
                (a, a + SWING / widest * (b - a))
                if closed_first
                else (b, b + SWING / widest * (a - b))
            )
            for n, (a, b) in travel.items()
        }
        ends = [gap(_place_parts(robot, hand, travel, share))[0] for share in (0.0, 1.0)]
    elif ends[0] > ends[1]:
        travel, ends = {name: (b, a) for name, (a, b) in travel.items()}, ends[::-1]
    if ends[1] < 0.01:
        raise UrdfError(
            f"{robot.path}: the fingers {first!r} and {second!r} leave {1e3 * ends[1]:.0f} mm"
            " between them when open"
        )
    if ends[0] < 0:  # the pads meet before the end of the travel
        low, high = 0.0, 1.0
        for _ in range(30):
            middle = (low + high) / 2
            low, high = (
                (middle, high)
                if gap(_place_parts(robot, hand, travel, middle))[0] < 0
                else (low, middle)
            )
        travel = {name: (a + high * (b - a), b) for name, (a, b) in travel.items()}
    opened, _ = gap(_place_parts(robot, hand, travel, 1.0))
    point = gap(_place_parts(robot, hand, travel, min(1.0, 0.04 / opened)))[1]
    return (first, second), (point, approach, opening), float(opened), travel


def _place_parts(
    robot: UrdfRobot, hand: str, travel: Mapping[str, tuple[float, float]], share: float
) -> dict[str, Pose]:
    """Poses in the hand's frame of what hangs on it."""
    at = {name: a + share * (b - a) for name, (a, b) in travel.items()}
    return robot.link_poses(
        hand, {link: at.get(joint.name, 0.0) for link, joint in robot.parent_joint.items()}
    )


def cloud(robot: UrdfRobot, link: str) -> Floats:
    """Points (N,3) m on a link's collision shapes, or on its looks where it has none; at most 4000.
    Raises UrdfError."""
    shapes = robot.links[link].collisions or robot.links[link].visuals
    points = np.concatenate([np.zeros((0, 3)), *(_points(shape) for shape in shapes)])
    return points[:: 1 + len(points) // 4000]


def _points(shape: UrdfShape) -> Floats:
    if shape.kind == "mesh":
        return surface(shape)[0]
    half = np.array(
        shape.size if shape.kind == "box" else (shape.size[0], shape.size[0], shape.size[-1])
    )
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 9)] * 3, indexing="ij"), -1).reshape(-1, 3)
    return transform(shape.origin, grid[np.abs(grid).max(1) == 1] * half)


def snapped(direction: Floats) -> Floats:
    """The unit vector of a direction; an axis where it is within 12 degrees of one."""
    unit = direction / np.linalg.norm(direction)
    axis = np.zeros(3)
    axis[int(np.abs(unit).argmax())] = np.sign(unit[int(np.abs(unit).argmax())])
    return axis if unit @ axis > SNAP else unit
