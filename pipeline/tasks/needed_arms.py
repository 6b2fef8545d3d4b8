"""Which arms a task needs: the layouts of a robot with one arm are those that leave the work to
this arm."""

from collections.abc import Collection
from functools import cache

import numpy as np

from pipeline.data.names import SIDES
from pipeline.tasks.contract import Draw, Task
from pipeline.tasks.layout import TRIALS, lay_out
from pipeline.world.physics.body import Body


def suits(task: Task, bodies: dict[str, Body], sides: Collection[str]) -> bool:
    """Whether a layout asks for no other arms than those of `sides`."""
    return set(task.arms(bodies).values()) <= set(sides)


@cache
def _draw_arms(task: Task) -> frozenset[frozenset[str]]:
    """The sets of arms that TRIALS layouts of a task, drawn from fixed seeds, ask for."""
    draws = (
        Draw(np.random.default_rng([seed, 0]), np.random.default_rng([seed, 1]))
        for seed in range(TRIALS)
    )
    return frozenset(frozenset(task.arms(lay_out(task, draw)).values()) for draw in draws)


def can_do(task: Task, sides: Collection[str]) -> bool:
    """Whether a robot with the arms of `sides` can be given the task."""
    return set(sides) >= set(SIDES) or any(asked <= set(sides) for asked in _draw_arms(task))
