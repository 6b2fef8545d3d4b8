"""The gripper: close, open, grasp. Opening lets go of what was held."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from pipeline.data.clock import PHYSICS_HZ
from pipeline.planning.budgets import LIMITS
from pipeline.planning.trajectory import ArmTrajectory, time_parameterise
from pipeline.poses import Floats, compose, inverse, transform
from pipeline.world.robots.contract import Arm, arm_poses

from ..actor import Actor, MotionStep, Steps, skill
from ..budgets import GRASP, SPEEDS, TIMING
from ..candidates import Goals, GraspOptions
from ..grasping import plan_grasp


def jaws(a: Actor, side: str, value: float, hold: float = TIMING.squeeze) -> MotionStep:
    """The jaws travel to `value` at their own speed, then wait `hold` s."""
    gripper = a.planner.embodiment.arms[side].gripper
    travel = abs(gripper.opened[0] - gripper.closed[0])
    ends = np.array([[a.gripper(side)], [value]])
    limits = [gripper.speed / travel], [LIMITS.acceleration / travel]
    moving = time_parameterise(ends, *limits).q[1:, 0]
    values = np.concatenate([moving, np.full(max(round(hold * PHYSICS_HZ), 1), value)])
    q = np.repeat(a.q(side)[None], len(values), 0)
    return {side: ArmTrajectory(q, np.zeros_like(q), values)}


def wider(a: Actor, side: str, by: float) -> float:
    """Gripper value `by` m wider than the measured opening."""
    gripper = a.planner.embodiment.arms[side].gripper
    measured = a.planner.split(a.simulation.state_vector(a.simulation.qpos()[0]))[side][1]
    return min(1.0, measured + by / gripper.opening)


@skill()
def close(a: Actor, side: str) -> Steps:
    """Close the gripper."""
    yield jaws(a, side, 0.0)


@skill()
def open_(a: Actor, side: str, by: float | None = None) -> Steps:
    """Open the gripper, all the way or `by` m wider than measured, and let go."""
    a.held.pop(side, None)
    yield jaws(a, side, 1.0 if by is None else wider(a, side, by))


@skill(body="name", part="kinds")
def grasp(
    a: Actor,
    side: str,
    name: str,
    *,
    kinds: Sequence[str] | None = None,
    goals: Goals = (),
    standoff: float = GRASP.standoff,
    pitch: float = GRASP.pitch,
    steepest: float = np.pi / 2,
) -> Steps:
    """Go to the standoff, in on a straight line, and close on body `name` (GraspOptions)."""
    return take(a, side, name, GraspOptions(kinds, goals, standoff, pitch, steepest))


def take(a: Actor, side: str, name: str, options: GraspOptions) -> Steps:
    if a.gripper(side) < GRASP.open:
        yield jaws(a, side, 1.0, hold=0.0)
    plan = plan_grasp(a, side, name, options)
    a.approaches[name] = plan.approach
    if plan.jaws < a.gripper(side):
        yield jaws(a, side, plan.jaws, hold=0.0)
    yield {side: replace(plan.to_standoff, gripper=np.full(len(plan.to_standoff.q), plan.jaws))}
    yield {side: a.arm_planner(side).timed(plan.line, minimum=options.standoff / SPEEDS.approach)}
    a.held[side] = name
    yield jaws(a, side, 0.0)


@skill()
def pause(a: Actor, side: str, seconds: float) -> Steps:
    yield jaws(a, side, a.gripper(side), hold=seconds)


@lru_cache(maxsize=16)
def fingertip_reach(arm: Arm) -> float:
    """How far (m) the closed fingertips are ahead of the tcp along the approach axis."""
    return float(max(points[:, 0].max() for points in _pieces(arm, arm.gripper.fingers)))


@lru_cache(maxsize=16)
def hand_boxes(arm: Arm) -> Floats:
    """Bounds (N,2,3) of the closed hand's collision pieces in the tcp frame (m)."""
    pieces = _pieces(arm, (arm.hand, *arm.gripper.fingers))
    return np.array([(points.min(0), points.max(0)) for points in pieces])


def _pieces(arm: Arm, names: Iterable[str]) -> list[Floats]:
    """Points (K,3) in the tcp frame around links' pieces, jaws closed."""
    links = {link.name: link for link in arm.links}
    at = arm_poses(arm, arm.home, 0.0)
    tcp = inverse(compose(at[arm.hand], arm.tcp))
    pieces = ((compose(tcp, at[name]), c) for name in names for c in links[name].collision)
    return [transform(place, piece.support_points()) for place, piece in pieces]
