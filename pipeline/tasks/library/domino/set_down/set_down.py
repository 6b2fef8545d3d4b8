from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np

from pipeline.expert.scripts import let_go, set_down_on
from pipeline.expert.skills import ROUND
from pipeline.tasks.contract import (
    ANY_YAW,
    Actor,
    Bodies,
    Body,
    Draw,
    Limit,
    Outcome,
    Placement,
    Skills,
    Task,
    by_name,
    register,
    side_of,
    within,
)


class SetDown(Task):
    """The manipulated body is set down with its base on the frame `onto` of the target, turned by
    one of `yaws`.

    `up` and `above` are those of `set_down_on`. The conditions are those of `Outcome.seated`, whose
    `turns` it has, and of `Outcome.set_down`."""

    onto: ClassVar[str] = "centre"
    yaws: ClassVar[Sequence[float]] = ROUND
    turns: ClassVar[int] = 1
    up: ClassVar[float] = 0.10
    above: ClassVar[float] = 0.10

    def pad(self, draw: Draw, **where: Any) -> Placement:
        half = self.sizes["pad"].under(draw.rules)
        return draw.place("pad", half=half, thickness=0.004, **where)

    def meet(self, a: Actor) -> Skills:
        goal = a.frame(self.target, self.onto)
        return set_down_on(
            a, a.arms["arm"], self.manipulated, goal, self.yaws, up=self.up, above=self.above
        )

    def finish(self, a: Actor) -> Skills:
        return let_go(a.arms["arm"])

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        name, goal = self.manipulated, o.frame(self.target, self.onto)
        seated = o.seated(name, goal, self.under(o.rules), self.turns)
        return seated | o.set_down(name, self.target)


@register
class MovePillbottlePad(SetDown):
    """Grasp a pill bottle and stand it on a small pad that moves."""

    target, manipulated = "pad", "bottle"
    up = above = 0.06
    limits = by_name(
        plane=Limit(0.03, 0.05),
        height=Limit(0.005, 0.015),
        tilt=Limit(0.26, unit="rad"),
        lift=Limit(0.03),
    )
    sizes = by_name(pad=Limit((0.04, 0.04), (0.05, 0.05)))
    own_conditions = ("upright", "at_rest", "released")

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        x = (side * 0.05, side * 0.25)
        yield draw.place("bottle", "pill_bottle", x=x, y=(-0.10, 0.10), yaw=ANY_YAW)
        yield self.pad(draw, x=x, y=(-0.20, 0.10), gap=0.03, distances={"bottle": 0.10})


@register
class MoveStaplerPad(SetDown):
    """Grasp a stapler and set it down along the long side of a pad that moves, its mouth to either
    end."""

    target, manipulated = "pad", "stapler"
    yaws, turns = (0.0, np.pi), 2
    limits = by_name(
        plane=Limit(0.02, 0.025),
        height=Limit(0.01, 0.015),
        angle=Limit(0.06, unit="rad"),
        lift=Limit(0.03),
    )
    sizes = by_name(pad=Limit((0.055, 0.03), (0.065, 0.035)))
    own_conditions = ("on_pad", "at_rest", "released")

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        x, y = (side * 0.05, side * 0.25), (-0.20, 0.0)
        yield draw.place("stapler", x=x, y=y, yaw=ANY_YAW)
        yield self.pad(draw, x=x, y=y, gap=0.03, distances={"stapler": 0.10})


@register
class PlaceContainerPlate(SetDown):
    """Grasp a bowl or cup and set it down on a plate that moves."""

    target, manipulated = "plate", "container"
    limits = by_name(plane=Limit(0.05), height=Limit(0.03), lift=Limit(0.03))
    own_conditions = ("on_plate", "at_rest", "released")

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        yield draw.place(
            "container", "bowl", "cup", x=(side * 0.20, side * 0.28), y=(-0.10, 0.05), yaw=ANY_YAW
        )
        yield draw.place("plate", x=(side * 0.02, side * 0.08), y=(-0.15, -0.10))


@register
class PlaceEmptyCup(SetDown):
    """Grasp an empty cup and stand it on a coaster that moves."""

    step_limit = 500
    target, manipulated = "coaster", "cup"
    limits = by_name(
        plane=Limit(0.035), height=Limit(0.015), tilt=Limit(0.26, unit="rad"), lift=Limit(0.03)
    )
    own_conditions = ("upright", "on_coaster", "at_rest", "released")

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        yield draw.place("cup", x=(side * 0.15, side * 0.30), y=(-0.20, 0.05), yaw=ANY_YAW)
        yield draw.place(
            "coaster", x=(side * -0.05, side * 0.10), y=(-0.20, 0.05), distances={"cup": 0.10}
        )

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        limit = self.under(o.rules)
        x, y, z = o.offset(o.frame("cup", "base"), o.frame("coaster", "centre"))
        return {
            "centred": bool(x * x + y * y < limit["plane"] ** 2),
            "at_height": within(z, limit["height"]),
            "upright": o.upright("cup", limit["tilt"]),
            **o.set_down("cup", "coaster"),
        }


EITHER_WAY = tuple(turn + lean for lean in (0.0, 0.1, -0.1) for turn in (0.0, np.pi))


@register
class PlaceMousePad(SetDown):
    """Grasp a computer mouse and set it down along a pad that moves, buttons to either end."""

    target, manipulated = "pad", "mouse"
    yaws, turns = EITHER_WAY, 2
    limits = by_name(
        along_x=Limit(0.015, 0.023),
        along_y=Limit(0.012, 0.020),
        angle=Limit(0.3, 0.365, "rad"),
        lift=Limit(0.03),
    )
    sizes = by_name(pad=Limit((0.035, 0.065), (0.043, 0.073)))
    own_conditions = ("on_pad", "at_rest", "released")

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        x, y = (side * 0.05, side * 0.25), (-0.20, 0.0)
        yield draw.place("mouse", x=x, y=y, yaw=ANY_YAW)
        yield self.pad(draw, x=x, y=y, gap=0.03, distances={"mouse": 0.10})


@register
class PlaceObjectScale(SetDown):
    """Grasp a mouse, stapler or bell and set it down on a scale that moves."""

    target, manipulated = "scale", "object"
    limits = by_name(plane=Limit(0.035), below=Limit(0.01), lift=Limit(0.03))
    own_conditions = ("on_scale", "at_rest", "released")

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        x, y = (side * 0.02, side * 0.25), (-0.20, 0.05)
        yield draw.place("object", "mouse", "stapler", "bell", x=x, y=y, yaw=ANY_YAW)
        yield draw.place("scale", x=x, y=y, yaw=ANY_YAW, distances={"object": 0.15})

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        limit = self.under(o.rules)
        x, y, z = o.offset(o.frame("object", "base"), o.frame("scale", "centre"))
        return {
            "centred": bool(x * x + y * y < limit["plane"] ** 2),
            "at_height": bool(z > -limit["below"]),
            **o.resting("object", "scale"),
            "gripper_open": o.gripper_open(arms["arm"]),
        }


@register
class PlaceObjectStand(SetDown):
    """Grasp a small object and set it down on the plate of a display stand that moves."""

    target, manipulated = "stand", "object"
    onto, up, above = "top", 0.12, 0.07
    limits = by_name(plane=Limit(0.03), height=Limit(0.015), lift=Limit(0.03))
    own_conditions = ("at_height", "on_stand", "at_rest", "released")

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        kinds = ("mouse", "stapler", "bell", "rubiks_cube", "toy_car", "remote")
        x, yaw = (side * 0.20, side * 0.28), (-np.pi / 3, np.pi / 3)
        yield draw.place("object", *kinds, x=x, y=(-0.05, 0.05), yaw=yaw)
        yield draw.place(
            "stand",
            "display_stand",
            x=(0.0, side * 0.05),
            y=(-0.15, -0.10),
            yaw=(-np.pi / 6, np.pi / 6),
            distances={"object": 0.10},
        )


@register
class StampSeal(SetDown):
    """Grasp a stamp by its handle and press it upright onto a small pad that moves."""

    target, manipulated = "pad", "stamp"
    up = 0.06
    limits = by_name(
        plane=Limit(0.01),
        height=Limit(0.01),
        distance=Limit(0.035),
        tilt=Limit(0.26, 0.942, "rad"),
        lift=Limit(0.03),
    )
    sizes = by_name(pad=Limit((0.035, 0.035), (0.045, 0.045)))
    own_conditions = ("centred", "at_height", "at_rest", "released")

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        yield draw.place("stamp", "seal", x=(0.0, 0.0), y=(0.0, 0.0), yaw=ANY_YAW)
        x, y = (0.0, side * 0.25), (-0.15, 0.15)
        yield self.pad(draw, x=x, y=y, away_from_origin=0.10, gap=0.03)

    def arms(self, bodies: dict[str, Body]) -> dict[str, str]:
        return {"arm": side_of(bodies["pad"])}

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        limit = self.under(o.rules)
        d = o.offset(o.frame("stamp", "base"), o.frame("pad", "centre"))
        return {
            "centred": within(d[:2], limit["plane"]),
            "at_height": within(d[2], limit["height"]),
            "at_distance": bool(d @ d < limit["distance"] ** 2),
            "upright": o.upright("stamp", limit["tilt"]),
            **o.set_down("stamp", "pad"),
        }
