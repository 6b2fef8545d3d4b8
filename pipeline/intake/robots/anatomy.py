"""The arm's joints, its hand, and the motion of its fingers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.data.joints import FREE, Joint
from pipeline.poses import Floats, Pose, transform
from pipeline.world.robots.surfaces import surface
from pipeline.world.robots.urdf_file import UrdfRobot, UrdfShape

TIP = 0.02  # m: the part of a finger, from its end on, that is looked at for a pad
BEHIND_TIP = 0.018  # m: the tool frame's distance from the end of the fingers
SNAP = np.cos(np.radians(12.0))  # a direction this near to an axis of the hand is that axis
SWING = 0.9  # rad that a single hinged jaw opens
MOVES = 0.002  # m: a finger that moves less than this stands still
JAW_WORDS = ("jaw", "grip", "finger", "claw")


@dataclass(frozen=True, eq=False)
class Anatomy:
    """Gripper joints' (closed, open) positions; `tcp` in the hand's frame; `opening` (m) of the
    pads."""

    links: tuple[str, ...]
    joints: tuple[Joint, ...]
    arm_joints: tuple[str, ...]
    hand: str
    jaws: dict[str, tuple[float, float]]
    fingers: tuple[str, str]
    tcp: tuple[Floats, Floats, Floats]
    opening: float


def anatomy(robot: UrdfRobot, base: str | None = None, jaw: str | None = None) -> Anatomy:
    """The parts of the arm whose root is the link `base` and whose gripper the joint `jaw` drives.
    Raises UrdfError without arm or gripper, or for over two fingers."""
    base = _base(robot, base)
    links = robot.below(base)
    joints = [robot.parent_joint[link] for link in links[1:]]
    for joint in joints:
        if joint.kind in FREE:
            fix = f"make it fixed, or give --base {joint.child}"
            raise robot.fault(f"joint {joint.name!r} is {joint.kind}: {fix}")
    arm, jaws = _split(robot, base, joints, jaw)
    if not arm:
        raise robot.fault(f"no joint moves between {base!r} and the gripper; give another --base")
    hand = next(j for j in joints if j.name in jaws).parent
    fingers, tcp, opening, travel = _grip(robot, hand, links, _travel(robot, joints, jaws))
    return Anatomy(tuple(links), tuple(joints), tuple(arm), hand, travel, fingers, tcp, opening)


def _base(robot: UrdfRobot, given: str | None) -> str:
    if given is not None:
        if given not in robot.links:
            names = ", ".join([*robot.links][:12])
            raise robot.fault(f"has no link {given!r}; links are {names}")
        return given
    roots = robot.roots()
    if len(roots) > 1:
        wrong = f"links {', '.join(map(repr, roots[:4]))} hang on no joint"
    elif not roots:
        wrong = "its joints form a ring"
    elif lost := set(robot.links) - set(robot.below(roots[0])):
        wrong = f"link {min(lost)!r} hangs in a ring of joints"
    else:
        return roots[0]
    raise robot.fault(f"{wrong}: every link but the root needs one joint above it")


def _split(
    robot: UrdfRobot, base: str, joints: Sequence[Joint], jaw: str | None
) -> tuple[list[str], list[str]]:
    """Names of the joints of the arm and of the gripper."""
    arm, rigid, words = list[str](), {base}, ""
    while True:
        while more := {j.child for j in joints if j.kind == "fixed" and j.parent in rigid} - rigid:
            rigid |= more
        following = [j for j in joints if j.kind != "fixed" and j.parent in rigid]
        if not following:
            break
        last = following[0]
        is_jaw = last.name == jaw or last.name in robot.mimics
        if len(following) > 1 or is_jaw or last.kind != "revolute":
            links, jaws = {j.child for j in following}, [j.name for j in following]
            for joint in joints:
                if joint.parent in links:
                    links.add(joint.child)
                    if joint.kind != "fixed" and joint.name not in jaws:
                        jaws.append(joint.name)
            return arm, jaws
        arm.append(last.name)
        rigid, words = {last.child}, f"{last.name} {last.child}".lower()
    if arm and (any(word in words for word in JAW_WORDS) or len(arm) > 7):
        return arm[:-1], arm[-1:]
    last = arm[-1] if arm else base
    raise robot.fault(f"has no gripper: no joint moves beyond {last!r}; add one, or give --jaw")


def _travel(
    robot: UrdfRobot, joints: Sequence[Joint], jaws: Sequence[str]
) -> dict[str, tuple[float, float]]:
    by_name = {j.name: j for j in joints}
    free = [name for name in jaws if name not in robot.mimics]
    slides = all(by_name[name].kind == "prismatic" for name in free)
    if len(free) > 2 or (len(free) == 2 and not slides):
        names = ", ".join(free[:6])
        raise robot.fault(f"joints of the hand move by themselves: couple {names} with <mimic>")
    ends: dict[str, tuple[float, float]] = {}
    for joint in (by_name[name] for name in free):
        if not joint.lower < joint.upper:
            raise robot.fault(f"joint {joint.name!r} of the gripper needs limits lower < upper")
        ends[joint.name] = joint.lower, joint.upper
    if len(free) == 2 and _shift(robot, by_name[free[0]]) @ _shift(robot, by_name[free[1]]) > 0:
        lower, upper = ends[free[1]]
        ends[free[1]] = upper, lower  # of two slides one opens the way the other closes
    for name in (n for n in jaws if n in robot.mimics):
        rule = robot.mimics[name]
        if rule.joint not in ends:
            raise robot.fault(f"{name!r} mimics {rule.joint!r}, no driven joint")
        a, b = ends[rule.joint]
        ends[name] = rule.multiplier * a + rule.offset, rule.multiplier * b + rule.offset
    return ends


def _shift(robot: UrdfRobot, slide: Joint) -> Floats:
    return robot.link_poses(slide.parent, {slide.child: 1.0})[slide.child][:3] - slide.origin[:3]


def _grip(
    robot: UrdfRobot, hand: str, links: Sequence[str], travel: dict[str, tuple[float, float]]
) -> tuple[tuple[str, str], tuple[Floats, Floats, Floats], float, dict[str, tuple[float, float]]]:
    """Fingers, tool frame, opening (m), travel from closed to open."""
    gripper = [link for link in robot.below(hand)[1:] if link in links]
    clouds = {link: found for link in [hand, *gripper] if len(found := cloud(robot, link))}
    at = [_place_parts(robot, hand, travel, share) for share in (0.0, 0.5, 1.0)]
    shift = dict[str, Floats]()
    for link in (n for n in gripper if n in clouds):
        ends = [transform(poses[link], clouds[link]) for poses in (at[0], at[2])]
        shift[link] = (ends[1] - ends[0]).mean(0)
    moving = [link for link in shift if np.linalg.norm(shift[link]) > MOVES]
    if not moving:
        raise robot.fault(f"no finger of the hand {hand!r} moves and has a shape")
    approach = np.concatenate([transform(at[1][n], clouds[n]) for n in moving]).mean(0)
    if len(moving) == 1 and hand in robot.parent_joint:
        # beside a jaw that is part of the hand the middle of the fingers is elsewhere: the wrist
        # turns about the approach direction
        axis = np.array(robot.parent_joint[hand].axis)
        approach = axis * np.sign(axis @ approach)
    approach = _snapped(approach)

    def end_of(link: str) -> float:
        return float((transform(at[1][link], clouds[link]) @ approach).max())

    first = max(moving, key=end_of)
    opening = shift[first] - approach * (shift[first] @ approach)
    if np.linalg.norm(opening) < MOVES:
        raise robot.fault(f"the fingers of {hand!r} move along its approach")
    opening = _snapped(opening)
    against = [n for n in moving if shift[n] @ opening < 0]
    second = max(against or [n for n in clouds if n not in moving], key=end_of, default=hand)

    def gap(poses: Mapping[str, Pose]) -> tuple[float, Floats]:
        """Distance between the pads along `opening`, and the middle point."""
        tips = []
        for link in (first, second):
            points = transform(poses[link], clouds[link])
            along = points @ approach
            tips.append(points[along > along.max() - TIP])
        middle = [np.median(tip @ opening) for tip in tips]
        sign = 1.0 if middle[0] >= middle[1] else -1.0
        inner = [(sign * (tips[0] @ opening)).min(), (sign * (tips[1] @ opening)).max()]
        side = np.cross(approach, opening)
        across = np.concatenate(tips) @ side
        point = approach * (reach(poses) - BEHIND_TIP) + side * (across.min() + across.max()) / 2
        return inner[0] - inner[1], point + opening * sign * (inner[0] + inner[1]) / 2

    def reach(poses: Mapping[str, Pose]) -> float:
        ends = [transform(poses[n], clouds[n]) @ approach for n in (first, second)]
        return min(float(end.max()) for end in ends)

    ends = [gap(poses)[0] for poses in (at[0], at[2])]
    widest = max((abs(b - a) for a, b in travel.values()), default=0.0)
    # a jaw that swings: beyond this its pad faces away from the other one
    if len(travel) == 1 and widest > SWING:
        if reach(at[0]) <= reach(at[2]):
            travel = {name: (b, a) for name, (a, b) in travel.items()}
        travel = {name: (a, a + SWING / widest * (b - a)) for name, (a, b) in travel.items()}
        ends = [gap(_place_parts(robot, hand, travel, share))[0] for share in (0.0, 1.0)]
    elif ends[0] > ends[1]:
        travel, ends = {name: (b, a) for name, (a, b) in travel.items()}, ends[::-1]
    if ends[1] < 0.01:
        room = f"{1e3 * ends[1]:.0f} mm between them when open"
        raise robot.fault(f"the fingers {first!r} and {second!r} leave {room}")
    if ends[0] < 0:  # the pads meet before the end of the travel
        low, high = 0.0, 1.0
        for _ in range(30):
            middle = (low + high) / 2
            met = gap(_place_parts(robot, hand, travel, middle))[0] < 0
            low, high = (middle, high) if met else (low, middle)
        travel = {name: (a + high * (b - a), b) for name, (a, b) in travel.items()}
    opened, _ = gap(_place_parts(robot, hand, travel, 1.0))
    point = gap(_place_parts(robot, hand, travel, min(1.0, 0.04 / opened)))[1]
    return (first, second), (point, approach, opening), float(opened), travel


def _place_parts(
    robot: UrdfRobot, hand: str, travel: Mapping[str, tuple[float, float]], share: float
) -> dict[str, Pose]:
    """Poses in the hand's frame of what hangs on it."""
    at = {name: a + share * (b - a) for name, (a, b) in travel.items()}
    joints = robot.parent_joint.items()
    return robot.link_poses(hand, {link: at.get(joint.name, 0.0) for link, joint in joints})


def cloud(robot: UrdfRobot, link: str) -> Floats:
    """Sample at most 4000 points (N,3) m on a link's shapes."""
    shapes = robot.links[link].collisions or robot.links[link].visuals
    points = np.concatenate([np.zeros((0, 3)), *(_points(shape) for shape in shapes)])
    return points[:: 1 + len(points) // 4000]


def _points(shape: UrdfShape) -> Floats:
    if shape.kind == "mesh":
        return surface(shape)[0]
    size = shape.size
    half = np.array(size if shape.kind == "box" else (size[0], size[0], size[-1]))
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 9)] * 3, indexing="ij"), -1).reshape(-1, 3)
    return transform(shape.origin, grid[np.abs(grid).max(1) == 1] * half)


def _snapped(direction: Floats) -> Floats:
    unit = direction / np.linalg.norm(direction)
    longest = int(np.abs(unit).argmax())
    axis = np.eye(3)[longest] * np.sign(unit[longest])
    return axis if unit @ axis > SNAP else unit
