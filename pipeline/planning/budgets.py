"""Search budgets, tolerances, margins and motion limits, in rad or m. Constants of the methods are
in the kernel files, the only ones that numba's cache notices.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class IkBudget:
    tolerance: tuple[float, float] = (1e-4, 1e-3)  # largest error of a solution: m, rad

    restarts: int = 8  # fixed joint vectors tried after the seeds

    give_up_after: int | None = 4
    """Starts after which a far target is given up: half the time, 1 % lost."""

    iterations: int = 30  # solver steps for each start

    path_iterations: int = 40  # solver steps for each pose along a path

    max_jump: float = 0.35  # rad or m between neighbouring poses of a path, in any joint

    stored_restarts: int = 200  # restart points kept for each arm

    limit_margin: float = 1e-3  # rad or m kept from both ends of every joint range


@dataclass(frozen=True)
class LineSampling:
    step: float = 0.01  # m

    turn: float = 0.08  # rad


@dataclass(frozen=True)
class PathBudget:
    iterations: int = 400  # random samples of one search

    shortcuts: int = 60  # random shortcuts tried on the path found

    resolution: float = 0.05
    """Rad or m between checked states of an edge, in the joint that moves most."""

    step: float = 0.5  # rad or m by which a tree grows at a time, in the joint that moves most

    searches: int = 3  # searches in all; each halves the distance between checked states

    final_division: int = 4  # the finished path is checked at `resolution` divided by this


@dataclass(frozen=True)
class Detours:
    """Longer than `ratio` times the straight line and `slack` (m)."""

    ratio: float = 1.5
    slack: float = 0.25

    searches: int = 3  # if the first is a detour or takes what is carried out of view

    unseen: float = 1.0  # m of a detour that one metre out of view is worth

    resolution: float = 0.1  # rad or m between states at which the tcp is looked at


@dataclass(frozen=True)
class MotionLimits:
    """What planned motions ask of the joints. All limits hold for differences of commands at the
    physics rate, in rad or m per s, s2, s3."""

    speed: float = 1.4  # where the robot's own limit is higher: calm to watch, quick to catch

    speed_share: float = 0.9  # share of the robot's own joint speed that no motion exceeds

    acceleration: float = 6.0  # where the robot's own limit is higher

    jerk: float = 240.0  # commands are averaged over twice acceleration / jerk: 0.05 s

    deviations: tuple[float, ...] = (0.01, 0.003, 0.0005)
    """rad or m of a rounded corner from the polyline: the next if one touches."""

    checked_every: int = 6  # rows between two checked states of a timed motion: 25 ms

    same: float = 1e-6  # waypoints closer than this (rad or m) in every joint are one

    longest: float = 60.0  # s; a longer motion is a failure of the time parameterisation

    grid: float = 0.05  # rad or m between grid points of the time parameterisation


@dataclass(frozen=True)
class Margins:
    """Gaps (m) between the robot with what it carries and everything else, and between its arms."""

    obstacles: float = 0.002  # of free motions

    contact: float = 0.0
    """Into and out of contact: fingers pass the table within 3 mm at low bodies."""

    arms: float = 0.012  # 1 cm, and what drives and rounding may be off

    hands: float = 0.003  # between two hands where one takes a body, until they have drawn apart


IK = IkBudget()
LINE = LineSampling()
PATH = PathBudget()
DETOURS = Detours()
LIMITS = MotionLimits()
MARGINS = Margins()
