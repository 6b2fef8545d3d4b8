"""Timed joint rows for one arm while the other stands still."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pipeline.data.names import SIDES
from pipeline.poses import Bools, Floats, Pose, transform
from pipeline.world.robots import get_embodiment
from pipeline.world.robots.contract import Embodiment

from .budgets import DETOURS, LIMITS, MARGINS
from .collision import Carried, CollisionWorld, PlanningScene, Sees
from .failure import PlanFailure
from .kinematics import Chain, chain_of, fk, fk_batch, ik_many, ik_path, line_poses
from .path import IsFree, connect, dense
from .trajectory import ArmTrajectory, time_parameterise


def unseen_length(way: Floats, carried: Carried, sees: Sees) -> float:
    """Length (m) of a way (M,7) on which the middle of what is carried is out of view; 0 if it
    begins or ends there."""
    middle = np.mean([piece.pose[:3] for piece in carried.pieces], axis=0)
    seen = sees(np.array([transform(tcp, transform(carried.pose, middle)) for tcp in way]))
    if not (seen[0] and seen[-1]):
        return 0.0
    steps = np.linalg.norm(np.diff(way[:, :3], axis=0), axis=1)
    return float(steps[~seen[1:]].sum())


NO_ARM: Floats = np.empty(0)  # the joints of an arm that the robot does not have


Apart = Callable[[ArrayLike, ArrayLike], bool]
"""Whether two arms keep clear along joint rows (K,n), left and right."""


class MotionBounds(NamedTuple):
    """Speed (n,), the fastest (n,) a skill may ask for, acceleration (n,)."""

    speed: Floats
    fastest: Floats
    acceleration: Floats


class Planner:
    def __init__(self, embodiment: Embodiment) -> None:
        self.embodiment = embodiment
        self.chains = {side: chain_of(arm) for side, arm in embodiment.arms.items()}
        self.world = CollisionWorld(embodiment)
        self.limits = dict[str, MotionBounds]()
        for side, arm in embodiment.arms.items():
            own = {joint.name: joint.velocity for joint in arm.joints}
            fastest = np.array([LIMITS.speed_share * own[name] for name in arm.arm_joints])
            acceleration = np.full(len(fastest), min(arm.acceleration, LIMITS.acceleration))
            speed = np.minimum(fastest, LIMITS.speed)
            self.limits[side] = MotionBounds(speed, fastest, acceleration)

    def split(self, vector: Floats) -> dict[str, tuple[Floats, float]]:
        """Arm joints (n,) and gripper value per side."""
        found, at = dict[str, tuple[Floats, float]](), 0
        for side, arm in self.embodiment.arms.items():
            n = at + len(arm.arm_joints)
            found[side] = vector[at:n], float(vector[n])
            at = n + 1
        return found

    def fk(self, side: str, q: ArrayLike) -> Pose:
        """World tcp pose (7,) for arm joints q (n,)."""
        return fk(self.chains[side], q)

    def home(self, side: str) -> Floats:
        return np.array(self.embodiment.arms[side].home)

    def command_limits(self) -> tuple[Floats, Floats, list[slice]]:
        """Speed and acceleration (A,) of commands, per s and s2, and columns of each arm."""
        speeds, accelerations, arms = list[Floats](), list[Floats](), list[slice]()
        for side, arm in self.embodiment.arms.items():
            gripper, limits, first = arm.gripper, self.limits[side], sum(map(len, speeds))
            travel = abs(gripper.opened[0] - gripper.closed[0])
            speeds.append(np.append(limits.speed, gripper.speed / travel))
            accelerations.append(np.append(limits.acceleration, LIMITS.acceleration / travel))
            arms.append(slice(first, first + len(limits.speed)))
        return np.concatenate(speeds), np.concatenate(accelerations), arms

    def apart(self, scene: PlanningScene) -> Apart:
        """The test for arms with what they carry. Hands nearer than MARGINS.arms now may not
        touch.
        """
        left, right = (scene.arms[side].q if side in scene.arms else NO_ARM for side in SIDES)
        jaws = scene.jaws
        for hands in (MARGINS.arms, MARGINS.hands, MARGINS.contact):
            kept = self.world.between_arms(scene.carried, hands)
            if kept.first_blocked(left, right, jaws) is None:
                break
        return lambda left, right: kept.first_blocked(left, right, jaws) is None


@dataclass(frozen=True, eq=False)
class ArmPlanner:
    """Plans motions of arm `side` that start at its command in `scene`."""

    planner: Planner
    side: str
    scene: PlanningScene
    rng: np.random.Generator

    @property
    def q(self) -> Floats:
        return self.scene.arms[self.side].q

    @property
    def gripper(self) -> float:
        return self.scene.arms[self.side].gripper

    @property
    def chain(self) -> Chain:
        return self.planner.chains[self.side]

    def within(self, scene: PlanningScene) -> "ArmPlanner":
        return replace(self, scene=scene)

    def bare(self) -> "ArmPlanner":
        """The same arm in the scene without bodies."""
        return self.within(replace(self.scene, obstacles={}, carried={}))

    def fk(self, q: ArrayLike) -> Pose:
        """World tcp pose (7,) for joints q (n,)."""
        return fk(self.chain, q)

    def solve(self, targets: Floats, seeds: Floats | None = None) -> tuple[Floats, Bools]:
        """Joints (N,n) of tcp poses (N,7) and which were reached (N,), from seeds (M,n)."""
        seeds = np.stack([self.q, self.chain.home]) if seeds is None else seeds
        return ik_many(self.chain, targets, seeds)

    def line(self, q0: Floats, goal: Pose) -> Floats | None:
        """Joints (K,n) straight from q0 (n,) to the tcp pose `goal` (7,), or None."""
        return ik_path(self.chain, line_poses(self.fk(q0), goal), q0)

    def checker(
        self,
        ignore: Iterable[tuple[str, str]] = (),
        *,
        jaws: float | None = None,
        margin: float = MARGINS.obstacles,
        hands: float = MARGINS.arms,
    ) -> IsFree:
        """`free(q)` for joints (n,) or rows (K,n), the other arm at its expected joints."""
        scene = self.scene
        collision = self.planner.world.with_objects(
            scene.obstacles, scene.carried, ignore=tuple(ignore), margin=margin, hands=hands
        )
        left, right = scene.jaws
        if jaws is not None:
            left, right = (jaws, right) if self.side == "left" else (left, jaws)
        return collision.free(self.side, self._other, (left, right))

    @property
    def _other(self) -> Floats:
        others = (state.expected for side, state in self.scene.arms.items() if side != self.side)
        return next(others, NO_ARM)

    def apart(self) -> IsFree:
        """As `Planner.apart` for this arm, the other one at its expected joints."""
        both, other = self.planner.apart(self.scene), self._other
        return (lambda q: both(q, other)) if self.side == "left" else (lambda q: both(other, q))

    def timed(
        self,
        waypoints: Floats,
        *,
        minimum: float = 0.0,
        speed_scale: float = 1.0,
        deviation: float = LIMITS.deviations[0],
    ) -> ArmTrajectory:
        """A motion of at least `minimum` s through waypoints (K,n), at rest at both ends. Raises
        PlanFailure("time_parameterisation").
        """
        limits = self.planner.limits[self.side]
        speed = np.minimum(limits.speed * speed_scale, limits.fastest)
        t = time_parameterise(
            waypoints, speed, limits.acceleration, minimum_duration=minimum, deviation=deviation
        )
        # the first row is where the arm already is
        rows = slice(1, None) if len(t.q) > 1 else slice(None)
        return ArmTrajectory(t.q[rows], t.qd[rows], np.full(len(t.q[rows]), self.gripper))

    def free_trajectory(
        self, goal: Floats, free: IsFree, *, speed_scale: float = 1.0
    ) -> ArmTrajectory:
        """A motion from the command to joints `goal` (n,) on which `free` holds, no detour, within
        the camera's view if possible. Raises PlanFailure: path_blocked, path_detour."""
        path = self._course(goal, free)
        for deviation in LIMITS.deviations:
            motion = self.timed(path, speed_scale=speed_scale, deviation=deviation)
            if len(path) == 2 or free(motion.q[:: LIMITS.checked_every]):
                return motion
        what = f"the {self.side} arm touches something in a rounded corner"
        raise PlanFailure("path_blocked", what)

    def _course(self, goal: Floats, free: IsFree) -> Floats:
        """Waypoints (K,n): of some searches the shortest tcp way in view."""
        held = next((c for c in self.scene.carried.values() if c.side == self.side), None)
        best, least, shortest = None, np.inf, np.inf
        for _ in range(DETOURS.searches):
            path = connect(free, self.q, goal, self.rng, (self.chain.lower, self.chain.upper))
            if path is None:
                break
            way = fk_batch(self.chain, dense(path, DETOURS.resolution))
            length = float(np.linalg.norm(np.diff(way[:, :3], axis=0), axis=1).sum())
            straight = float(np.linalg.norm(way[-1, :3] - way[0, :3]))
            unseen = 0.0 if held is None else unseen_length(way, held, self.scene.sees)
            shortest = min(shortest, length)
            fits = length <= DETOURS.slack + DETOURS.ratio * straight
            if fits and length + DETOURS.unseen * unseen < least:
                best, least = path, length + DETOURS.unseen * unseen
            if len(path) == 2 or (fits and not unseen):
                break
        if best is None and shortest < np.inf:
            raise PlanFailure("path_detour", f"the {self.side} hand would travel {shortest:.2f} m")
        if best is None:
            raise PlanFailure("path_blocked", f"the {self.side} arm finds no path")
        return best


@lru_cache(maxsize=4)
def planner_of(embodiment: Embodiment) -> Planner:
    return Planner(embodiment)


def planner_for(name: str) -> Planner:
    """The planner of an embodiment by its name, placed as in the clean domain."""
    return planner_of(get_embodiment(name))
