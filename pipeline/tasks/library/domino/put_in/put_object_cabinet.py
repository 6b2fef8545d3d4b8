import numpy as np

from pipeline.expert.scripts import let_go
from pipeline.expert.skills import grasp, home, lift, open_, place, resting_poses, shift, together
from pipeline.poses import compose, inverse, lifted, pose, transform
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
    Workspace,
    by_name,
    other_side,
    register,
    side_of,
    sign_of,
    within,
)
from pipeline.world.objects.families.containers.cabinet import Cabinet, Drawer

PULL = 0.135  # m by which the drawer is pulled open

HELD = 0.03  # m over the floor of the drawer from which the object falls

LONGEST = 0.105  # m along the open part of the drawer that fits into it

OBJECTS = (
    *("mouse", "stapler", "toy_car", "rubiks_cube", "bread", "phone", "playing_cards"),
    *("tea_box", "coffee_box", "soap"),
)


@register
class PutObjectCabinet(Task):
    """Catch a moving object with the arm beside it, pull the drawer of the cabinet open with the
    other arm, put the object in."""

    step_limit = 700
    target = "object"
    workspace = Workspace(-0.35, 0.35, -0.25, 0.03)
    limits = by_name(
        opening=Limit(0.05),
        along_x=Limit(0.12),
        along_y=Limit(0.07),
        over_rim=Limit(0.04),
        least_rise=Limit(0.005),
        most_rise=Limit(0.18),
        lift=Limit(0.03),
    )
    own_conditions = (
        *("drawer_open", "within_outline", "at_height", "on_drawer", "off_table"),
        *("released", "was_lifted"),
    )

    def layout(self, draw: Draw) -> Bodies:
        cabinet = draw.one_of("cabinet")
        assert isinstance(cabinet, Cabinet)
        yield Placement("cabinet", cabinet, Region(x=(-0.05, 0.05), y=(0.155, 0.155)), fixed=True)
        slot = Region(x=(0.0, 0.0), y=(0.0, 0.0), z=float(cabinet.slot()[2]))
        yield Placement("drawer", cabinet.drawer(), slot, inside="cabinet", slide=cabinet.slide())
        side = draw.side()
        yield draw.place(
            "object", *OBJECTS, x=(side * 0.20, side * 0.32), y=(-0.20, -0.10), yaw=(-1.05, 1.05)
        )

    def arms(self, bodies: dict[str, Body]) -> dict[str, str]:
        arm = side_of(bodies["object"])
        return {"arm": arm, "drawer_arm": other_side(arm)}

    def meet(self, a: Actor) -> Skills:
        arm = a.arms["arm"]
        base, yaws = a.frames("object")["base"], self._across(a)
        opened = resting_poses(base, self._spots(a, PULL)[1:3], yaws)
        yield grasp(arm, "object", goals=[lifted(opened, HELD)])

    def finish(self, a: Actor) -> Skills:
        arm, puller = a.arms["arm"], a.arms["drawer_arm"]
        yield lift(arm, 0.12)
        ways = ([0, -out, 0, 0, 0, 0, 0] for out in (PULL, PULL + 0.07))
        openings = [[a.pose("drawer") + np.array(way)] for way in ways]
        pull = grasp(puller, "drawer", kinds=("handle",), goals=openings, pitch=0.3)
        yield together(home(arm), pull)
        yield shift(puller, (0.0, -PULL, 0.0), speed=0.08)
        yield from let_go(puller, 0.07)
        yield home(puller)
        spots, yaws = self._spots(a, 0.0), self._across(a)
        yield place(arm, "base", spots, yaws=yaws, above=0.10, press=-HELD, opening=0.02)
        yield open_(arm, by=0.02)
        yield lift(arm, 0.10, least=0.2)
        yield open_(arm)

    def _spots(self, a: Actor, pull: float) -> np.ndarray:
        """Poses (4,7) on the floor of the drawer, in the middle of its open part, after it is
        pulled out by `pull` m more."""
        body, at, side = a.bodies["drawer"], a.pose("drawer"), sign_of(a.arms["arm"])
        assert isinstance(body.instance, Drawer)
        depth = -pull - body.instance.hy + (body.pose[1] - at[1] + pull) / 2 - 0.004
        xs = (0.03, 0.06, 0.0, 0.08)
        return np.stack([compose(at, pose((side * x, depth, 0.006))) for x in xs])

    def _across(self, a: Actor) -> tuple[float, ...]:
        """Yaw angles in which the object lies across the drawer, and along it if short enough."""
        x, y, _ = np.ptp(a.bodies["object"].instance.shape().aabb(), axis=0)
        turn = 0.0 if x > y else np.pi / 2
        sides = (0.0, np.pi / 2) if max(x, y) < LONGEST else (0.0,)
        offsets = (0.0, 0.25, -0.25, 0.5, -0.5)
        return tuple(
            turn + side + off + half for off in offsets for side in sides for half in (0.0, np.pi)
        )

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        limit = self.under(o.rules)
        drawer = o.bodies["drawer"].instance
        assert isinstance(drawer, Drawer)
        x, y, z = transform(inverse(o.pose("drawer")), o.pose("object")[:3])
        opening = float(np.linalg.norm(o.pose("drawer")[:3] - o.pose("drawer", 0)[:3]))
        middle = y + drawer.hy - opening / 2
        return {
            "drawer_open": opening > limit["opening"],
            "centred": within((x, middle), (limit["along_x"], limit["along_y"])),
            "raised": limit["least_rise"] < o.rise("object") < limit["most_rise"],
            "within_outline": within((x, y), (drawer.hx, drawer.hy)),
            "at_height": bool(0 < z < drawer.height + limit["over_rim"]),
            "on_drawer": o.touching("object", "drawer"),
            "off_table": not o.touching("object", "table"),
            "released": not o.handled("object"),
            "gripper_open": o.gripper_open(arms["arm"]),
        }
