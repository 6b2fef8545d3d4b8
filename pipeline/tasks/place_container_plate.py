"""place_container_plate: set a bowl or cup down on a moving plate."""

from collections.abc import Iterator

from pipeline.expert.actor import Actor, Skill
from pipeline.expert.skills import ROUND, grasp, lift, open_, place, resting_poses, retreat
from pipeline.tasks.contract import TRACKING, Draw, Placement, Region, Task, register, side_of
from pipeline.tasks.outcome import Outcome
from pipeline.world.body import Body


@register
class PlaceContainerPlate(Task):
    """Grasp a bowl or cup and set it down on a plate that moves.

    Success: base of the container within 5 cm (per axis) and 3 cm (height) of the plate's centre, resting on it, both grippers
    measured open.
    """

    category = TRACKING
    target, manipulated = "plate", "container"

    def layout(self, draw: Draw) -> Iterator[Placement]:
        side = draw.side()
        container = Region(x=(side * 0.20, side * 0.28), y=(-0.10, 0.05), yaw=(-3.14, 3.14))
        yield Placement("container", draw.one_of("bowl", "cup"), container)
        yield Placement("plate", draw.one_of("plate"), Region(x=(side * 0.02, side * 0.08), y=(-0.15, -0.10)))

    def arms(self, bodies: dict[str, Body]) -> dict[str, str]:
        return {"arm": side_of(bodies["container"])}

    def meet(self, a: Actor) -> Iterator[Skill]:
        arm, centre = a.arms["arm"], a.frame("plate", "centre")
        goals = resting_poses(a.frames("container")["base"], centre, ROUND)
        yield grasp(arm, "container", goals=[list(goals)])
        yield lift(arm, 0.10)
        yield place(arm, "base", centre, yaws=ROUND)

    def finish(self, a: Actor) -> Iterator[Skill]:
        yield open_(a.arms["arm"])
        yield retreat(a.arms["arm"], 0.08)

    def success(self, o: Outcome, arms: dict[str, str]) -> bool:
        d = abs(o.offset(o.frame("container", "base"), o.frame("plate", "centre")))
        near = d[0] < 0.05 and d[1] < 0.05 and d[2] < 0.03
        return bool(near) and o.rests_on("container", "plate") and o.grippers_open()
