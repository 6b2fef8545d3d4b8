"""Sequences of skills that many tasks share; a body may be set down and grasped again."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from pipeline.planning.collision import Obstacle
from pipeline.planning.failure import PlanFailure
from pipeline.planning.planner import ArmPlanner
from pipeline.poses import Floats, Ints, Pose, compose, inverse, yawed
from pipeline.world.physics.body import TABLE_TOP, apart

from .actor import Actor, Skill, Skills, Steps
from .budgets import GRASP, PLACE, SEAT
from .candidates import Goals, GraspOptions, leading_grasps
from .grasping import search_of
from .skills import grasp, in_turn, lift, open_, place, resting_poses, retreat


def set_down_on(
    a: Actor,
    side: str,
    name: str,
    onto: Pose,
    yaws: Sequence[float] = (0.0,),
    *,
    point: str = "base",
    up: float = 0.10,
    above: float = 0.10,
) -> Skills:
    """Grasp body `name`, lift it by `up` m, and set it down with its frame `point` on `onto` (7,),
    turned by one of `yaws`. If no single grasp can do it, it is set down in between."""
    goals = [resting_poses(a.frames(name)[point], onto, yaws)]
    yield from regrasp(a, side, name, goals)
    yield grasp(side, name, goals=goals)
    yield lift(side, up)
    yield place_or_regrasp(side, point, onto, yaws=yaws, above=above)


def let_go(side: str, back: float = 0.08) -> Skills:
    """Open the gripper and draw the hand `back` m."""
    yield open_(side)
    yield retreat(side, back)


def regrasp(a: Actor, side: str, name: str, goals: Goals) -> Skills:
    """Skills that set body `name` down where a grasp leads to the goals. None if it is held, a
    grasp leads there already, or there is no such place."""
    if a.held.get(side) == name or promising(a, a.arm_planner(side), name, a.pose(name), goals):
        return
    seats = find_seats(a, side, name, goals)
    if len(seats) > 0:
        yield grasp(side, name, goals=[seats])
        yield lift(side, SEAT.above)
        yield from _seat(a, side, name, seats)


def place_or_regrasp(
    side: str,
    point: str,
    onto: Pose,
    *,
    yaws: Sequence[float] = (0.0,),
    above: float = PLACE.above,
    opening: float | None = None,
) -> Skill:
    """Like `place`; if it fails, the body is set down and grasped again, once."""
    placing = place(side, point, onto, yaws=yaws, above=above, opening=opening)

    def act(a: Actor) -> Steps:
        try:
            yield from placing(a)
        except PlanFailure as failure:
            name = a.held[side]
            goals = [resting_poses(a.frames(name)[point], onto, yaws)]
            seats = find_seats(a, side, name, goals)
            if len(seats) == 0:
                raise failure from None
            taken = (grasp(side, name, goals=goals), lift(side, GRASP.lift))
            yield from in_turn(*_seat(a, side, name, seats), *taken, placing)(a)

    return act


def _seat(a: Actor, side: str, name: str, seats: Floats) -> Skills:
    yield place(side, "base", compose(seats, a.frames(name)["base"][None]), above=SEAT.above)
    yield from let_go(side)


def promising(a: Actor, arm: ArmPlanner, name: str, at: Pose, goals: Goals) -> bool:
    """Whether a grasp of the body at this world pose leads to the goals."""
    try:
        return search_of(a, arm, name, at, GraspOptions(goals=goals)).promising()
    except PlanFailure:
        return False


def find_seats(a: Actor, side: str, name: str, goals: Goals) -> Floats:
    """Poses (N,7) where the body can be set down and grasped again to reach a goal."""
    arm, start = a.arm_planner(side), a.pose(name)
    held = side in a.held
    try:
        into = inverse(a.in_hand(side))[None] if held else _at_hand(a, arm, name)
        out = leading_grasps(arm, name, a.frames(name).grasps, goals)
    except PlanFailure:
        return np.zeros((0, 7))
    seats = _free_places(a, side, name)
    counts = _reached(arm, seats, into) * (len(out) if held else 1)
    near = counts > 0
    counts[near] = np.minimum(counts[near], _reached(arm, seats[near], out))
    chosen = list[Pose]()
    for k in np.argsort(-counts, kind="stable")[: SEAT.tries]:
        if counts[k] == 0 or len(chosen) == SEAT.wanted:
            break
        obstacles = {**arm.scene.obstacles, name: Obstacle(a.collision(name), seats[k])}
        carried = {n: c for n, c in arm.scene.carried.items() if n != name}
        seated = arm.within(replace(arm.scene, obstacles=obstacles, carried=carried))
        if promising(a, seated, name, seats[k], goals) and (
            held or promising(a, arm, name, start, [seats[k : k + 1]])
        ):
            chosen.append(seats[k])
    return np.array(chosen).reshape(-1, 7)


def _at_hand(a: Actor, arm: ArmPlanner, name: str) -> Floats:
    """Tcp poses (N,7), in the body frame, that can grasp it."""
    found = search_of(a, arm, name, a.pose(name), GraspOptions()).found
    return found.local[found.order]


def _free_places(a: Actor, side: str, name: str) -> Floats:
    """Upright poses (N,7) on the arm's side with room."""
    sign = 1 if side == "right" else -1
    turns = 2 * np.pi / SEAT.turns * np.arange(SEAT.turns)
    box = a.bodies[name].instance.shape().aabb()
    standing = (b for n, b in a.bodies.items() if n != name and not b.rides)
    others = [(a.pose(b.name), b.instance.shape().aabb()) for b in standing]
    spots = product(SEAT.xs, SEAT.ys, turns)
    places = (yawed((sign * x, y, TABLE_TOP), turn) for x, y, turn in spots)
    free = [p for p in places if all(apart((p, box), other, SEAT.gap) for other in others)]
    return np.array(free).reshape(-1, 7)


def _reached(arm: ArmPlanner, bodies: Floats, local: Floats) -> Ints:
    """How many tcp poses `local` are in reach for each body pose (B,7)."""
    some = local[:: max(1, len(local) // SEAT.grasps)]
    tcp = compose(bodies[:, None], some)
    return arm.solve(tcp.reshape(-1, 7))[1].reshape(tcp.shape[:2]).sum(1)
