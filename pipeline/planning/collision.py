"""What a plan keeps clear of, the `PlanningScene`, and collision checking: a `CollisionWorld` per
embodiment, a `CollisionScene` per plan.

Names: `left_link3`, `table`, `furniture`, the objects; groups: `left_fingers`, `left_hand`, `left`.
Neighbouring links and the reviewed `allowed_overlap` are not checked.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pipeline.data.names import SIDES
from pipeline.poses import IDENTITY, Bools, Floats, Ints, Pose, compose
from pipeline.world.physics.body import TABLE_COLLISION
from pipeline.world.robots.contract import Arm, Embodiment, jaw_positions
from pipeline.world.shapes import Collider

from .budgets import MARGINS
from .collision_kernels import first_contact
from .collision_pieces import Pieces, frames_of, groups_of, pieces_of
from .path import IsFree

Jaws = tuple[float, float]
OPEN: Jaws = (1.0, 1.0)


Sees = Callable[[Floats], Bools]  # which world points (N,3) are in an image


def everywhere(points: Floats) -> Bools:
    return np.ones(len(points), bool)


class Obstacle(NamedTuple):
    """A body that stands still: collision pieces in the body frame, world pose (7,)."""

    pieces: tuple[Collider, ...]
    pose: Pose


class Carried(NamedTuple):
    """A body in a hand: pieces in the body frame, pose (7,) in the tcp frame."""

    side: str
    pieces: tuple[Collider, ...]
    pose: Pose


@dataclass(frozen=True, eq=False)
class ArmState:
    """Joints q (n,) and gripper, 0 closed to 1 open. The other arm avoids `expected` (n,)."""

    q: Floats
    gripper: float
    expected: Floats


@dataclass(frozen=True, eq=False)
class PlanningScene:
    """Both arms by side, the bodies that stand still and those that are carried, by name;
    read-only. `sees` tells which world points (N,3) the head camera has in its image."""

    arms: Mapping[str, ArmState]
    obstacles: Mapping[str, Obstacle]
    carried: Mapping[str, Carried]
    sees: Sees = everywhere

    def __post_init__(self) -> None:
        for name in ("arms", "obstacles", "carried"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    @property
    def jaws(self) -> tuple[float, float]:
        """Left and right; 1 for an arm that the robot does not have."""
        left, right = (self.arms[side].gripper if side in self.arms else 1.0 for side in SIDES)
        return left, right

    def holding(self, name: str, carried: Carried) -> "PlanningScene":
        """Body `name` is carried, and no longer an obstacle."""
        others = {n: obstacle for n, obstacle in self.obstacles.items() if n != name}
        return replace(self, obstacles=others, carried={**self.carried, name: carried})

    def commanding(self, side: str, q: ArrayLike) -> "PlanningScene":
        state = replace(self.arms[side], q=np.array(q, float), expected=np.array(q, float))
        return replace(self, arms={**self.arms, side: state})

    def expecting(self, side: str, q: ArrayLike) -> "PlanningScene":
        state = replace(self.arms[side], expected=np.array(q, float))
        return replace(self, arms={**self.arms, side: state})


class CollisionWorld:
    """Robot, table and furniture. `hands` maps a side to (frame index, tcp pose in it); `pairs`
    (M,2) are piece pairs to check; `sides` and `handlike` are (links,).
    """

    def __init__(
        self, embodiment: Embodiment, table: Sequence[Collider] = (TABLE_COLLISION,)
    ) -> None:
        self.arms: dict[str, Arm] = embodiment.arms
        self.frames, placed = frames_of([(f"{side}_", arm) for side, arm in self.arms.items()])
        still = {"table": table, "furniture": embodiment.furniture_collision}
        self.names: tuple[str, ...] = (*placed, *still)
        self.links = len(placed)
        colliders = {
            f"{side}_{link.name}": link.collision
            for side, arm in self.arms.items()
            for link in arm.links
        }
        entries = [
            (self.names.index(n), frame, c, at)
            for n, (frame, at) in placed.items()
            for c in colliders.get(n, ())
        ]
        entries += [
            (self.names.index(n), 0, c, IDENTITY) for n, pieces in still.items() for c in pieces
        ]
        self.pieces: Pieces = pieces_of(entries)
        self.groups, self.hands = groups_of(self.arms, self.frames, placed)
        sides = {name: k for k, s in enumerate(self.arms) for name in self.groups[s]}
        hands = {name for side in self.arms for name in self.groups[f"{side}_hand"]}
        self.sides = np.array([sides[name] for name in placed])
        self.handlike = np.array([name in hands for name in placed])
        self.pairs: Ints = self._fixed_pairs()

    def _fixed_pairs(self) -> Ints:
        overlap = {
            frozenset((f"{s}_{a}", f"{s}_{b}"))
            for s, arm in self.arms.items()
            for a, b in arm.allowed_overlap
        }
        for fingers in (self.groups[f"{s}_fingers"] for s in self.arms):
            overlap |= {frozenset((a, b)) for a in fingers for b in fingers}
        parent = {f + 1: int(p) for f, p in enumerate(self.frames.parent)}
        frame, owner = self.pieces.frame.tolist(), [self.names[i] for i in self.pieces.owner]
        arms, pairs = [self.groups[s] for s in self.arms], list[tuple[int, int]]()
        for a, b in combinations(range(len(frame)), 2):
            if frame[a] == frame[b] or frozenset((owner[a], owner[b])) in overlap:
                continue
            chained = parent.get(frame[a]) == frame[b] or parent.get(frame[b]) == frame[a]
            if not (chained and any(owner[a] in arm and owner[b] in arm for arm in arms)):
                pairs.append((a, b))
        return np.array(pairs, np.int64).reshape(-1, 2)

    def with_objects(
        self,
        objects: Mapping[str, Obstacle] | None = None,
        carried: Mapping[str, Carried] | None = None,
        *,
        ignore: Iterable[tuple[str, str]] = (),
        margin: float = MARGINS.obstacles,
        hands: float = MARGINS.arms,
    ) -> "CollisionScene":
        """The scene with still `objects` and `carried` ones.

        Pairs of names in `ignore` may touch. `margin` and `hands` are in m. Raises ValueError for
        an unknown or taken name.
        """
        objects, carried = objects or {}, carried or {}
        names = (*self.names, *objects, *carried)
        if len({*names}) != len(names) or self.groups.keys() & {*objects, *carried}:
            raise ValueError(f"object names must be new and different: {[*objects, *carried]}")
        entries: list[tuple[int, int, Collider, Pose]] = []
        for owner, (colliders, at) in enumerate(objects.values(), len(self.names)):
            entries += [(owner, 0, c, np.asarray(at, float)) for c in colliders]
        first = len(self.names) + len(objects)
        for owner, (side, colliders, at) in enumerate(carried.values(), first):
            frame, tcp = self.hands[side]
            entries += [(owner, frame, c, compose(tcp, at)) for c in colliders]
        pieces = self.pieces.joined(pieces_of(entries))
        every = np.arange(len(pieces.owner))
        new = every[len(self.pieces.owner) :]
        b, a = (m.ravel() for m in np.meshgrid(new, every, indexing="ij"))
        owner_a, owner_b = pieces.owner[a], pieces.owner[b]
        moving_link = (owner_a < self.links) & (pieces.frame[a] > 0)
        checked = (owner_a < owner_b) & np.where(owner_b < first, moving_link, True)
        pairs = np.concatenate([self.pairs, np.stack([a[checked], b[checked]], axis=1)])
        allowed = np.ones((len(names), len(names)), bool)
        in_hand = ((name, f"{side}_hand") for name, (side, _, _) in carried.items())
        for one, other in (*ignore, *in_hand):
            i, j = self._indices(names, one), self._indices(names, other)
            allowed[np.ix_(i, j)] = allowed[np.ix_(j, i)] = False
        owners = pieces.owner[pairs]
        pairs = pairs[allowed[owners[:, 0], owners[:, 1]]]
        return CollisionScene(self, pieces, self._grouped(pieces, pairs, len(names), margin, hands))

    def between_arms(
        self, carried: Mapping[str, Carried], hands: float = MARGINS.arms
    ) -> "CollisionScene":
        """Only the arms count; what one carries may touch the other hand."""
        sides = {name: side for name, (side, _, _) in carried.items()}
        ignore = [*product((*self.arms, *sides), ("table", "furniture"))]
        ignore += [(side, side) for side in self.arms]
        hands_of = [f"{side}_hand" for side in self.arms]
        for name, own in sides.items():
            ignore += [(name, other) for other in (own, *hands_of, *sides)]
        return self.with_objects({}, carried, ignore=ignore, margin=MARGINS.contact, hands=hands)

    def _grouped(
        self, pieces: Pieces, pairs: Ints, owners: int, margin: float, hands: float
    ) -> "PiecePairs":
        frame, balls = np.zeros(owners, np.int64), np.zeros((owners, 4))
        frame[pieces.owner] = pieces.frame
        lower, upper = np.full((owners, 3), np.inf), np.full((owners, 3), -np.inf)
        centre, extent = pieces.local[:, 9:], (pieces.bound + pieces.radius)[:, None]
        np.minimum.at(lower, pieces.owner, centre - extent)
        np.maximum.at(upper, pieces.owner, centre + extent)
        middle = 0.5 * (lower[pieces.owner] + upper[pieces.owner])
        balls[pieces.owner, :3] = middle
        reach = np.linalg.norm(centre - middle, axis=1) + extent[:, 0]
        np.maximum.at(balls[:, 3], pieces.owner, reach)
        key = pieces.owner[pairs] @ [owners, 1]
        order = np.argsort(key, kind="stable")
        _, starts = np.unique(key[order], return_index=True)
        pairs = pairs[order]
        bodies = pieces.owner[pairs[starts]]
        gaps = np.full(len(bodies), margin)
        links = (bodies < self.links).all(axis=1)
        a, b = bodies[links].T
        apart = np.where(self.handlike[a] & self.handlike[b], hands, MARGINS.arms)
        gaps[links] = np.where(self.sides[a] == self.sides[b], 0.0, apart)
        columns = (np.ascontiguousarray(c) for c in pairs.T)
        return PiecePairs(frame, balls, bodies, np.append(starts, len(pairs)), gaps, *columns)

    def _indices(self, names: tuple[str, ...], name: str) -> list[int]:
        if name not in names and name not in self.groups:
            raise ValueError(f"nothing in the scene is called {name!r}")
        members = self.groups.get(name, (name,))
        return [i for i, n in enumerate(names) if n in members]


class PiecePairs(NamedTuple):
    """Piece pairs (M,2) sorted by owner pairs (G), whose piece pairs are starts[g]:starts[g+1];
    margins in m.
    """

    frame: Ints
    balls: Floats
    bodies: Ints
    starts: Ints
    margins: Floats
    a: Ints
    b: Ints


@dataclass(frozen=True, eq=False)
class CollisionScene:
    """Jaws: 0 closed, 1 open."""

    world: CollisionWorld
    pieces: Pieces
    pairs: PiecePairs

    def first_blocked(self, q_left: ArrayLike, q_right: ArrayLike, jaws: Jaws = OPEN) -> int | None:
        """First colliding row of joint rows (K,n), or None. A single (n,) stands still."""
        columns: list[Floats] = []
        for side, q, value in zip(SIDES, (q_left, q_right), jaws, strict=True):
            if side in self.world.arms:
                jaw = jaw_positions(self.world.arms[side].gripper, value)
                columns += [np.asarray(q, float), jaw]
        count = max(c.size // c.shape[-1] for c in columns)
        rows = np.hstack([np.broadcast_to(c, (count, c.shape[-1])) for c in columns])
        frames = self.world.frames
        chain = frames.parent, frames.origin, frames.prismatic
        row, _ = first_contact(*chain, tuple(self.pieces), tuple(self.pairs), rows)
        return None if row < 0 else row

    def free(self, side: str, other: ArrayLike, jaws: Jaws = OPEN) -> IsFree:
        """Checker of one arm while the other stands at `other` (n,): True when all of joints (n,)
        or rows (K,n) are free."""
        if side == "left":
            return lambda q: self.first_blocked(q, other, jaws) is None
        return lambda q: self.first_blocked(other, q, jaws) is None
