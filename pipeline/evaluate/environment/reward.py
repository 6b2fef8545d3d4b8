"""The dense reward, by potential-based shaping (Ng, Harada, Russell 1999, ICML): an optimal
policy stays optimal with the same `discount`."""

from typing import NamedTuple

import numpy as np

from pipeline.data.errors import DominoError
from pipeline.evaluate.scenes.trial import SUCCESS, Trial
from pipeline.tasks.contract import TRACKING

NEARNESS = 3.0  # 1/m; a distance d is worth 1 - tanh(3 d): 10 cm are worth 0.71

LIFT = 0.05  # m


class RewardError(DominoError, ValueError): ...


class TaskProgress(NamedTuple):
    """Each number is in 0-1; their mean is the potential."""

    approach: float
    hold: float
    lift: float
    place: float

    @property
    def potential(self) -> float:
        return sum(self) / len(self)


NOTHING = TaskProgress(0.0, 0.0, 0.0, 0.0)


class Meter:
    """Measures the progress of a trial once a control period; `hold` and `lift` are the best so
    far.

    - approach: nearness of the nearest acting tool to the handled body; 1 once it was held

    - hold: 1 once both fingers of an acting arm touched it (one finger if the target is pressed)

    - lift: its greatest rise over LIFT

    - place: from the first touch on, the share of success conditions that hold; if something is
    brought to another body, the mean of that and their nearness"""

    def __init__(self, trial: Trial) -> None:
        scene = trial.scene
        task, bodies = scene.task, scene.bodies.items()
        loose = [name for name, b in bodies if not b.inside and name not in scene.clutter]
        self._trial, self._handled = trial, task.manipulated
        self._sides = sorted(set(scene.arms.values()))
        self._pressed = task.category == TRACKING and task.manipulated == task.target
        others = [task.target, *loose] if task.category == TRACKING else loose
        self._goal = next((name for name in others if name != task.manipulated), "")
        self._held = False

    def measure(self) -> TaskProgress:
        trial = self._trial
        simulation, outcome = trial.simulation, trial.scene.outcome(trial.log())
        at = simulation.pose(self._handled)[:3]
        touch = outcome.touched if self._pressed else outcome.holds
        self._held = self._held or any(touch(side, self._handled) for side in self._sides)
        nearest = min(float(np.linalg.norm(simulation.tcp(side)[:3] - at)) for side in self._sides)
        rise = 0.0 if self._pressed else outcome.highest_rise(self._handled)
        lift, place = min(1.0, max(0.0, rise / LIFT)), 0.0
        if simulation.touched_by:
            conditions = trial.conditions()
            place = sum(conditions.values()) / len(conditions)
            if self._goal:
                apart = float(np.linalg.norm(simulation.pose(self._goal)[:2] - at[:2]))
                place = (place + near(apart)) / 2
        return TaskProgress(1.0 if self._held else near(nearest), float(self._held), lift, place)


class Shaped:
    """The dense reward of one episode, from the potential of its first state on."""

    def __init__(self, discount: float, potential: float) -> None:
        self._discount, self._before = discount, potential

    def reward(self, potential: float, ending: str) -> float:
        """Every ending has the potential 0."""
        after = 0.0 if ending else potential
        before, self._before = self._before, after
        return float(ending == SUCCESS) + self._discount * after - before


def near(distance: float) -> float:
    """The worth of a distance (m), 1 at none and towards 0 far away."""
    return 1.0 - float(np.tanh(NEARNESS * distance))


def check_discount(discount: float) -> float:
    """The discount. Raises RewardError for one outside 0-1."""
    if not 0 < discount <= 1:
        raise RewardError(f"discount {discount!r}: give a number above 0 and at most 1")
    return discount
