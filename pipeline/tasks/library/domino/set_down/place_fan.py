"""place_fan: stand a desk fan on a moving pad, facing the robot."""

from collections.abc import Iterator

import numpy as np

from pipeline.expert.actor import Actor, Skill
from pipeline.expert.grasping import lifted
from pipeline.expert.regrasping import place_or_regrasp, regrasp
from pipeline.expert.skills import grasp, lift, resting_poses
from pipeline.tasks.contract import Draw, Limit, Placement, Region, by_name, register
from pipeline.tasks.library.domino.set_down.set_down import SetDown


@register
class PlaceFan(SetDown):
    """Grasp a desk fan by its cage and stand it on a pad that moves, blowing towards the robot.

    Success: The base of the fan is within 4 cm (per axis) of the pad's centre, turned to the robot
    within 0.14 rad (0.05 per quaternion component). The fan rests on the pad, and both grippers are
    measured open. Tolerances are the original's. The pad is its static one (10 cm), not the dynamic
    one (14 cm). Regions are those of the original's dynamic version, with the pad on either side,
    but fan and pad stay apart (the original does not check). The fan is turned any way, as in its
    static version, not as in its dynamic one.
    """

    target, manipulated = "pad", "fan"
    limits = by_name(
        plane=Limit(0.04), height=Limit(0.04), angle=Limit(0.14, 0.1415, "rad"), lift=Limit(0.03)
    )
    sizes = by_name(pad=Limit((0.05, 0.05), (0.07, 0.07)))
    own_conditions = ("on_pad", "at_rest", "released")

    def layout(self, draw: Draw) -> Iterator[Placement]:
        side = draw.side()
        yield Placement(
            "fan",
            draw.one_of("fan"),
            Region(x=(0.0, side * 0.10), y=(-0.15, -0.05), yaw=(-np.pi, np.pi)),
        )
        pad = draw.one_of("pad", half=self.sizes["pad"].under(draw.rules), thickness=0.004)
        yield Placement("pad", pad, Region(x=(-0.25, 0.25), y=(-0.20, 0.0)))

    def meet(self, a: Actor) -> Iterator[Skill]:
        arm, centre = a.arms["arm"], a.frame("pad", "centre")
        down = resting_poses(a.frames("fan")["base"], centre, (0.0,))
        goals = [list(down), list(lifted(down, 0.05))]
        yield from regrasp(a, arm, "fan", goals[:1])
        yield grasp(arm, "fan", goals=goals)
        yield lift(arm, 0.06)
        yield place_or_regrasp(arm, "base", centre, above=0.05)
