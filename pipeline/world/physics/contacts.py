"""What touches in a scene, and how hard the robot may press. SAPIEN lists contacts in no fixed
order."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from sapien.physx import PhysxRigidDynamicComponent

from pipeline.data.clock import PHYSICS_HZ
from pipeline.poses import Floats
from pipeline.world.robots.contract import Embodiment

TOUCH_IMPULSE = 1e-7
"""N s; SAPIEN lists near pairs with zero impulse before they touch."""

Pair = tuple[int, int, float, Floats, int]
"""Indices a < b of two bodies, impulse in N s, mean contact point (3,), number of points."""


Push = tuple[list[float], Any]
"""Impulse (3,) in N s and SAPIEN's point."""


_NONE = bytes(12)  # of an impulse; most points have none, and comparing takes half of listing


class Contacts:
    """The contacts of one step, each read once: the binding costs more than their use. `index` has
    the components whose touching counts."""

    def __init__(self, found: Sequence[Any], index: Mapping[Any, int], table: Any) -> None:
        self._found, self._index, self._pushing = found, index, dict[int, list[Push]]()
        self.pairs: list[tuple[Any, Any]] = [tuple(contact.bodies) for contact in found]
        # noted if all that touch are the table and bodies that sleep
        bodies = {body for pair in self.pairs for body in pair} - {table}
        asleep = all(
            isinstance(body, PhysxRigidDynamicComponent) and body.is_sleeping for body in bodies
        )
        self._sleepers: set[Any] | None = bodies if asleep else None

    def still_hold(self, found: Sequence[Any]) -> bool:
        """Whether the contacts `found` later are these: touches of a body do not change in its
        sleep, and nothing can touch it without waking it."""
        return (
            self._sleepers is not None
            and len(found) == len(self.pairs)
            and all(body.is_sleeping for body in self._sleepers)
        )

    def pushing(self, k: int) -> list[Push]:
        """The points of contact `k` with an impulse."""
        known = self._pushing.get(k)
        if known is None:
            points = self._found[k].points
            known = [
                (push, p)
                for p in points
                if (impulse := p.impulse).tobytes() != _NONE and any(push := impulse.tolist())
            ]
            self._pushing[k] = known
        return known

    def pushes(self, k: int) -> bool:
        """Whether a contact has an impulse above the least."""
        return any(x * x + y * y + z * z > TOUCH_IMPULSE**2 for (x, y, z), _ in self.pushing(k))

    def strength(self, k: int) -> float:
        """The impulse of a contact, N s."""
        pushing = self.pushing(k)
        if not pushing:
            return 0.0
        return math.hypot(*map(math.fsum, zip(*(push for push, _ in pushing), strict=True)))

    def points_on(self, body: Any, side_of: Mapping[Any, str]) -> dict[str, Floats]:
        """Points (N,3) at which components push `body`, by `side_of`, in a fixed order."""
        found: dict[str, list[list[float]]] = {}
        for k, (a, b) in enumerate(self.pairs):
            if a is not body and b is not body:
                continue
            side = side_of.get(b if a is body else a)
            if side is not None and self.pushes(k):
                points = [p.position.tolist() for _, p in self.pushing(k)]
                found.setdefault(side, []).extend(points)
        return {side: np.array(sorted(points)) for side, points in sorted(found.items())}

    @cached_property
    def touching(self) -> list[Pair]:
        """Pairs of the index that push each other, sorted."""
        # The strongest of the pieces of a pair is its contact. Numpy takes five times as long.
        found: dict[tuple[int, int], tuple[float, list[list[Push]]]] = {}
        for k, (first, second) in enumerate(self.pairs):
            a, b = self._index.get(first), self._index.get(second)
            if a is None or b is None or not self.pushing(k):
                continue
            strength, pair = self.strength(k), (a, b) if a < b else (b, a)
            most, pieces = found.get(pair, (TOUCH_IMPULSE, []))
            if strength > most:
                found[pair] = strength, [self.pushing(k)]
            elif strength == most and pieces:
                pieces.append(self.pushing(k))
        out = list[Pair]()
        for pair, (strength, pieces) in sorted(found.items(), key=lambda item: item[0]):
            at = [[p.position.tolist() for _, p in pushing] for pushing in pieces]
            point, n = max(
                (tuple(math.fsum(axis) / len(of) for axis in zip(*of, strict=True)), len(of))
                for of in at
            )
            out.append((*pair, strength, np.array(point), n))
        return out


@dataclass(frozen=True)
class Forces:
    """The largest force (N) of one contact: impulse over step time.

    Fingers may touch bodies, held bodies anything. Planning avoids all other contacts; these limits
    bound what drives and physics add.
    """

    arms: float = 10.0
    """A link of one arm on a link of the other."""

    hands: float = 30.0
    """A link of one hand on a link of the other, as in a hand-over."""

    palm: float = 50.0
    """A link that is no finger on a body, also on one in its own jaws, or on the table."""

    table: float = 50.0
    """A finger on the table."""

    finger: float = 100.0
    """A finger on a body: jaws close with up to 60 N."""


FORCES = Forces()


class Overload(NamedTuple):
    """A contact stronger than allowed: both parts and the force in N."""

    one: str
    other: str
    force: float


class ContactKinds:
    """Which field of `Forces` bounds a contact, by name."""

    def __init__(self, embodiment: Embodiment) -> None:
        arms = embodiment.arms.items()
        self._side = {f"{side}_{link.name}": side for side, arm in arms for link in arm.links}
        self._fingers = {f"{side}_{name}" for side, arm in arms for name in arm.gripper.fingers}
        self._hands = self._fingers | {f"{side}_{arm.hand}" for side, arm in arms}

    def of(self, one: str, other: str) -> str:
        """The field's name; "" for unbounded force."""
        link, body = (one, other) if one in self._side else (other, one)
        if link not in self._side:
            return ""
        if body in self._side:
            near = {one, other} <= self._hands
            return "" if self._side[one] == self._side[other] else "hands" if near else "arms"
        if link not in self._fingers:
            return "palm"
        return "table" if body == "table" else "finger"


class ForceWatch:
    """Finds contacts stronger than allowed, by components' names."""

    def __init__(
        self, embodiment: Embodiment, names: Mapping[Any, str], allowed: Forces = FORCES
    ) -> None:
        kinds, most = ContactKinds(embodiment), asdict(allowed)
        found = {(a, b): kinds.of(names[a], names[b]) for a in names for b in names if a is not b}
        self._names = names
        self._limits = {pair: most[kind] / PHYSICS_HZ for pair, kind in found.items() if kind}

    def overloads(self, contacts: Contacts, rigid: str = "") -> list[Overload]:
        """Contacts over their limits, sorted. The part `rigid` is left out: a target touched in
        this step is still kinematic."""
        found = list[Overload]()
        for k, pair in enumerate(contacts.pairs):
            limit = self._limits.get(pair)
            if limit is not None and (impulse := contacts.strength(k)) > limit:
                one, other = sorted(self._names[part] for part in pair)
                if rigid not in (one, other):
                    found.append(Overload(one, other, impulse * PHYSICS_HZ))
        return sorted(found)
