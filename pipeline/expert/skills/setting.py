"""Set a held body down, or touch a spot with the fingertips."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pipeline.planning.budgets import MARGINS
from pipeline.planning.failure import PlanFailure
from pipeline.planning.path import between, ending_clear, first_touch
from pipeline.planning.planner import ArmPlanner
from pipeline.poses import Floats, Pose, compose, frame, inverse, lifted, pose, yawed

from ..actor import Actor, Steps, skill
from ..budgets import PLACE, PRESS, SPEEDS, TIMING
from ..candidates import backed_off, hand_poses
from .hand import fingertip_reach, wider

ROUND = tuple(np.arange(0, 2 * np.pi, np.pi / 6).tolist())  # yaws of a body for any direction


class Approach(NamedTuple):
    """Joints (K,n) that carry the hand straight down from a height (m)."""

    line: Floats
    height: float


def resting_poses(local: Pose, goal: ArrayLike, yaws: Sequence[float] = ROUND) -> Floats:
    """Poses (N,7) of a body whose frame `local` is at `goal`, turned by each of `yaws` about its z
    axis. `goal` is one pose (7,), or several (M,7)."""
    turns = [yawed((0, 0, 0), yaw) for yaw in yaws]
    turned = np.stack([compose(one, turn) for one in np.atleast_2d(goal) for turn in turns])
    return compose(turned, inverse(local)[None])


def upright_goal(position: ArrayLike, yaw: float = 0.0) -> Pose:
    """Pose at a position (3,) with z up."""
    return yawed(position, yaw)


def _approaches(
    arm: ArmPlanner, down: Floats, back: Floats, above: float, press: float
) -> list[Approach]:
    """Straight approaches to the poses `down` (N,7), cheapest first, searched in both directions:
    an arm may hover in a posture from which it cannot come down."""
    found = list[Approach]()
    low, deep = arm.solve(down - press * back)
    for height in (above * share for share in PLACE.height_shares):
        over = down + height * back
        q, ok = arm.solve(over)
        for i in range(len(down)):
            line = arm.line(q[i], down[i] - press * back) if ok[i] else None
            if line is None and deep[i]:
                upwards = arm.line(low[i], over[i])
                line = None if upwards is None else upwards[::-1]
            if line is not None:
                found.append(Approach(line, height))

    def cost(x: Approach) -> float:
        away = float(np.linalg.norm(x.line[0] - arm.q))
        return away + PLACE.height_weight * (1 - x.height / above)

    return sorted(found, key=cost)


@skill(part="point")
def place(
    a: Actor,
    side: str,
    point: str,
    onto: ArrayLike,
    *,
    yaws: Sequence[float] = (0.0,),
    above: float = PLACE.above,
    press: float = PLACE.press,
    speed: float = SPEEDS.place,
    out: ArrayLike = (0, 0, 1),
    opening: float | None = None,
) -> Steps:
    """Set the held body down so that its frame `point` meets `onto`, one of (N,7) poses or (7,),
    turned by one of `yaws`.

    It comes from `above` m, or half or a quarter of that, straight down and `press` m beyond; `out`
    (3,) is the world direction away: a mug comes onto its peg along the peg. Approaches on which
    jaws opened (by `opening` m, or all the way) touch nothing are preferred."""
    arm, name = a.arm_planner(side), a.held.get(side, "")
    back = np.concatenate([np.asarray(out, float), np.zeros(4)])
    local = a.frames(name)[point] if name else pose()
    hands = hand_poses(a, side, resting_poses(local, onto, yaws))
    approaches = _approaches(arm, hands, back, above, press)
    free = arm.checker()
    others = (*arm.scene.obstacles, *arm.scene.carried, "table")
    touching = [(name, other) for other in others if other != name]
    clear, roomy = arm.checker(touching, margin=MARGINS.contact), arm.checker(touching)
    fingers = [(f"{side}_fingers", other) for other in (*arm.scene.obstacles, *arm.scene.carried)]
    palm, bare = arm.checker([*touching, *fingers], margin=MARGINS.contact), arm.bare()
    table = bare.checker(), bare.checker(margin=MARGINS.contact)
    opened = 1.0 if opening is None else wider(a, side, opening)
    clear_opened = arm.checker(touching, jaws=opened, margin=MARGINS.contact)

    def penalty(approach: Approach) -> int:
        """Counts contacts of arm, body, opened jaws and withdrawing hand."""
        line = approach.line
        height = max(0.0, (approach.height - PLACE.settling) / (approach.height + press))
        down = between(line, 0.0, height)
        away = backed_off(arm.fk(line[-1]), PLACE.draw_back)
        touches = not clear(line)
        return (
            PLACE.touch_penalty * touches
            + PLACE.near_penalty * ((touches or not roomy(line)) + (not free(down)))
            + (not clear_opened(line))
            + (arm.line(line[-1], away) is None)
        )

    def down_to_table(approach: Approach) -> Floats | None:
        """The line, cut off near the table if less than PLACE.drop m over the goal."""
        least = (approach.height - PLACE.drop) / (approach.height + press)
        ends = (ending_clear(approach.line, clear_of_table, least) for clear_of_table in table)
        return next((line for line in ends if line is not None), None)

    some = (approaches[k : k + PLACE.judged] for k in range(0, len(approaches), PLACE.judged))
    tries = PLACE.tries
    for approach in (x for group in some for x in sorted(group, key=penalty)):
        line = down_to_table(approach)
        if line is None or not free(line[0]) or not palm(line):
            continue
        tries -= 1
        try:
            trajectory = arm.free_trajectory(line[0], free)
        except PlanFailure:
            if not tries:
                break
            continue
        yield {side: trajectory}
        yield {side: arm.timed(line, minimum=(approach.height + press) / speed)}
        return
    reason = "place_blocked" if approaches else "place_unreachable"
    raise PlanFailure(reason, f"the {side} arm cannot set {name} down there")


@skill(body="body", part="part")
def press(
    a: Actor,
    side: str,
    spot: Pose,
    *,
    above: float = PRESS.above,
    depth: float = PRESS.depth,
    speed: float = SPEEDS.press,
    pitches: Sequence[float] = PRESS.pitches,
    body: str = "",
    part: str = "",
) -> Steps:
    """Touch the frame `spot` with the closed fingertips: from `above` m straight down to where they
    touch, `depth` m beyond the spot at most. `body` and `part` name what is pressed, by default the
    target.

    They creep around the touch: an arm that is driven on throws what is under it over."""
    arm, pressed = a.arm_planner(side), body or a.simulation.target
    down = _fingertip_poses(spot, pitches, fingertip_reach(a.planner.embodiment.arms[side]))
    q, ok = arm.solve(lifted(down, above))
    if not ok.any():
        raise PlanFailure("press_unreachable", f"the {side} arm cannot hover over the spot")
    free = arm.checker()
    off_steep = np.repeat(np.abs(np.array(pitches) - PRESS.steep), len(down) // len(pitches))
    cost = np.linalg.norm(q - arm.q, axis=1) + PRESS.steep_weight * off_steep
    order = np.argsort(np.where(ok, cost, np.inf), kind="stable")[: int(ok.sum())]
    share, whole = PRESS.clear_share
    apart = arm.checker(margin=MARGINS.contact)
    clear = arm.checker([(f"{side}_fingers", pressed)], margin=MARGINS.contact)
    for i in order[: PRESS.tries]:
        line = arm.line(q[i], lifted(down[i], -depth))
        if line is None or not free(q[i]) or not free(line[: len(line) * share // whole]):
            continue
        length, touch = above + depth, first_touch(apart, line)
        near, end = (max(0.0, touch - PRESS.gap / length), min(1.0, touch + PRESS.squeeze / length))
        if not clear(between(line, 0.0, end)):
            continue
        try:
            trajectory = arm.free_trajectory(q[i], free)
        except PlanFailure:
            continue
        yield {side: trajectory}
        descent = arm.timed(between(line, 0.0, near), minimum=near * length / speed)
        creeping = arm.timed(between(line, near, end), minimum=(end - near) * length / SPEEDS.creep)
        yield {side: descent.then(creeping).holding(TIMING.press)}
        return
    raise PlanFailure("press_blocked", f"the {side} arm finds no free path down to the spot")


def _fingertip_poses(spot: Pose, pitches: Sequence[float], tip: float) -> Floats:
    poses = []
    for pitch in pitches:
        for azimuth in np.arange(0, 2 * np.pi, 2 * np.pi / PRESS.azimuths):
            level = np.cos(pitch)
            approach = [np.cos(azimuth) * level, np.sin(azimuth) * level, -np.sin(pitch)]
            approach = np.array(approach)
            for sign in (1, -1):
                across = sign * np.array([-np.sin(azimuth), np.cos(azimuth), 0])
                poses.append(frame(spot[:3] - tip * approach, approach, across))
    return np.array(poses)
