"""Where an arm should stand, by how much of the table it reaches, and how it rests there.

Reach is measured for the left arm; the right one mirrors it.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from pipeline.data.names import SIDES
from pipeline.planning.budgets import IkBudget
from pipeline.planning.collision import CollisionWorld
from pipeline.planning.kinematics import Chain, chain_of, fk_batch, ik_many, limit_margin
from pipeline.poses import Bools, Floats, compose, frame, pose, quat_about, quat_rotate, transform
from pipeline.world.physics.body import TABLE_TOP
from pipeline.world.robots.contract import Arm, Embodiment, arm_poses
from pipeline.world.robots.directory import HEAD_CAMERA

IK = IkBudget(restarts=12, iterations=25, give_up_after=None)
HOME_IK = IkBudget(restarts=24, iterations=40, give_up_after=None)
NEAR_CAMERA = 0.12
SAMPLES = 20_000
FAR = 6.0  # m: an arm there is in nobody's way
ROOM = 0.04  # m between the arms at rest
PLACES = tuple(product((0.25, 0.3, 0.38, 0.45), (-0.55, -0.45, -0.38), (0.55, 0.75, 0.85)))
TRIED = 4  # of the places, measured by inverse kinematics
HOME_X, HOME_Y, HOME_Z = (0.0, 0.06, -0.06), (-0.2, -0.12, -0.28), (1.0, 1.08, 0.94)
HOMES = tuple(product(HOME_X, HOME_Y, HOME_Z, (60.0, 75.0, 45.0)))


@dataclass(frozen=True, eq=False)
class Scan:
    """Heights above the table (m), pitches and azimuths (degrees), grid lines x and y (m)."""

    heights: tuple[float, ...]
    pitches: tuple[float, ...]
    azimuths: tuple[float, ...]
    x: Floats
    y: Floats


def lines(first: float, last: float, spacing: float) -> Floats:
    return np.arange(first, last + 1e-4, spacing, dtype=np.float64)


GRID = lines(-0.4, 0.1, 0.1), lines(-0.25, 0.25, 0.1)
COARSE = Scan((0.05,), (30, 45, 60, 90), (0, 40, -40), *GRID)


@dataclass(frozen=True, eq=False)
class Reach:
    """Shares by (height, pitch) of own half and centre strip (H,P), and of hidden and close
    cells."""

    own: Floats
    mid: Floats
    hidden: float
    close: float

    @property
    def score(self) -> float:
        """Mean reach at 30-60 degrees, less what the arm hides."""
        tilted = self.own[:, :3].mean() + 0.5 * self.mid[:, :3].mean() + 0.1 * self.own[:, 3].mean()
        return float(tilted / 1.6 - 0.15 * self.hidden - 0.15 * self.close)


def stood(
    arm: Arm, place: tuple[float, float, float], yaw: float, home: Iterable[float]
) -> Embodiment:
    """Two of an arm with bases at (-x, y, z) and (x, y, z), turned by `yaw` rad."""
    x, y, z = place
    turn, rest = quat_about((0, 0, 1), yaw), tuple(home)
    bases = {"left": pose((-x, y, z), turn), "right": pose((x, y, z), turn)}
    arms = {side: replace(arm, base=base, home=rest) for side, base in bases.items()}
    return Embodiment(arm.model, arms, HEAD_CAMERA)


def targets(height: float, pitch: float, azimuth: float, cells: Floats) -> Floats:
    """Tool poses (2N,7) over `cells` (N,2), for both rolls; `pitch` in degrees down, `azimuth`
    in degrees from +y.
    """
    p, a = np.radians(pitch), np.radians(azimuth)
    approach = np.array([np.sin(a) * np.cos(p), np.cos(a) * np.cos(p), -np.sin(p)])
    opening = np.array([-np.cos(a), np.sin(a), 0.0])
    at = [(x, y, TABLE_TOP + height) for x, y in cells]
    return np.array([frame(place, approach, s * opening) for s in (1, -1) for place in at])


def solve(
    robot: Embodiment, height: float, pitch: float, cells: Floats, scan: Scan
) -> tuple[Floats, Bools]:
    """Left arm joints (N,n) and success (N,) for cells (N,2)."""
    arm = robot.arms["left"]
    chain = chain_of(arm)
    free = CollisionWorld(robot).with_objects(margin=0.0).free("left", robot.arms["right"].home)
    q, done = np.zeros((len(cells), len(chain.home))), np.zeros(len(cells), bool)
    for azimuth in scan.azimuths:
        if not len(left := np.flatnonzero(~done)):
            break
        found, ok = ik_many(chain, targets(height, pitch, azimuth, cells[left]), [arm.home], IK)
        for rows, solved in zip(np.split(found, 2), np.split(ok, 2), strict=True):
            fresh = solved & ~done[left]
            fresh[fresh] = [free(row) for row in rows[fresh]]
            q[left[fresh]], done[left[fresh]] = rows[fresh], True
    return q, done


def measure(robot: Embodiment, scan: Scan) -> Reach:
    cells = np.array(list(product(scan.x, scan.y)), np.float64)
    own, mid = np.zeros((2, len(scan.heights), len(scan.pitches)))
    blocked = list[tuple[bool, bool]]()
    for i, j in np.ndindex(own.shape):
        q, ok = solve(robot, scan.heights[i], scan.pitches[j], cells, scan)
        own[i, j], mid[i, j] = (
            ok[cells[:, 0] < 0.001].mean(),
            ok[np.abs(cells[:, 0]) < 0.101].mean(),
        )
        for k in np.flatnonzero(ok)[::8] if scan.pitches[j] < 90 else ():
            point = np.array([*cells[k], TABLE_TOP + scan.heights[i]])
            blocked.append(_blocks_view(robot.arms["left"], q[k], point))
    hidden, close = np.mean(blocked or [(False, False)], axis=0).tolist()
    return Reach(own, mid, hidden, close)


def _blocks_view(arm: Arm, q: Floats, point: Floats) -> tuple[bool, bool]:
    """Whether links hide `point` (3,) from the head camera, or come near."""
    poses = arm_poses(arm, q)
    eye = HEAD_CAMERA[:3]
    ray = point - eye
    length = float(np.linalg.norm(ray))
    ray /= length
    covers = near = False
    for link in arm.links:
        if link.name in (arm.hand, *arm.gripper.fingers):
            continue
        for piece in link.collision:
            corners = piece.support_points()
            half = np.sort(np.ptp(corners, axis=0) / 2)
            centre = corners.mean(0)
            axis = np.linalg.svd(corners - centre)[2][0]
            rod = centre + np.outer(np.linspace(-1, 1, 7) * half[-1], axis)
            offset = transform(poses[link.name], rod) - eye
            along = offset @ ray
            across = np.linalg.norm(offset - np.outer(along, ray), axis=1)
            covers |= bool(np.any((across < half[0]) & (along > 0) & (along < length)))
            near |= bool(np.any(np.linalg.norm(offset, axis=1) < half[0] + NEAR_CAMERA))
    return covers, near


def find_site(arm: Arm) -> Embodiment | None:
    """Two of an arm at rest, at the place of PLACES that reaches most of the table, or None."""
    chain = chain_of(replace(arm, base=pose()))
    q = np.random.default_rng(0).uniform(chain.lower, chain.upper, (SAMPLES, len(chain.home)))
    tools = fk_batch(chain, q)
    yaw = np.pi / 2 - _forward(tools)
    ranked = sorted(PLACES, key=lambda place: -_sample_reach(tools, place, yaw))
    best: tuple[float, Embodiment] | None = None
    for place in ranked[:TRIED]:
        robot = stood(arm, place, yaw, (chain.lower + chain.upper) / 2)
        homes = _homes(robot, q, tools)
        if homes is None:
            continue
        arms = {s: replace(a, home=tuple(homes[s].tolist())) for s, a in robot.arms.items()}
        robot = replace(robot, arms=arms)
        score = (
            measure(robot, COARSE).score
            if len(chain.home) >= 6
            else _sample_reach(tools, place, yaw)
        )
        if best is None or score > best[0]:
            best = score, robot
    return None if best is None else best[1]


def _forward(tools: Floats) -> float:
    x, y = tools[:, :2].mean(0).tolist()
    if np.hypot(x, y) < 0.1 * np.linalg.norm(tools[:, :2], axis=1).mean():
        return 0.0
    return float(np.round(np.arctan2(y, x) / (np.pi / 2)) * np.pi / 2)


def _sample_reach(tools: Floats, place: tuple[float, float, float], yaw: float) -> float:
    """Share of cells above which a sampled tool points down."""
    at = compose(pose((-place[0], *place[1:]), quat_about((0, 0, 1), yaw)), tools)
    down = quat_rotate(at[:, 3:], [1.0, 0, 0])[:, 2] < -0.5
    low = (at[:, 2] > TABLE_TOP + 0.01) & (at[:, 2] < TABLE_TOP + 0.2)
    seen = at[down & low][:, :2]
    cells = np.floor((seen - (-0.45, -0.3)) / 0.1).astype(int)
    inside = ((cells >= 0) & (cells < (5, 6))).all(axis=1)
    return len(np.unique(cells[inside], axis=0)) / 30


def _homes(robot: Embodiment, q: Floats, tools: Floats) -> dict[str, Floats] | None:
    """A rest of each arm over its own side, pointing down, far from limits; or None."""
    left, right = (_free_homes(robot, side, q, tools) for side in SIDES)
    together = CollisionWorld(robot).with_objects(margin=ROOM)
    pairs = sorted(product(range(len(left)), range(len(right))), key=sum)
    apart = (k for k in pairs if together.first_blocked(left[k[0]], right[k[1]]) is None)
    return next(({"left": left[i], "right": right[k]} for i, k in apart), None)


def _free_homes(robot: Embodiment, side: str, q: Floats, tools: Floats) -> list[Floats]:
    arm = robot.arms[side]
    chain = chain_of(arm)
    x = float(arm.base[0])
    away = replace(arm, base=pose((FAR * np.sign(-x), 0, 0)))
    alone = replace(robot, arms={s: arm if s == side else away for s in SIDES})
    is_free = CollisionWorld(alone).with_objects(margin=0.0).free(side, chain.home)
    rows = _home_candidates(chain, x, q, compose(arm.base, tools))
    return sorted(filter(is_free, rows), key=lambda row: -float(limit_margin(chain, row)))


def _home_candidates(chain: Chain, x: float, q: Floats, tools: Floats) -> Floats:
    if len(chain.home) >= 6:
        poses = [
            targets(z - TABLE_TOP, pitch, 0.0, np.array([[x * 0.85 + dx, y]]))
            for dx, y, z, pitch in HOMES
        ]
        middle = [(chain.lower + chain.upper) / 2]
        found, ok = ik_many(chain, np.concatenate(poses), middle, HOME_IK)
        return found[ok]
    near = (np.abs(tools[:, :3] - (x, -0.2, 0.95)) < (0.12, 0.15, 0.12)).all(1)
    down = quat_rotate(tools[:, 3:], [1.0, 0, 0])[:, 2] < -0.5
    return q[near & down]


def overlaps(arm: Arm) -> dict[tuple[str, str], float]:
    """Share of random configurations in which unjoined links touch."""
    robot = stood(arm, (FAR, 0.0, 0.0), 0.0, arm.home)
    chain = chain_of(robot.arms["left"])
    rows = np.random.default_rng(1).uniform(chain.lower, chain.upper, (40, len(chain.home)))
    world = CollisionWorld(robot, ())
    scene = world.with_objects(margin=0.0)
    other = (chain.lower + chain.upper) / 2
    found, pairs = {}, scene.pairs
    for g, numbers in enumerate(pairs.bodies):
        a, b = (world.names[i] for i in numbers)
        if not (a.startswith("left_") and b.startswith("left_")):
            continue
        first, last = pairs.starts[g : g + 2]
        only = pairs._replace(
            bodies=pairs.bodies[g : g + 1],
            starts=np.array([0, last - first]),
            margins=pairs.margins[g : g + 1],
            a=pairs.a[first:last],
            b=pairs.b[first:last],
        )
        one = replace(scene, pairs=only)
        share = float(np.mean([one.first_blocked(row, other) is not None for row in rows]))
        if share:
            found[a.removeprefix("left_"), b.removeprefix("left_")] = share
    return found
