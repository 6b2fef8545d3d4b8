"""Which contacts a demonstration may have, and how strong they may be."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.data.clock import PHYSICS_HZ
from pipeline.world.physics.contacts import FORCES, ContactKinds, Contacts, ForceWatch, Overload
from pipeline.world.robots import get_embodiment

ROBOT = get_embodiment("aloha")
LEFT, RIGHT = (ROBOT.arms[side] for side in ("left", "right"))
FINGER, OTHER = (
    f"{side}_{arm.gripper.fingers[0]}" for side, arm in (("left", LEFT), ("right", RIGHT))
)
HAND, LINK = f"right_{RIGHT.hand}", f"right_{RIGHT.links[2].name}"


@pytest.mark.parametrize(
    ("one", "other", "kind"),
    [
        (f"left_{LEFT.links[2].name}", LINK, "arms"),
        (FINGER, OTHER, "hands"),
        (FINGER, HAND, "hands"),
        (FINGER, LINK, "arms"),
        (HAND, LINK, ""),
        (HAND, "can", "palm"),
        (LINK, "table", "palm"),
        (FINGER, "table", "table"),
        (FINGER, "can", "finger"),
        ("can", "table", ""),
    ],
)
def test_every_contact_has_its_limit(one: str, other: str, kind: str):
    kinds = ContactKinds(ROBOT)
    assert kinds.of(one, other) == kinds.of(other, one) == kind


def contact(one: str, other: str, *forces: tuple[float, float, float]) -> SimpleNamespace:
    """A contact of one physics step with these forces (N) at its points."""
    points = [SimpleNamespace(impulse=np.array(force) / PHYSICS_HZ) for force in forces]
    return SimpleNamespace(bodies=[one, other], points=points)


def overloads(*contacts: SimpleNamespace, rigid: str = "") -> list[Overload]:
    """What a watch finds in one step."""
    names = {name: name for name in (FINGER, OTHER, HAND, LINK, "can", "table")}
    return ForceWatch(ROBOT, names).overloads(Contacts(contacts, {}, "table"), rigid)


def test_forces_of_a_contact_add_up_as_vectors():
    half = FORCES.table / 2
    assert not overloads(contact(FINGER, "table", (0, 0, half), (0, 0, 0.9 * half)))
    [found] = overloads(contact(FINGER, "table", (0, 0, half), (0, 0, 1.2 * half)))
    assert (found.one, found.other) == (FINGER, "table")
    assert found.force == pytest.approx(2.2 * half)
    # forces in different directions
    across = contact("table", FINGER, (0.8 * FORCES.table, 0, 0), (0, 0, 0.8 * FORCES.table))
    assert overloads(across)[0].force == pytest.approx(0.8 * 2**0.5 * FORCES.table)


def test_each_contact_is_judged_by_its_own_limit():
    grip = contact(FINGER, "can", (0.9 * FORCES.finger, 0, 0))
    palm = contact(HAND, "can", (0, 1.1 * FORCES.palm, 0))
    [found] = overloads(grip, palm)
    assert {found.one, found.other} == {HAND, "can"}
    assert len(overloads(contact(FINGER, "can", (1.1 * FORCES.finger, 0, 0)), palm)) == 2


def test_a_contact_is_read_once_for_all_that_ask() -> None:
    reads = list[str]()

    class Counted(SimpleNamespace):
        @property
        def points(self) -> list[SimpleNamespace]:
            reads.append("")
            push = np.array([0, 0, 2 * FORCES.finger], np.float32) / np.float32(PHYSICS_HZ)
            at = [0.1, 0.2, 0.7], [0.3, 0.2, 0.7], [0.9, 0.9, 0.9]
            return [
                SimpleNamespace(impulse=impulse, position=np.array(position))
                for impulse, position in zip((push, push, 0 * push), at, strict=True)
            ]

    contacts = Contacts([Counted(bodies=["can", FINGER])], {"can": 4, FINGER: 1}, "table")
    [(a, b, impulse, point, count)] = contacts.touching
    assert (a, b, count) == (1, 4, 2) and impulse == pytest.approx(4 * FORCES.finger / PHYSICS_HZ)
    assert point == pytest.approx([0.2, 0.2, 0.7])
    assert contacts.points_on("can", {FINGER: "left"})["left"].shape == (2, 3)
    names = {"can": "can", FINGER: FINGER}
    assert ForceWatch(ROBOT, names).overloads(contacts) and len(reads) == 1


def test_a_target_that_cannot_give_way_yet_is_left_out():
    hard = contact(HAND, "can", (0, 0, 10 * FORCES.palm))
    assert overloads(hard) and not overloads(hard, rigid="can")
