"""What the tasks of choice share: colours that are told apart by name, and what is left alone."""

from collections.abc import Iterable

import numpy as np

from pipeline.expert.skills import ROUND, carry, grasp, home, lift, open_, upright_goal
from pipeline.poses import Floats, transform
from pipeline.tasks.contract import Actor, Body, Outcome, Skills

COLOURS = ("red", "blue", "yellow", "green", "orange", "purple", "white", "black")


def look_of(body: Body, parameter: str = "colour") -> str:
    """A parameter of a body's instance, in words."""
    return str(vars(body.instance)[parameter])


def others_left(o: Outcome, names: Iterable[str]) -> dict[str, bool]:
    """The condition that no hand ever held one of the bodies `names`."""
    return {"others_left": not any(o.took(name) for name in names)}


def row(middle: tuple[float, float], heading: float, gap: float, count: int) -> Floats:
    """Places (count, 2) on a line through `middle`, `gap` m apart."""
    along = np.array([np.cos(heading), np.sin(heading)])
    return np.add(middle, gap * (np.arange(count) - (count - 1) / 2)[:, None] * along)


def above(a: Actor, name: str, up: float, aside: float = 0.0) -> Floats:
    """Upright poses (N,7) `up` m over the floor of a hollow body, up to `aside` m off its middle
    along its x axis."""
    spots = [transform(a.frame(name, "inside"), (x, 0.0, up)) for x in (aside, 0.8 * aside)]
    return np.stack([upright_goal(spot, yaw) for spot in spots for yaw in ROUND])


def drop_in(a: Actor, side: str, basket: str, aside: float = 0.0) -> Skills:
    """Lift what the hand holds, let it fall into a basket, and draw the hand back home."""
    yield lift(side, 0.10)
    yield carry(side, above(a, basket, 0.08, aside))
    yield open_(side)
    yield home(side)


def take(a: Actor, side: str, name: str, basket: str, aside: float = 0.0):
    """The grasp of a body with which it can be held over a basket."""
    return grasp(side, name, goals=[above(a, basket, 0.08, aside)])
