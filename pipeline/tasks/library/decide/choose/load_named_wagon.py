import numpy as np

from pipeline.expert.scripts import let_go
from pipeline.expert.skills import ROUND, grasp, lift, place, resting_poses
from pipeline.motion.wrapped import CARRIED
from pipeline.tasks.contract import (
    Actor,
    Bodies,
    Body,
    Draw,
    Limit,
    Outcome,
    Placement,
    Region,
    Skills,
    Task,
    by_name,
    register,
)

from .named import COLOURS, look_of

RADIUS = 0.105  # m of the train's circle


@register
class LoadNamedWagon(Task):
    """Grasp a can or a bottle and set it down in the wagon of the colour asked for, one of three
    that go round.

    Success: it lies in that wagon, released."""

    category = "tracking"
    step_limit = 500
    target, manipulated = "wagon", "cargo"
    motion, movers = "turntable", {"second": CARRIED, "third": CARRIED}
    limits = by_name(lift=Limit(0.03))
    own_conditions = ()

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        x, y = side * draw.uniform(-0.02, 0.04), draw.uniform(-0.08, 0.0)
        first = draw.uniform(-np.pi, np.pi)
        colours = draw.several(COLOURS, 3)
        for i, (name, colour) in enumerate(zip(("wagon", *self.movers), colours, strict=True)):
            angle = first + i * 2 * np.pi / 3
            at = x + RADIUS * np.cos(angle), y + RADIUS * np.sin(angle)
            yaw = angle + np.pi / 2
            spot = Region(x=(at[0], at[0]), y=(at[1], at[1]), yaw=(yaw, yaw))
            yield Placement(name, draw.one_of("wagon", colour=colour), spot, gap=0.004)
        x, y = (side * 0.23, side * 0.32), (-0.14, 0.06)
        yield draw.place("cargo", "can", "pill_bottle", x=x, y=y, shown=True)

    def choices(self, bodies: dict[str, Body]) -> dict[str, str]:
        return {"choice": look_of(bodies["wagon"])}

    def meet(self, a: Actor) -> Skills:
        arm, inside = a.arms["arm"], a.frame("wagon", "inside")
        yield grasp(arm, "cargo", goals=[resting_poses(a.frames("cargo")["base"], inside)])
        yield lift(arm, 0.10)
        yield place(arm, "base", inside, yaws=ROUND, opening=0.02)

    def finish(self, a: Actor) -> Skills:
        return let_go(a.arms["arm"])

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        return {
            "in_wagon": o.lies_in("cargo", "wagon"),
            "wagon_upright": o.upright("wagon"),
            "released": not o.handled("cargo"),
            "grippers_open": o.grippers_open(),
        }
