"""Two single arms as one embodiment: the same model twice, or a mixed pair."""

from typing import Protocol

from pipeline.world.robots.contract import Arm, Embodiment
from pipeline.world.robots.notation import HEAD_CAMERA
from pipeline.world.robots.stands import Stand


class Model(Protocol):
    """What a robot's module offers for pairing."""

    def arm(self, side: str) -> Arm:
        """The arm at its `side` ("left" or "right") of the table."""
        ...

    def stand(self, side: str) -> Stand:
        """What stands under that arm, in the world frame: visuals and collision."""
        ...


def pair(name: str, left: Model, right: Model, aliases: tuple[str, ...] = ()) -> Embodiment:
    """Embodiment with the left arm of one model and the right arm of another, each at its own place and on its own stand."""
    stands = (left.stand("left"), right.stand("right"))
    return Embodiment(
        name,
        {"left": left.arm("left"), "right": right.arm("right")},
        HEAD_CAMERA,
        tuple(part for visual, _ in stands for part in visual),
        tuple(piece for _, solid in stands for piece in solid),
        aliases,
    )
