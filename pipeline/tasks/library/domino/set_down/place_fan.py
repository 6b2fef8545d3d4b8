import numpy as np

from pipeline.expert.scripts import place_or_regrasp, regrasp
from pipeline.expert.skills import grasp, lift, resting_poses
from pipeline.poses import lifted
from pipeline.tasks.contract import Actor, Bodies, Draw, Limit, Skills, by_name, register

from .set_down import SetDown


@register
class PlaceFan(SetDown):
    """Grasp a desk fan by its cage and stand it on a pad that moves, blowing towards the robot."""

    target, manipulated = "pad", "fan"
    limits = by_name(
        plane=Limit(0.04), height=Limit(0.04), angle=Limit(0.14, 0.1415, "rad"), lift=Limit(0.03)
    )
    sizes = by_name(pad=Limit((0.05, 0.05), (0.07, 0.07)))
    own_conditions = ("on_pad", "at_rest", "released")

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        yield draw.place("fan", x=(0.0, side * 0.10), y=(-0.15, -0.05), yaw=(-np.pi, np.pi))
        yield self.pad(draw, x=(-0.25, 0.25), y=(-0.20, 0.0))

    def meet(self, a: Actor) -> Skills:
        arm, centre = a.arms["arm"], a.frame("pad", "centre")
        down = resting_poses(a.frames("fan")["base"], centre, (0.0,))
        goals = [down, lifted(down, 0.05)]
        yield from regrasp(a, arm, "fan", goals[:1])
        yield grasp(arm, "fan", goals=goals)
        yield lift(arm, 0.06)
        yield place_or_regrasp(arm, "base", centre, above=0.05)
