"""Where the conditions of the tracking tasks turn over: every number is the specification's, strict
| domino."""

import numpy as np

from pipeline.poses import pose, quat_about
from pipeline.world.physics.body import TABLE_TOP
from tests.tasks.library.take import (
    OTHER,
    PEAK,
    PUT,
    Row,
    Spec,
    above,
    below,
    both_open,
    box,
    circle,
    fails,
    height,
    held,
    lift,
    met,
    opened,
    resting,
    set_down,
    tilt,
    yaw,
)  # fmt: skip

PRESS = 8
"""Frame of the press or strike."""


def pressing(body, point, plane, high, asked):
    """A press: `plane` and `high` are (strict, domino), `asked` whether domino rules ask for the
    closed gripper of the acting arm."""

    def good(t):
        side = t.arms["arm"]
        t.touch(t.fingers(side)[0], body, PRESS, t.frame(body, point)[:3])
        t.open(side, 0.0)

    def at(axis):
        def change(t, q):
            frame, a, b, spot = t.contacts[0]
            t.contacts[0] = (frame, a, b, spot + q * np.eye(3)[axis])

        return change

    def other_arm(t, q):
        frame, _, b, spot = t.contacts[0]
        t.contacts[0] = (frame, t.fingers(OTHER[t.arms["arm"]])[0], b, spot)

    def opening(t, q):
        t.open(t.arms["arm"], 0.0)
        (t.commanded if t.rules == "domino" else t.measured)[t.arms["arm"]][
            PRESS - (t.rules == "domino")
        ] = q

    closed = below("closed_at_press", opening, 0.2, 0.2 if asked else None)
    return Spec(
        good,
        (
            fails("touched", lambda t: t.contacts.clear(), also=("pressed", "closed_at_press")),
            Row(
                "touched", other_arm, [(1, False)], [(1, not asked)], ("pressed", "closed_at_press")
            ),
            *(below("pressed", at(axis), *plane, ("closed_at_press",), (1, -1)) for axis in (0, 1)),
            below("pressed", at(2), *high, ("closed_at_press",), (1, -1)),
            closed,
        ),
    )


def struck(t):
    t.seat("hammer", "base", t.frame("block", "top"))
    t.peak("hammer")
    t.touch("hammer", "block", PRESS)
    t.hold(t.arms["arm"], "hammer")


def strike_height(t, q):
    t.path("hammer")[PUT:, 2] = TABLE_TOP + q


def leaning(t):
    """The phone on the seat of the stand, its z axis 1.2 rad from the vertical."""
    lean(t, 1.2)
    t.peak("phone")
    t.touch("phone", "stand")


def lean(t, q):
    t.seat("phone", "foot", t.frame("stand", "seat"))
    t.put("phone", pose(t.pose("phone")[:3], quat_about((1, 0, 0), q)))
    t.shift("phone", t.frame("stand", "seat")[:3] - t.frame("phone", "foot")[:3])


def rebound(t, q):
    """The hammer comes down onto the block once more, lower."""
    t.path("hammer")[PRESS + 1, 2] = TABLE_TOP
    t.touch("hammer", "block", PRESS + 1)


def glancing(t):
    """The hammer hits the block off its middle from well above the table, and its middle with the
    face on the table only."""
    struck(t)
    strike_height(t, 0.005)
    t.touch("hammer", "block", PEAK)
    t.path("hammer")[PEAK, :3] += (0.1, 0, 0)


STRUCK = ("strike_centred", "lifted_at_strike")

TRACKING = {
    "beat_block_hammer": Spec(
        struck,
        (
            fails("block_struck", lambda t: t.apart("hammer", "block"), also=STRUCK),
            *box("hammer", 0.02, 0.04, "strike_centred", ("lifted_at_strike",)),
            above("lifted_at_strike", strike_height, 0.02, 0.017),
            fails("lifted_at_strike", glancing),
            Row("lifted_at_strike", rebound, [(1, True)], [(1, True)]),
            *held("held", "arm", "hammer"),
            *lift("hammer", 0.02, 0.02),
            *met("hammer"),
        ),
    ),
    "click_alarmclock": pressing("clock", "button", (0.027, 0.027), (0.027, 0.027), True),
    "click_bell": pressing("bell", "button", (0.020, 0.020), (0.024, 0.024), True),
    "press_stapler": pressing("stapler", "press", (0.027, 0.03), (0.027, 0.03), False),
    "move_pillbottle_pad": Spec(
        set_down("bottle", "pad", "centre"),
        (
            *box("bottle", 0.03, 0.05),
            *height("bottle", 0.005, 0.015),
            *tilt("bottle", 0.26, None),
            *resting("bottle", "pad", asked=True),
            *both_open(),
            *lift("bottle", 0.03, 0.03),
            *met("bottle"),
        ),
    ),
    "move_stapler_pad": Spec(
        set_down("stapler", "pad", "centre"),
        (
            *box("stapler", 0.02, 0.025),
            *height("stapler", 0.01, 0.015),
            *yaw("stapler", 0.06, 0.06, either_way=True),
            *resting("stapler", "pad"),
            *both_open(),
            *lift("stapler", 0.03, 0.03),
            *met("stapler"),
        ),
    ),
    "place_bread_basket": Spec(
        set_down("bread", "basket", "inside"),
        (
            *box("bread", 0.05, 0.05),
            fails("off_table", lambda t: t.touch("bread", "table")),
            *resting("bread", "basket", asked=True),
            *both_open(),
            *lift("bread", 0.03, 0.03),
            *met("bread"),
        ),
    ),
    "place_container_plate": Spec(
        set_down("container", "plate", "centre"),
        (
            *box("container", 0.05, 0.05),
            *height("container", 0.03, 0.03),
            *resting("container", "plate"),
            *both_open(),
            *lift("container", 0.03, 0.03),
            *met("container"),
        ),
    ),
    "place_empty_cup": Spec(
        set_down("cup", "coaster", "centre"),
        (
            *circle("cup", 0.035, 0.035),
            *height("cup", 0.015, 0.015),
            *tilt("cup", 0.26, None),
            *resting("cup", "coaster"),
            *both_open(),
            *lift("cup", 0.03, 0.03),
            *met("cup"),
        ),
    ),
    "place_fan": Spec(
        set_down("fan", "pad", "centre"),
        (
            *box("fan", 0.04, 0.04),
            *height("fan", 0.04, 0.04),
            *yaw("fan", 0.14, 0.1415),
            *tilt("fan", 0.14, 0.1415, "aligned"),
            *resting("fan", "pad"),
            *both_open(),
            *lift("fan", 0.03, 0.03),
            *met("fan"),
        ),
    ),
    "place_mouse_pad": Spec(
        set_down("mouse", "pad", "centre"),
        (
            below("centred", lambda t, q: t.shift("mouse", (q, 0, 0)), 0.015, 0.023, signs=(1, -1)),
            below("centred", lambda t, q: t.shift("mouse", (0, q, 0)), 0.012, 0.020, signs=(1, -1)),
            *yaw("mouse", 0.3, 0.365, either_way=True),
            *resting("mouse", "pad"),
            *both_open(),
            *lift("mouse", 0.03, 0.03),
            *met("mouse"),
        ),
    ),
    "place_object_scale": Spec(
        set_down("object", "scale", "centre"),
        (
            *circle("object", 0.035, 0.035),
            below("at_height", lambda t, q: t.shift("object", (0, 0, -q)), 0.01, 0.01),
            Row(
                "at_height",
                lambda t, q: t.shift("object", (0, 0, q)),
                [(0.05, True)],
                [(0.05, True)],
            ),
            *resting("object", "scale"),
            *opened("arm"),
            *lift("object", 0.03, 0.03),
            *met("object"),
        ),
    ),
    "place_object_stand": Spec(
        set_down("object", "stand", "top"),
        (
            *box("object", 0.03, 0.03),
            *height("object", 0.015, None),
            *resting("object", "stand"),
            *both_open(),
            *lift("object", 0.03, 0.03),
            *met("object"),
        ),
    ),
    "place_phone_stand": Spec(
        leaning,
        (
            below("centred", lambda t, q: t.shift("phone", (q, 0, 0)), 0.045, 0.045, signs=(1, -1)),
            below("centred", lambda t, q: t.shift("phone", (0, q, 0)), 0.04, 0.04, signs=(1, -1)),
            *height("phone", 0.04, 0.04),
            above("tilted", lean, 0.6, None),
            *resting("phone", "stand"),
            *both_open(),
            *met("phone"),
        ),
    ),
    "place_shoe": Spec(
        set_down("shoe", "mat", "centre", turn=np.pi),
        (
            below("centred", lambda t, q: t.shift("shoe", (q, 0, 0)), 0.05, 0.08, signs=(1, -1)),
            below("centred", lambda t, q: t.shift("shoe", (0, q, 0)), 0.02, 0.04, signs=(1, -1)),
            *height("shoe", 0.015, None),
            *yaw("shoe", 0.14, 0.2988),
            *tilt("shoe", 0.26, 0.2988),
            *resting("shoe", "mat"),
            *both_open(),
            *lift("shoe", 0.03, 0.03),
            *met("shoe"),
        ),
    ),
    "stamp_seal": Spec(
        set_down("stamp", "pad", "centre"),
        (
            *box("stamp", 0.01, None),
            *height("stamp", 0.01, None),
            *circle("stamp", 0.035, 0.035, "at_distance", ("centred",)),
            below(
                "at_distance",
                lambda t, q: t.shift("stamp", (0, 0, q)),
                0.035,
                0.035,
                ("at_height",),
            ),
            *tilt("stamp", 0.26, 0.942),
            *resting("stamp", "pad", asked=True),
            *both_open(),
            *lift("stamp", 0.03, 0.03),
            *met("stamp"),
        ),
    ),
}
