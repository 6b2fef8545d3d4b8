"""Labels for imitation: the reactive expert's own actions."""

import numpy as np

from pipeline.data.clock import PHYSICS_HZ
from pipeline.planning.kinematics import fk_batch
from pipeline.poses import Floats

from .actor import ReactiveActor
from .controller import ReactiveExpert
from .imagination import Script

EVERY = 4  # physics rows of the plan between two places of the hand
BEHIND, AHEAD = 0.5, 1.5  # s of the plan, from where the hand was, in which it is looked for
SAME = 0.001  # m by which places are as near as the nearest; the latest is taken
JAW = 0.1  # m that equal the whole travel of a gripper


class Adviser:
    """The expert's plan from what it has seen. `action` returns the command one control period
    after the place nearest to the hands, `off` m away. Raises PlanFailure.
    """

    def __init__(self, actor: ReactiveActor, script: Script, fps: int) -> None:
        self._actor, self._period = actor, PHYSICS_HZ // fps
        self.plan = actor.plan(script, rest=False, rounds=1)
        self._expert = ReactiveExpert(actor.planner, actor.simulation.command)
        self._expert.follow(self.plan)
        self._rows = np.arange(0, len(self.plan.commands), EVERY)
        self._places = [self._place(row) for row in self.plan.commands[self._rows]]
        self._row, self.off = 0.0, 0.0

    def action(self) -> Floats:
        """The expert's command (A,) for the next control period."""
        time, command = self._actor.simulation.time, self._actor.simulation.command
        self._row = self._nearest(time)
        seconds = self._period / PHYSICS_HZ
        later = min(self._row + self._period, len(self.plan.commands) - 1)
        goal = self._expert.command_at(later, self._actor.track.predict(time + seconds))
        reach = self._expert.limiter.speed * seconds
        return command + np.clip(goal - command, -reach, reach)

    def _nearest(self, time: float) -> float:
        moved = self._actor.track.predict(time)[:3] - self.plan.aim[:3]
        span = max(1.0, self.plan.near - self.plan.last)
        first, last = np.searchsorted(
            self._rows, [self._row - BEHIND * PHYSICS_HZ, self._row + AHEAD * PHYSICS_HZ]
        )
        x = np.clip((self._rows[first:last] - self.plan.last) / span, 0.0, 1.0)
        carried = (x * x * (3 - 2 * x))[:, None] * moved
        here, found = self._place(self._actor.simulation.command), np.zeros(last - first)
        for side, (tool, jaw) in here.items():
            places = [place[side] for place in self._places[first:last]]
            follows = carried if side in self.plan.sides else 0.0
            off = np.linalg.norm(np.array([at for at, _ in places]) + follows - tool, axis=1)
            jaws = JAW * (np.array([value for _, value in places]) - jaw)
            found = np.maximum(found, np.hypot(off, jaws))
        self.off = float(found.min())
        return float(self._rows[first:last][np.flatnonzero(found <= self.off + SAME)[-1]])

    def _place(self, command: Floats) -> dict[str, tuple[Floats, float]]:
        """Tools (3,) and grippers at a command (A,), by side."""
        planner = self._actor.planner
        split = planner.split(command)
        return {
            side: (fk_batch(planner.chains[side], q[None])[0, :3], float(value))
            for side, (q, value) in split.items()
        }
