"""What an arm can do. Each skill is a function that returns a generator of beats; tasks yield skills, `together` joins two arms.

Distances in metres, speeds in m/s of the tcp. Sides are "left" and "right".
"""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.expert.actor import Actor, Beat, Skill
from pipeline.expert.failure import PlanFailure
from pipeline.expert.grasping import backed_off, hand_poses, lifted, plan_grasp
from pipeline.expert.planner import Leg
from pipeline.expert.reach import fingertip_reach
from pipeline.poses import Pose, compose, frame, inverse, pose, quat_about, quat_multiply, yawed
from pipeline.world.simulation import PHYSICS_HZ

APPROACH_SPEED = 0.30
SQUEEZE_SECONDS = 0.15


def _jaws(a: Actor, side: str, value: float, hold: float = SQUEEZE_SECONDS) -> Beat:
    """The jaws travel to `value` at their own speed, then wait `hold` s; the arm stands still."""
    gripper = a.planner.embodiment.arms[side].gripper
    stroke = abs(gripper.opened[0] - gripper.closed[0]) * abs(value - a.gripper(side))
    n = max(1, round(stroke / gripper.speed * PHYSICS_HZ))
    values = np.concatenate([np.linspace(a.gripper(side), value, n + 1)[1:], np.full(round(hold * PHYSICS_HZ), value)])
    q = np.repeat(a.q(side)[None], len(values), 0)
    return {side: Leg(q, np.zeros_like(q), values)}


def close(side: str) -> Skill:
    """Close the gripper."""

    def act(a: Actor) -> Iterator[Beat]:
        yield _jaws(a, side, 0.0)

    return act


def open_(side: str, by: float | None = None) -> Skill:
    """Open the gripper, all the way or only `by` m wider than it is measured to be; whatever it held is let go."""

    def act(a: Actor) -> Iterator[Beat]:
        a.held.pop(side, None)
        yield _jaws(a, side, 1.0 if by is None else _wider(a, side, by))

    return act


def _wider(a: Actor, side: str, by: float) -> float:
    """Gripper value `by` m wider than the measured opening."""
    gripper = a.planner.embodiment.arms[side].gripper
    measured = a.planner.split(a.simulation.state_vector(a.simulation.qpos()[0]))[side][1]
    return min(1.0, measured + by / gripper.max_opening)


def grasp(
    side: str,
    name: str,
    *,
    kinds: Sequence[str] | None = None,
    goals: Sequence[Sequence[Pose]] = (),
    standoff: float = 0.08,
    pitch: float = 0.9,
) -> Skill:
    """Go to the standoff, in on a straight line, and close on body `name`. See grasping.plan_grasp for the arguments."""

    def act(a: Actor) -> Iterator[Beat]:
        if a.gripper(side) < 0.99:
            yield _jaws(a, side, 1.0, hold=0.0)
        plan = plan_grasp(a, side, name, kinds=kinds, goals=goals, standoff=standoff, pitch=pitch)
        yield {side: plan.to_standoff}
        yield {side: a.planner.timed(side, plan.line, a.gripper(side), minimum=standoff / APPROACH_SPEED)}
        a.held[side] = name
        yield _jaws(a, side, 0.0)

    return act


def together(*skills: Skill) -> Skill:
    """Skills of different arms beat by beat at the same time, legs stretched to end together.

    Each arm is planned around where the others are about to be. Where two legs would still collide on the way, the arms take
    turns for that beat; where that collides too, PlanFailure("arms_collide") is raised.
    """

    def act(a: Actor) -> Iterator[Beat]:
        running = [skill(a) for skill in skills]
        while running:
            beat: Beat = {}
            for one in list(running):
                planned = next(one, None)
                if planned is None:
                    running.remove(one)
                else:
                    beat |= planned
                    a.expected |= {side: leg.q[-1] for side, leg in planned.items()}
            a.expected.clear()
            if beat:
                yield from _in_turns(a, beat)

    return act


def _in_turns(a: Actor, beat: Beat) -> Iterator[Beat]:
    longest = max(len(leg.q) for leg in beat.values())
    at_once = {side: _stretched(leg, longest, a.q(side), a.gripper(side)) for side, leg in beat.items()}
    if _arms_apart(a, at_once):
        yield at_once
        return
    sides = list(beat)
    for order in (sides, sides[::-1]):
        if all(_arms_apart(a, {side: beat[side]} | {s: _end_of(beat[s]) for s in order[:i]}) for i, side in enumerate(order)):
            for side in order:
                yield {side: beat[side]}
            return
    raise PlanFailure("arms_collide", "the arms would touch each other")


def _end_of(leg: Leg) -> Leg:
    return Leg(leg.q[-1:], leg.qd[-1:], leg.gripper[-1:])


def _stretched(leg: Leg, rows: int, q0: NDArray[np.float64], value: float) -> Leg:
    """The leg at a slower pace so that it fills `rows` steps; jaw motions keep their pace and wait."""
    n = len(leg.q)
    if n == rows:
        return leg
    if np.ptp(np.vstack([q0, leg.q]), axis=0).max() < 1e-9:
        pad = rows - n
        return Leg(
            np.pad(leg.q, ((0, pad), (0, 0)), mode="edge"),
            np.zeros((rows, leg.q.shape[1])),
            np.pad(leg.gripper, (0, pad), mode="edge"),
        )
    at = np.arange(1, rows + 1) * (n / rows)
    old = np.arange(n + 1)
    q = np.vstack([q0, leg.q])
    qd = np.vstack([np.zeros_like(q0), leg.qd])
    stretch = [np.interp(at, old, column) for column in q.T]
    speeds = [np.interp(at, old, column) * (n / rows) for column in qd.T]
    return Leg(np.stack(stretch, 1), np.stack(speeds, 1), np.interp(at, old, np.concatenate([[value], leg.gripper])))


def _arms_apart(a: Actor, beat: Beat) -> bool:
    """Whether the arms keep clear of each other along a beat; an arm without a leg stands at its command."""
    left, right = (beat[side].q if side in beat else a.q(side)[None] for side in ("left", "right"))
    rows = np.append(np.arange(0, max(len(left), len(right)), 12), max(len(left), len(right)) - 1)
    return a.planner.arms_apart(left[np.minimum(rows, len(left) - 1)], right[np.minimum(rows, len(right) - 1)])


def move(side: str, poses: ArrayLike, *, speed: float = 1.0) -> Skill:
    """Bring the tcp to the first of `poses` (N,7) or (7,) that can be reached without touching anything."""

    def act(a: Actor) -> Iterator[Beat]:
        yield {side: _go(a, side, np.atleast_2d(np.asarray(poses, float)), speed)}

    return act


def carry(side: str, bodies: ArrayLike, *, speed: float = 1.0, room: float = 0.0) -> Skill:
    """Bring the held body to the first of the poses `bodies` (N,7) or (7,) that can be reached without touching anything.

    Poses from which the hand could not draw back by `room` m are passed over where others are left.
    """

    def act(a: Actor) -> Iterator[Beat]:
        hands = hand_poses(a, side, np.atleast_2d(np.asarray(bodies, float)))
        if room > 0:
            roomy = a.planner.solve(a, side, np.stack([backed_off(h, room) for h in hands]))[1]
            hands = hands[roomy] if roomy.any() else hands
        yield {side: _go(a, side, hands, speed)}

    return act


def pour(side: str, upright: ArrayLike, tipped: ArrayLike, *, sway: float = 0.16, speed: float = 1.0) -> Skill:
    """Bring the held body to one of the poses `upright` (N,7), then tip it, all joints at an even pace, to one of `tipped` (M,7).

    While it tips, its origin stays within `sway` m of where it begins or ends, and nothing is touched.
    """

    def act(a: Actor) -> Iterator[Beat]:
        hold, free = inverse(a.in_hand(side)), a.planner.checker(a, side)

        def reached(bodies: ArrayLike) -> NDArray[np.float64]:
            q, ok = a.planner.solve(a, side, compose(np.atleast_2d(np.asarray(bodies, float)), hold[None]))
            return np.stack([row for row in q[ok] if free(row)] or [np.empty((0,))])

        over, down = reached(upright), reached(tipped)
        if not over.size or not down.size:
            raise PlanFailure("pour_unreachable", f"the {side} arm cannot hold it there, upright and tipped")
        distance = np.linalg.norm(over[:, None] - down[None], axis=-1)
        for k in np.argsort(distance, axis=None, kind="stable")[:80]:
            start, end = over[k // len(down)], down[k % len(down)]
            path = start + np.linspace(0, 1, 16)[:, None] * (end - start)
            at = np.stack([compose(a.planner.fk(side, row), inverse(hold))[:3] for row in path])
            off = np.minimum(np.linalg.norm(at - at[0], axis=1), np.linalg.norm(at - at[-1], axis=1))
            if off.max() > sway or not free(path):
                continue
            try:
                leg = a.planner.free_leg(a, side, start, free)
            except PlanFailure:
                continue
            yield {side: leg}
            yield {side: a.planner.timed(side, path[[0, -1]], a.gripper(side), speed=speed)}
            return
        raise PlanFailure("pour_blocked", f"the {side} arm finds no way to tip what it holds")

    return act


def _go(a: Actor, side: str, poses: NDArray[np.float64], speed: float = 1.0, tries: int = 8) -> Leg:
    q, ok = a.planner.solve(a, side, poses)
    if not ok.any():
        raise PlanFailure("pose_unreachable", f"none of {len(poses)} poses is in reach of the {side} arm")
    free = a.planner.checker(a, side)
    for i in np.flatnonzero(ok):
        if free(q[i]):
            tries -= 1
            try:
                return a.planner.free_leg(a, side, q[i], free, speed)
            except PlanFailure:
                if tries <= 0:
                    break
    raise PlanFailure("path_blocked", f"the {side} arm finds no free way to {len(poses)} poses")


def lift(side: str, height: float, *, speed: float = 0.25) -> Skill:
    """Move the tcp straight up, without turning it; a shorter way (at least 60 %) is taken where the arm ends."""

    def act(a: Actor) -> Iterator[Beat]:
        start = a.tcp(side)
        for part in (1.0, 0.8, 0.6):
            path = a.planner.line(side, a.q(side), lifted(start, height * part))
            if path is not None:
                yield {side: a.planner.timed(side, path, a.gripper(side), minimum=abs(height) * part / speed)}
                return
        raise PlanFailure("line_unreachable", f"the {side} arm cannot lift by {height} m")

    return act


def shift(side: str, by: ArrayLike, *, speed: float = 0.15) -> Skill:
    """Move the hand straight by a vector (3,) of the world, without turning it; at least 80 % of the way where the arm ends."""

    def act(a: Actor) -> Iterator[Beat]:
        start, way = a.tcp(side), np.concatenate([np.asarray(by, float), np.zeros(4)])
        for part in (1.0, 0.9, 0.8):
            path = a.planner.line(side, a.q(side), start + part * way)
            if path is not None:
                yield {side: a.planner.timed(side, path, a.gripper(side), minimum=part * float(np.linalg.norm(way)) / speed)}
                return
        raise PlanFailure("line_unreachable", f"the {side} arm cannot move its hand by {np.round(way[:3], 3)} m")

    return act


def retreat(side: str, distance: float, *, speed: float = 0.3) -> Skill:
    """Draw the hand straight back along its approach axis; where the arm ends, a shorter way (at least 20 %) or straight up."""

    def act(a: Actor) -> Iterator[Beat]:
        start = a.tcp(side)
        ways = [backed_off(start, distance * part) for part in (1.0, 0.8, 0.6, 0.4, 0.2)]
        for goal in (*ways, lifted(start, distance), lifted(start, 0.6 * distance)):
            path = a.planner.line(side, a.q(side), goal)
            if path is not None:
                length = float(np.linalg.norm(goal[:3] - start[:3]))
                yield {side: a.planner.timed(side, path, a.gripper(side), minimum=length / speed)}
                return
        raise PlanFailure("line_unreachable", f"the {side} arm cannot draw back by {distance} m")

    return act


def pause(side: str, seconds: float) -> Skill:
    """Hold still, for what was poured to run out."""

    def act(a: Actor) -> Iterator[Beat]:
        yield _jaws(a, side, a.gripper(side), hold=seconds)

    return act


def home(side: str) -> Skill:
    """Return the arm to its home joints."""

    def act(a: Actor) -> Iterator[Beat]:
        free = a.planner.checker(a, side)
        yield {side: a.planner.free_leg(a, side, a.planner.home(side), free)}

    return act


def resting_poses(local: Pose, goal: Pose, yaws: Sequence[float]) -> NDArray[np.float64]:
    """Poses (N,7) of a body whose frame `local` coincides with `goal` up to a turn about the goal's z axis by each of `yaws`."""
    turned = np.stack([compose(goal, yawed((0, 0, 0), yaw)) for yaw in yaws])
    return compose(turned, inverse(local)[None])


def upright_goal(position: ArrayLike, yaw: float = 0.0) -> Pose:
    """Pose at a position (3,) with z up."""
    return yawed(position, yaw)


ROUND = tuple(np.arange(0, 2 * np.pi, np.pi / 6))
"""Yaw angles to try for a body that may be set down in any direction."""


def place(
    side: str,
    point: str,
    onto: ArrayLike,
    *,
    yaws: Sequence[float] = (0.0,),
    above: float = 0.10,
    press: float = 0.003,
    speed: float = 0.2,
    out: ArrayLike = (0, 0, 1),
    opening: float | None = None,
) -> Skill:
    """Set the held body down so that its frame `point` meets `onto`, one of (N,7) poses or the only one (7,).

    It comes from over there at `above` m, or half of that where the arm ends, then straight down, `press` m beyond. `out` is the
    way back from the goal in the world, up unless said otherwise: a mug comes onto its peg along the peg. Ways on which jaws opened
    (by `opening` m, or all the way) touch nothing are preferred.
    """

    def act(a: Actor) -> Iterator[Beat]:
        name = a.held.get(side, "")
        back = np.concatenate([np.asarray(out, float), np.zeros(4)])
        local = a.frames(name)[point] if name else pose()
        bodies = np.concatenate([resting_poses(local, goal, yaws) for goal in np.atleast_2d(onto)])
        heights = np.repeat([above, 0.5 * above], len(bodies))
        down = np.tile(hand_poses(a, side, bodies), (2, 1))
        q, ok = a.planner.solve(a, side, down + heights[:, None] * back)
        if not ok.any():
            raise PlanFailure("place_unreachable", f"the {side} arm cannot hold {name} above its goal")
        free = a.planner.checker(a, side)
        cost = np.linalg.norm(q - a.q(side), axis=1) + 3.0 * (heights < above)
        order = np.argsort(np.where(ok, cost, np.inf), kind="stable")[: int(ok.sum())]
        jaws = 1.0 if opening is None else _wider(a, side, opening)
        roomy = a.planner.checker(
            a, side, [(name, other) for other in (*a.obstacles(), *a.held.values(), "table") if other != name], jaws, 0.0
        )
        lines = [(i, a.planner.line(side, q[i], down[i] - press * back)) for i in order[:24]]
        ways = [(i, line) for i, line in lines if line is not None]

        def closed_in(line: NDArray[np.float64]) -> int:
            """Whether opened jaws would touch something on the way, and whether the hand could not draw back at its end."""
            away = backed_off(a.planner.fk(side, line[-1]), 0.08)
            return (not roomy(line)) + (a.planner.line(side, line[-1], away) is None)

        ways.sort(key=lambda way: closed_in(way[1]))
        for i, line in ways[:12]:
            if not free(q[i]):
                continue
            try:
                leg = a.planner.free_leg(a, side, q[i], free)
            except PlanFailure:
                continue
            yield {side: leg}
            yield {side: a.planner.timed(side, line, a.gripper(side), minimum=(heights[i] + press) / speed)}
            return
        raise PlanFailure("place_blocked" if ways else "place_unreachable", f"the {side} arm cannot set {name} down there")

    return act


def press(
    side: str,
    spot: Pose,
    *,
    above: float = 0.08,
    depth: float = 0.004,
    speed: float = 0.25,
    pitches: Sequence[float] = (1.25, 1.0, 1.5, 0.8),
) -> Skill:
    """Touch the frame `spot` from above with the closed fingertips: over it at `above` m, then straight down, `depth` m beyond."""

    def act(a: Actor) -> Iterator[Beat]:
        tip = fingertip_reach(a.planner.embodiment.arms[side])
        candidates = []
        for pitch in pitches:
            for azimuth in np.arange(0, 2 * np.pi, np.pi / 8):
                approach = np.array([np.cos(azimuth) * np.cos(pitch), np.sin(azimuth) * np.cos(pitch), -np.sin(pitch)])
                for sign in (1, -1):
                    across = sign * np.array([-np.sin(azimuth), np.cos(azimuth), 0])
                    candidates.append(frame(spot[:3] - tip * approach, approach, across))
        down = np.array(candidates)
        q, ok = a.planner.solve(a, side, lifted(down, above))
        if not ok.any():
            raise PlanFailure("press_unreachable", f"the {side} arm cannot hover over the spot")
        free = a.planner.checker(a, side)
        # a steep finger pushes down, a slanting one pushes the thing away
        cost = np.linalg.norm(q - a.q(side), axis=1) + 2.0 * np.repeat(np.abs(np.array(pitches) - 1.35), len(down) // len(pitches))
        order = np.argsort(np.where(ok, cost, np.inf), kind="stable")[: int(ok.sum())]
        for i in order[:24]:
            line = a.planner.line(side, q[i], lifted(down[i], -depth))
            if line is None or not free(q[i]) or not free(line[: len(line) * 3 // 4]):
                continue
            try:
                leg = a.planner.free_leg(a, side, q[i], free)
            except PlanFailure:
                continue
            yield {side: leg}
            down_leg = a.planner.timed(side, line, a.gripper(side), minimum=(above + depth) / speed)
            yield {side: down_leg}
            yield {side: Leg(down_leg.q[-1:].repeat(24, 0), down_leg.qd[-1:].repeat(24, 0) * 0, down_leg.gripper[-1:].repeat(24))}
            return
        raise PlanFailure("press_blocked", f"the {side} arm finds no free way down to the spot")

    return act


def turn(side: str, axis: ArrayLike, angle: float, *, rise: float = 0.0, speed: float = 2.0) -> Skill:
    """Turn the hand about an axis of its own tcp frame by `angle` rad while it rises by `rise` m; `speed` multiplies the pace."""

    def act(a: Actor) -> Iterator[Beat]:
        start = a.tcp(side)
        goal = np.concatenate([start[:3] + np.array([0, 0, rise]), quat_multiply(start[3:], quat_about(axis, angle))])
        path = a.planner.line(side, a.q(side), goal)
        if path is None:
            raise PlanFailure("turn_unreachable", f"the {side} wrist cannot turn that far")
        yield {side: a.planner.timed(side, path, a.gripper(side), speed=speed)}

    return act


def shake(side: str, times: int, *, axes: Sequence[ArrayLike] = ((1, 0, 0), (0, 1, 0), (0, 0, 1)), rise: float = 0.03) -> Skill:
    """Swing the hand `times` times from side to side.

    The first of `axes` (in the tcp frame) with room on both sides is taken, with the widest swing of 0.9 to 0.55 rad that fits.
    """

    def act(a: Actor) -> Iterator[Beat]:
        start = a.tcp(side)
        for angle in (0.9, 0.75, 0.65, 0.55):
            for axis in axes:
                ends = [
                    compose(lifted(start, up), pose((0, 0, 0), quat_about(axis, sign * angle))) for sign, up in ((1, rise), (-1, 0))
                ]
                out = a.planner.line(side, a.q(side), ends[0])
                across = None if out is None else a.planner.line(side, out[-1], ends[1])
                if out is None or across is None:
                    continue
                yield {side: a.planner.timed(side, out, a.gripper(side), speed=2.0)}
                for k in range(times):
                    yield {side: a.planner.line_leg(a, side, ends[1 - k % 2], 10.0, pace=2.0)}
                yield {side: a.planner.line_leg(a, side, start, 10.0, pace=2.0)}
                return
        raise PlanFailure("shake_unreachable", f"the {side} arm cannot swing its hand either way")

    return act


def rock(
    side: str, bodies: ArrayLike, about: ArrayLike, times: int, *, angles: Sequence[float] = (0.85, 0.7, 0.6), speed: float = 2.0
) -> Skill:
    """Carry the held body to one of the poses `bodies` (N,7), rock it `times` times to either side, and come back to that pose.

    It turns with the hand about the world axes `about` (N,3), one per pose. The first pose is taken that leaves room for the
    widest of `angles` (rad); narrower ones are tried where there is none.
    """

    def act(a: Actor) -> Iterator[Beat]:
        hands = hand_poses(a, side, np.atleast_2d(np.asarray(bodies, float)))
        axes = np.atleast_2d(np.asarray(about, float))
        q, ok = a.planner.solve(a, side, hands)
        free = a.planner.checker(a, side)
        for angle in angles:
            ends = [
                np.array(
                    [
                        np.concatenate([h[:3], quat_multiply(quat_about(n, sign * angle), h[3:])])
                        for h, n in zip(hands, axes, strict=True)
                    ]
                )
                for sign in (1, -1)
            ]
            room = ok & a.planner.solve(a, side, ends[0])[1] & a.planner.solve(a, side, ends[1])[1]
            for i in np.flatnonzero(room)[:12]:
                out = a.planner.line(side, q[i], ends[0][i])
                across = None if out is None else a.planner.line(side, out[-1], ends[1][i])
                if out is None or across is None or not (free(q[i]) and free(out) and free(across)):
                    continue
                try:
                    leg = a.planner.free_leg(a, side, q[i], free)
                except PlanFailure:
                    continue
                yield {side: leg}
                yield {side: a.planner.timed(side, out, a.gripper(side), speed=speed)}
                for k in range(times):
                    yield {side: a.planner.line_leg(a, side, ends[1 - k % 2][i], 10.0, pace=speed)}
                yield {side: a.planner.line_leg(a, side, hands[i], 10.0, pace=speed)}
                return
        raise PlanFailure("rock_unreachable", f"the {side} arm finds no room to rock what it holds")

    return act
