"""Where the conditions of the interception tasks turn over: every number is the specification's,
strict | domino."""

import numpy as np

from pipeline.poses import compose, inverse, pose, quat_about, quat_rotate, yawed
from pipeline.world.physics.body import TABLE_TOP
from tests.tasks.library.take import (
    ARM,
    PUT,
    Row,
    Spec,
    above,
    below,
    both_open,
    box,
    fails,
    height,
    held,
    lift,
    opened,
    positive,
    resting,
    rise,
    set_down,
    tilt,
    yaw,
)  # fmt: skip

UP = 0.3
"""Height (m) over the table at which things are held up here."""


def out(t, role="arm"):
    """-1 on the left side of the table, +1 on the right: the side of the arm in that role."""
    return -1 if t.arms[role] == "left" else 1


def to(name, axis, value):
    """Put one coordinate of a body's origin from frame 7 on."""
    return lambda t, q: t.path(name).__setitem__((slice(PUT, None), axis), value(t, q))


def upright_bottle(t):
    """The cap of the lying bottle up, 20 cm out."""
    foot = (0.2 * out(t), -0.1, TABLE_TOP + UP)
    t.put("bottle", pose(foot, quat_about((0, 1, 0), -np.pi / 2)))
    t.hold(t.arms["arm"], "bottle")


def cap(axis, value):
    return lambda t, q: t.shift(
        "bottle", np.eye(3)[axis] * (value(t, q) - t.frame("bottle", "cap")[axis])
    )


def foot_height(t, q):
    """The foot lies one bottle's length under the cap: the frame of the cap is half of it from the
    origin."""
    length = 2 * t.local("bottle", "cap")[0]
    cap(2, lambda t, q: TABLE_TOP + q + length)(t, q)


BALLS = tuple(f"ball_{i + 1}" for i in range(5))


def poured(t):
    for i, name in enumerate(BALLS):
        t.put(name, compose(t.pose("big_bin"), pose((0.03 * i - 0.06, 0, 0.03), (1, 0, 0, 0))))
    t.put("bin", pose((-0.4, -0.1, TABLE_TOP + 0.4), (1, 0, 0, 0)))
    t.hold("left", "bin")


def ball(axis, value, name="ball_3"):
    def change(t, q):
        half = t.instance("big_bin").shape().aabb()[1]
        at = inverse_of(t, "big_bin", name)
        at[axis] = value(half, q)
        t.put(name, compose(t.pose("big_bin"), at))

    return change


def inverse_of(t, frame, name):
    return compose(inverse(t.pose(frame)), t.pose(name))


def lifted_roller(t):
    t.shift("roller", (0, 0, UP))
    for side in ("left", "right"):
        t.hold(side, "roller")


def end(side):
    return (
        Row(
            f"held_by_{side}",
            lambda t, q: t.drop(side, "roller", q),
            [(1, False), (2, False)],
            [(1, True), (2, False)],
        ),
        below("grippers_closed", lambda t, q: t.command(side, q), 0.2, 0.2),
    )


def received(t):
    """The microphone level in the air, its head towards the receiver."""
    t.put(
        "microphone",
        yawed((0, -0.1, TABLE_TOP + UP), 0.0 if t.arms["receiver"] == "right" else np.pi),
    )
    t.hold(t.arms["receiver"], "microphone")


def head(axis, value):
    return lambda t, q: t.shift(
        "microphone", np.eye(3)[axis] * (value(t, q) - t.frame("microphone", "head")[axis])
    )


def hung(t):
    t.put("mug", pose((0, 0, 0), (1, 0, 0, 0)))
    hole(t, t.frame("rack", "peg_middle")[:3])
    t.peak("mug")
    t.touch("mug", "rack")


def hole(t, at):
    t.shift("mug", at - t.frame("mug", "handle_hole")[:3])


def along_peg(start):
    """The hole `q` m out from the tip or the root of the peg, on its axis."""

    def change(t, q):
        tip, middle = t.frame("rack", "peg")[:3], t.frame("rack", "peg_middle")[:3]
        axis = (tip - middle) / np.linalg.norm(tip - middle)
        hole(t, (tip - q * axis) if start == "tip" else (2 * middle - tip + q * axis))

    return change


def off_peg(t, q):
    """The hole `q` m from the middle of the peg, level and across it."""
    axis = quat_rotate(t.frame("rack", "peg")[3:], np.array([0, 0, 1.0]))
    level = np.cross(axis, [0, 0, 1.0])
    t.shift("mug", q * level / np.linalg.norm(level))


def beside_peg(axis):
    def change(t, q):
        goal = t.frame("mug", "handle_hole")[:3]
        goal[:2] = (t.pose("rack")[:2] + t.frame("rack", "peg")[:2]) / 2
        goal[axis] += q
        hole(t, goal)

    return change


def hole_height(t, q):
    at = t.frame("mug", "handle_hole")[:3]
    hole(t, np.array([*at[:2], TABLE_TOP + q]))


def beside_pot(t):
    x, y = t.pose("pot")[:2]
    t.put("can", pose((x + 0.18 * out(t), y, TABLE_TOP), (1, 0, 0, 0)))
    t.peak("can")
    t.touch("can", "table")


def aside(t):
    t.put("cards", pose((0.27 * out(t), -0.08, TABLE_TOP), (1, 0, 0, 0)))
    t.peak("cards")
    t.touch("cards", "table")


def beside(direction):
    def good(t):
        x, y = t.pose("b")[:2]
        t.put("a", pose((x + 0.13 * direction, y, TABLE_TOP), (1, 0, 0, 0)))
        t.peak("a")
        t.touch("a", "table")

    def across(t, q):
        t.shift("a", (0, q, 0))

    def away(t, q):
        t.path("a")[PUT:, 0] = t.pose("b")[0] + direction * q

    def askew(t, q):
        """A `q` m from B, 4.8 cm of it in y."""
        across(t, 0.048)
        away(t, (q**2 - 0.048**2) ** 0.5)

    return Spec(
        good,
        (
            positive("on_correct_side", away, also=("at_distance",)),
            above("at_distance", away, 0.08, 0.08),
            below("at_distance", away, 0.20, 0.20),
            above("at_distance", askew, 0.08, 0.08),
            below("at_distance", askew, 0.20, 0.20),
            below("in_line", across, 0.05, 0.05, signs=(1, -1)),
            *resting("a", "table"),
            *both_open(),
            *lift("a", 0.03, 0.03),
        ),
    )


def in_skillet(t):
    t.shift("skillet", (0, 0, UP))
    t.seat("bread", "base", t.frame("skillet", "centre"))
    t.peak("bread")
    t.touch("bread", "skillet")
    t.hold(t.arms["pan_arm"], "skillet")


def in_basket(name):
    def good(t):
        t.shift("basket", (0, 0, UP))
        at(lambda q: [0.03, 0, 0.02])(t, 0)
        t.peak(name)
        t.touch(name, "basket")
        t.hold(t.arms["lifter"], "basket")

    def at(offset):
        return lambda t, q: t.put(name, pose(t.pose("basket")[:3] + offset(q), (1, 0, 0, 0)))

    return Spec(
        good,
        (
            *rise("basket", "basket_lifted", 0.02, 0.02),
            *rise(name, "lifted", 0.02, 0.02),
            *tilt("basket", 1.047, 1.047, "basket_upright"),
            below("centred", at(lambda q: [0.8 * q, -0.6 * q, 0]), 0.10, 0.10),
            below("at_distance", at(lambda q: [0.05, -0.04, q - 0.09]), 0.15, 0.15),
            below("at_distance", at(lambda q: [-0.05, 0.04, 0.09 - q]), 0.15, 0.15),
            fails("on_basket", lambda t: t.apart(name, "basket")),
            fails("off_table", lambda t: t.touch(name, "table")),
            *held("basket_held", "lifter", "basket"),
            *lift(name, 0.03, 0.03, ("lifted",)),
        ),
    )


def in_bin(t):
    t.put("bottle", compose(t.pose("dustbin"), pose((0, 0, 0.1), (1, 0, 0, 0))))
    t.peak("bottle")


def bottle(axis, value):
    """One coordinate of the bottle in the frame of the dustbin."""

    def change(t, q):
        at = inverse_of(t, "dustbin", "bottle")
        at[axis] = value(t.instance("dustbin").shape().aabb()[1], q)
        t.put("bottle", compose(t.pose("dustbin"), at))

    return change


PULL = 0.11
"""How far (m) the drawer is open here."""


def in_drawer(t):
    pull(t, PULL)
    t.peak("object")
    t.touch("object", "drawer")


def pull(t, q):
    """The drawer `q` m open, the object in the middle of what is open."""
    t.path("drawer")[PUT:, :3] = t.path("drawer")[0, :3] - [0, q, 0]
    t.put(
        "object",
        compose(t.pose("drawer"), pose((0, -t.instance("drawer").hy + q / 2, 0.006), (1, 0, 0, 0))),
    )


def inside(axis, value):
    """One coordinate of the object in the frame of the drawer."""

    def change(t, q):
        at = inverse_of(t, "drawer", "object")
        at[axis] = value(t.instance("drawer"), q)
        t.put("object", compose(t.pose("drawer"), at))

    return change


def facing(t):
    t.put("sign", pose((0.20 * out(t), -0.15, TABLE_TOP), (1, 0, 0, 0)))
    t.peak("sign")
    t.touch("sign", "table")


def scanned(t):
    for name in ("box", "scanner"):
        t.shift(name, (0, 0, UP))
        t.peak(name)
    on_ray(t, (0, 0, 0.05))
    t.hold(t.arms["arm"], "box")
    t.hold(t.arms["scan_arm"], "scanner")


def on_ray(t, at):
    """The middle of the box, half way up, at a point in the frame of the scanner's window."""
    goal = compose(t.frame("scanner", "window"), pose(at, (1, 0, 0, 0)))[:3]
    turned = t.pose("box")
    turned[:3] = goal - quat_rotate(turned[3:], t.local("box", "top")[:3] / 2)
    t.put("box", turned)


def swinging(level):
    """A bottle in the air, held, that swings five times to and fro about the vertical or (`level`)
    about the horizontal."""

    def tipped(angle):
        return quat_about((1, 0, 0), angle + (np.pi / 2 if level else 0.0))

    def swing(t, angle, times=5):
        """`times` far sides in turn, at `angle` from the middle, so one crossing fewer."""
        for frame in range(PUT - 5, PUT):
            side = 1 if frame % 2 else -1
            t.path("bottle")[frame, 3:] = tipped(side * angle if frame - (PUT - 5) < times else 0.0)

    def good(t):
        t.put("bottle", pose((0, 0, TABLE_TOP + UP), tipped(0.0)))
        t.path("bottle")[:, 3:] = tipped(0.0)
        swing(t, 0.6)
        t.hold(t.arms["arm"], "bottle")

    far, still = (0.3, "level") if level else (0.4, "upright")
    return Spec(
        good,
        (
            *held("held", "arm", "bottle"),
            *rise("bottle", "lifted", 0.05, 0.015),
            below(still, lambda t, q: t.turn("bottle", (1, 0, 0), q), 0.35, None, signs=(1, -1)),
            above("shaken", swing, far, None),
            Row("shaken", lambda t, q: swing(t, 0.6, q), [(5, True), (4, False)], None),
        ),
    )


INTERCEPTION = {
    "adjust_bottle": Spec(
        upright_bottle,
        (
            below(
                "upright",
                lambda t, q: t.turn("bottle", (0, 1, 0), q, "cap"),
                0.26,
                None,
                signs=(1, -1),
            ),
            below("upright", lambda t, q: t.turn("bottle", (1, 0, 0), q, "cap"), 0.26, None),
            above("on_arm_side", cap(0, lambda t, q: out(t) * q), 0.15, 0.15),
            above(
                "cap_above_table", cap(2, lambda t, q: TABLE_TOP + q), 0.16, 0.16, ("above_table",)
            ),
            above("above_table", foot_height, 0.02, None, ("cap_above_table",)),
            *held("held", "arm", "bottle"),
        ),
    ),
    "dump_bin_bigbin": Spec(
        poured,
        (
            below(
                "balls_in_big_bin", ball(0, lambda half, q: q * half[0]), 1.0, 1.0, signs=(1, -1)
            ),
            below(
                "balls_in_big_bin", ball(1, lambda half, q: q * half[1]), 1.0, 1.0, signs=(1, -1)
            ),
            positive("balls_in_big_bin", ball(2, lambda half, q: q)),
            below("balls_at_bottom", ball(2, lambda half, q: 0.01 + q), 0.12, 0.12),
            *rise("bin", "lifted", 0.26, 0.26),
            *(
                fails(
                    "balls_in_big_bin",
                    lambda t, n=n: ball(0, lambda half, q: 1.5 * half[0], n)(t, 0),
                )
                for n in BALLS
            ),
            *(
                fails("balls_at_bottom", lambda t, n=n: ball(2, lambda half, q: 0.2, n)(t, 0))
                for n in BALLS
            ),
            *held("held", "pourer", "bin"),
        ),
    ),
    "grab_roller": Spec(
        lifted_roller, (*end("left"), *end("right"), *rise("roller", "lifted", 0.06, 0.05))
    ),
    "handover_block": Spec(
        set_down("block", "pad", "centre"),
        (
            *box("block", 0.03, 0.03),
            *height("block", 0.01, 0.01),
            *tilt("block", 0.26, None),
            *resting("block", "pad"),
            *opened("receiver"),
            *lift("block", 0.03, 0.03),
        ),
    ),
    "handover_mic": Spec(
        received,
        (
            *opened("giver", alone=False),
            fails(
                "released_by_giver",
                lambda t: t.touch(t.fingers(t.arms["giver"])[1], "microphone"),
                asked=False,
            ),
            Row(
                "held", lambda t, q: t.drop(t.arms["receiver"], "microphone", q), [(1, False)], None
            ),
            fails("in_hand", lambda t: t.drop(t.arms["receiver"], "microphone", 2), also=("held",)),
            below("gripper_closed", lambda t, q: t.command(t.arms["receiver"], q), 0.2, 0.2),
            positive("on_receiver_side", head(0, lambda t, q: out(t, "receiver") * q)),
            above("above_table", head(2, lambda t, q: TABLE_TOP + q), 0.18, 0.18),
            *lift("microphone", 0.03, 0.03),
        ),
    ),
    "hanging_mug": Spec(
        hung,
        (
            below("on_peg_axis", off_peg, 0.03, None, signs=(1, -1)),
            positive("between_root_and_tip", along_peg("tip"), False, ("near_peg",)),
            positive("between_root_and_tip", along_peg("root"), False, ("near_peg",)),
            below(
                "near_peg",
                beside_peg(0),
                0.05,
                0.05,
                ("on_peg_axis", "between_root_and_tip"),
                (1, -1),
            ),
            below(
                "near_peg",
                beside_peg(1),
                0.05,
                0.05,
                ("on_peg_axis", "between_root_and_tip"),
                (1, -1),
            ),
            above("above_table", hole_height, 0.09, 0.09, ("on_peg_axis", "between_root_and_tip")),
            fails("off_table", lambda t: t.touch("mug", "table"), asked=False),
            fails("on_rack", lambda t: t.apart("mug", "rack")),
            fails("released", lambda t: t.touch(ARM, "mug"), asked=False),
            *opened("hanger"),
            *lift("mug", 0.03, 0.03),
        ),
    ),
    "move_can_pot": Spec(
        beside_pot,
        (
            positive("on_arm_side", to("can", 0, lambda t, q: t.pose("pot")[0] + out(t) * q)),
            below(
                "at_distance", to("can", 0, lambda t, q: t.pose("pot")[0] + out(t) * q), 0.20, 0.20
            ),
            below("in_line", lambda t, q: t.shift("can", (0, q, 0)), 0.035, 0.035, signs=(1, -1)),
            *tilt("can", 0.26, 0.2618),
            below("at_height", lambda t, q: t.shift("can", (0, 0, q)), 0.001, 0.001),
            *resting("can", "table"),
            *both_open(),
            *lift("can", 0.03, 0.03),
        ),
    ),
    "move_playingcard_away": Spec(
        aside,
        (
            above("far_out", to("cards", 0, lambda t, q: out(t) * q), 0.23, 0.23),
            Row("on_arm_side", to("cards", 0, lambda t, q: -out(t) * q), [(0.27, False)], None),
            Row(
                "far_out",
                to("cards", 0, lambda t, q: -out(t) * q),
                [(0.25, True)],
                [(0.25, True)],
                ("on_arm_side",),
            ),
            *tilt("cards", 0.26, None),
            *resting("cards", "table"),
            *both_open(),
            *lift("cards", 0.02, 0.02),
        ),
    ),
    "place_a2b_left": beside(-1),
    "place_a2b_right": beside(1),
    "place_bread_skillet": Spec(
        in_skillet,
        (
            *rise("bread", "lifted", 0.02, 0.01),
            *rise("skillet", "skillet_lifted", 0.02, 0.01),
            *held("skillet_held", "pan_arm", "skillet"),
            *box("bread", 0.035, 0.10),
            *resting("bread", "skillet"),
            *lift("bread", 0.03, 0.03, ("lifted",)),
        ),
    ),
    "place_can_basket": in_basket("can"),
    "place_object_basket": in_basket("object"),
    "put_bottles_dustbin": Spec(
        in_bin,
        (
            below("within_outline", bottle(0, lambda half, q: q * half[0]), 1.0, 1.0, ("in_bin",)),
            below("within_outline", bottle(1, lambda half, q: q * half[0]), 1.0, 1.0),
            below(
                "in_bin", bottle(0, lambda half, q: q), 0.221, 0.221, ("within_outline",), (1, -1)
            ),
            below(
                "in_bin", bottle(1, lambda half, q: q), 0.325, 0.325, ("within_outline",), (1, -1)
            ),
            below("below_rim", bottle(2, lambda half, q: q * half[2]), 1.0, None, ("at_height",)),
            below("at_height", bottle(2, lambda half, q: q), 0.57, 0.57, ("below_rim",)),
            above("at_height", bottle(2, lambda half, q: q), 0.005, 0.005),
            fails("released", lambda t: t.touch(ARM, "bottle"), asked=False),
            Row(
                "was_lifted",
                lambda t, q: t.begin("bottle", q),
                [(0.0288, False), (0.0312, True)],
                None,
            ),
        ),
    ),
    "put_object_cabinet": Spec(
        in_drawer,
        (
            above("drawer_open", pull, 0.05, None),
            below("centred", inside(0, lambda d, q: q), 0.12, 0.12, ("within_outline",), (1, -1)),
            below(
                "centred",
                inside(1, lambda d, q: q - d.hy + PULL / 2),
                0.07,
                0.07,
                ("within_outline",),
                (1, -1),
            ),
            below(
                "within_outline", inside(0, lambda d, q: q * d.hx), 1.0, None, ("centred",), (1, -1)
            ),
            below(
                "within_outline", inside(1, lambda d, q: q * d.hy), 1.0, None, ("centred",), (1, -1)
            ),
            *rise("object", "raised", 0.005, 0.005),
            below("raised", lambda t, q: t.begin("object", q, slice(PUT, None)), 0.18, 0.18),
            positive("at_height", inside(2, lambda d, q: q), False),
            below("at_height", inside(2, lambda d, q: d.height + q), 0.04, None, ("raised",)),
            fails("on_drawer", lambda t: t.apart("object", "drawer"), asked=False),
            fails("off_table", lambda t: t.touch("object", "table"), asked=False),
            fails("released", lambda t: t.touch(ARM, "object"), asked=False),
            *opened("arm"),
            *lift("object", 0.03, None, ("raised",)),
        ),
    ),
    "rotate_qrcode": Spec(
        facing,
        (
            *box("sign", 0.05, None),
            *yaw("sign", 0.14, 0.1415),
            *tilt("sign", 0.14, 0.1415, "aligned"),
            below("at_height", lambda t, q: t.shift("sign", (0, 0, q)), 0.01, 0.01),
            *resting("sign", "table"),
            *both_open(),
            *lift("sign", 0.03, None),
        ),
    ),
    "scan_object": Spec(
        scanned,
        (
            below("on_ray", lambda t, q: on_ray(t, (q, 0, 0.05)), 0.025, 0.025, signs=(1, -1)),
            below("on_ray", lambda t, q: on_ray(t, (0, q, 0.05)), 0.025, 0.025, signs=(1, -1)),
            below("at_distance", lambda t, q: on_ray(t, (0, 0, q)), 0.07, 0.07),
            positive("at_distance", lambda t, q: on_ray(t, (0, 0, q))),
            below("grippers_closed", lambda t, q: t.command("left", q), 0.2, 0.2),
            below("grippers_closed", lambda t, q: t.command("right", q), 0.2, 0.2),
            *held("held", "arm", "box"),
            *held("scanner_held", "scan_arm", "scanner"),
            *rise("box", "lifted", 0.05, None),
            *rise("scanner", "scanner_lifted", 0.05, None),
            *lift("box", 0.03, 0.03, ("lifted",)),
        ),
    ),
    "shake_bottle": swinging(level=False),
    "shake_bottle_horizontally": swinging(level=True),
}
