"""Search budgets, tolerances, margins and motion limits of planning, each in one place.

Constants of the numerical methods (damping, step length, iteration caps) stand in the kernel files
instead: numba compiles them in, and its disk cache notices changes of the file a kernel is in only.
`rad or m` is the unit of a revolute or prismatic joint.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class IkBudget:
    """Effort and accuracy of inverse kinematics."""

    tolerance: tuple[float, float] = (1e-4, 1e-3)
    """Largest position error (m) and orientation error (rad) of a solution."""

    restarts: int = 8
    """Fixed joint vectors tried after the seeds, at most `stored_restarts`."""

    give_up_after: int | None = 4
    """Starts after which a target that is still far away is given up; this halves the time where
    many targets are out of reach and loses one solution in a hundred. None tries all."""

    iterations: int = 30
    """Solver steps for each start."""

    path_iterations: int = 40
    """Solver steps for each pose along a path."""

    max_jump: float = 0.35
    """Largest joint motion (rad or m) between neighbouring poses of a path."""

    stored_restarts: int = 200
    """Restart points kept for each arm."""

    limit_margin: float = 1e-3
    """Distance (rad or m) kept from both ends of every joint range."""


@dataclass(frozen=True)
class LineSampling:
    """Distance between neighbouring poses of a straight tcp line."""

    step: float = 0.01
    """m."""

    turn: float = 0.08
    """rad."""


@dataclass(frozen=True)
class PathBudget:
    """Effort of RRT-Connect and of the shortcuts after it."""

    iterations: int = 400
    """Random samples of one search."""

    shortcuts: int = 60
    """Random shortcuts tried on the path found."""

    resolution: float = 0.05
    """Distance (rad or m) between checked states of an edge, in the joint that moves most."""

    step: float = 0.5
    """Length (rad or m) by which a tree grows at a time, in the joint that moves most."""

    searches: int = 3
    """Searches in all; each halves the distance between checked states."""

    final_division: int = 4
    """The finished path is checked at `resolution` divided by this."""


@dataclass(frozen=True)
class Detours:
    """How long the way (m) of the tcp on a free motion may be, against the straight line from its
    start to its end."""

    ratio: float = 1.5
    slack: float = 0.25
    """Longer than ratio times the straight line and slack is a detour, and no motion."""

    searches: int = 3
    """Paths searched in all where the first is a detour or takes what is carried out of the head
    camera's view."""

    unseen: float = 1.0
    """Metres of a detour that one metre out of view is worth."""

    resolution: float = 0.1
    """Distance (rad or m) between states at which the tcp is looked at, in the joint that moves
    most."""


@dataclass(frozen=True)
class MotionLimits:
    """What planned motions ask of the joints. All limits hold for differences of commands at the
    physics rate."""

    speed: float = 1.4
    """rad/s or m/s, where the robot's own limit is higher: calm enough to watch, quick enough to
    catch."""

    speed_share: float = 0.9
    """Share of the robot's own joint speed limit that no motion exceeds, whatever speed a skill
    asks for."""

    acceleration: float = 6.0
    """rad/s2 or m/s2, where the robot's own limit is higher."""

    jerk: float = 240.0
    """rad/s3 or m/s3. Commands are averaged over twice the acceleration limit divided by this: 0.05
    s."""

    deviations: tuple[float, ...] = (0.01, 0.003, 0.0005)
    """Largest distance (rad or m) of a rounded corner from the checked polyline. The rounded path
    is checked again: where it touches something, the next one is taken."""

    checked_every: int = 6
    """Rows between two states at which a timed motion is checked: 25 ms."""

    same: float = 1e-6
    """Waypoints closer than this (rad or m) in every joint are one."""

    longest: float = 60.0
    """s; a motion that takes longer is a failure of the time parameterisation."""

    grid: float = 0.05
    """Largest distance (rad or m) between grid points of the time parameterisation."""

    line_speed: float = 0.25
    """m/s of the tcp along a straight line unless another speed is asked for."""


@dataclass(frozen=True)
class Margins:
    """Gaps (m) between the robot with what it carries and everything else, and between its arms."""

    obstacles: float = 0.002
    """Free motions keep this gap."""

    contact: float = 0.0
    """Motions into and out of contact keep no gap: fingers pass the table within 3 mm when they
    grasp low bodies."""

    arms: float = 0.012
    """Between links of the two arms, whatever they do: 1 cm, and what drives and the rounding of
    corners may be off."""

    hands: float = 0.003
    """Between the links of two hands where one takes a body from the other, and until they have
    drawn apart."""


IK = IkBudget()
LINE = LineSampling()
PATH = PathBudget()
DETOURS = Detours()
LIMITS = MotionLimits()
MARGINS = Margins()
