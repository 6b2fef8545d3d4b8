from abc import abstractmethod
from typing import ClassVar

from pipeline.expert.budgets import GRASP, PLACE
from pipeline.expert.scripts import let_go
from pipeline.expert.skills import ROUND, grasp, lift, place, resting_poses
from pipeline.poses import Pose
from pipeline.tasks.contract import Actor, Skills, Task


class SetAside(Task):
    """The target is caught and set down with its base at `goal`, turned to any side. `standoff` is
    that of `grasp`, `above` that of `place`."""

    standoff: ClassVar[float] = GRASP.standoff
    above: ClassVar[float] = PLACE.above

    @abstractmethod
    def goal(self, a: Actor) -> Pose:
        """World pose (7,) of the base."""

    def meet(self, a: Actor) -> Skills:
        goals = [resting_poses(a.frames(self.target)["base"], self.goal(a))]
        yield grasp(a.arms["arm"], self.target, goals=goals, standoff=self.standoff)

    def finish(self, a: Actor) -> Skills:
        arm = a.arms["arm"]
        yield lift(arm, 0.10)
        yield place(arm, "base", self.goal(a), yaws=ROUND, above=self.above)
        yield from let_go(arm)
