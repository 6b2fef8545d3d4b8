from pipeline.expert.scripts import set_down_on
from pipeline.poses import compose, pose
from pipeline.tasks.contract import (
    Actor,
    Bodies,
    Draw,
    Limit,
    Outcome,
    Skills,
    by_name,
    register,
    within,
)

from .set_down import SetDown

GAP = 0.003
"""Metres between phone and back rest: a stand that comes from the front must not meet it before."""


@register
class PlacePhoneStand(SetDown):
    """Grasp a phone and set it on a phone stand that moves, leaning against the back rest."""

    target, manipulated = "stand", "phone"
    limits = by_name(
        along_x=Limit(0.045), along_y=Limit(0.04), height=Limit(0.04), tilt=Limit(0.6, unit="rad")
    )
    own_conditions = ("tilted", "on_stand", "at_rest", "released")

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        yield draw.place("phone", x=(side * 0.05, side * 0.25), y=(-0.20, 0.0), yaw=(-0.7, 0.7))
        yield draw.place(
            "stand",
            "phone_stand",
            x=(0.0, side * 0.15),
            y=(0.0, 0.20),
            gap=0.03,
            distances={"phone": 0.15},
        )

    def meet(self, a: Actor) -> Skills:
        before_the_rest = compose(a.frame("stand", "seat"), pose((0, 0, GAP)))
        return set_down_on(a, a.arms["arm"], "phone", before_the_rest, point="foot")

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        limit = self.under(o.rules)
        d = o.offset(o.frame("phone", "foot"), o.frame("stand", "seat"))
        return {
            "centred": within(d[:2], (limit["along_x"], limit["along_y"])),
            "at_height": within(d[2], limit["height"]),
            "tilted": not o.upright("phone", limit["tilt"]),
            **o.set_down("phone", "stand"),
        }
