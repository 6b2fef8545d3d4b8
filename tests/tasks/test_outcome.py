"""Every question of `Outcome` against logs made by hand: once where the answer is yes, once where
it is no."""

import numpy as np
import pytest

from pipeline.data.episode.state_log import CONTACT_DTYPE, Event, StateLog
from pipeline.data.setup.rules import STRICT, Rules
from pipeline.poses import compose, pose, quat_about, yawed
from pipeline.tasks.outcome import Outcome, failed, within
from pipeline.world.objects import FAMILIES
from pipeline.world.physics.body import TABLE_TOP, Body
from pipeline.world.robots import get_embodiment

ROBOT = get_embodiment("aloha-agilex")
FINGERS = tuple(
    f"{side}_{f}" for side in ("left", "right") for f in ROBOT.arms[side].gripper.fingers
)
NAMES = ("can", "plate", *FINGERS, "left_link1", "table")
FRAMES = 10
ORIGIN = (0.0, 0.0, 0.0)
CAN, PLATE = (FAMILIES[f].draw(np.random.default_rng(0)) for f in ("can", "plate"))
BODIES = {
    "can": Body("can", "can", CAN, yawed((0.1, 0, TABLE_TOP), 0.3)),
    "plate": Body("plate", "plate", PLATE, yawed((0.2, 0.1, TABLE_TOP), 0)),
}


def outcome(
    can=None, contacts=(), gripper=(1.0, 1.0), events=(), command=None, rules=STRICT, plate=ORIGIN
):
    """An outcome of ten frames at 15 Hz. `can` (10,7) poses; contacts (frame, a, b, point); gripper
    (left, right) at the end; `command` (10,) of the left gripper, `plate` offsets (10,3) or (3,) of
    the plate."""
    poses = np.zeros((FRAMES, len(NAMES), 7))
    poses[..., 3] = 1
    poses[:, 0] = BODIES["can"].pose if can is None else can
    poses[:, 1] = BODIES["plate"].pose
    poses[:, 1, :3] += plate
    vector = ROBOT.vector_names
    state = np.zeros((FRAMES, len(vector)))
    state[-1, [vector.index("left_gripper"), vector.index("right_gripper")]] = gripper
    action = state.copy()
    if command is not None:
        action[:, vector.index("left_gripper")] = command
    rows = [
        (frame, *sorted((NAMES.index(a), NAMES.index(b))), 0.1, point, 1)
        for frame, a, b, point in contacts
    ]
    log = StateLog(
        times=np.arange(FRAMES) / 15,
        bodies=NAMES,
        poses=poses,
        joints=(),
        qpos=np.zeros((FRAMES, 0)),
        qvel=np.zeros((FRAMES, 0)),
        vector_names=vector,
        state=state,
        action=action,
        tcp=np.zeros((FRAMES, 2, 7)),
        target_velocity=np.zeros((FRAMES, 3)),
        contacts=np.array(rows, CONTACT_DTYPE),
        events=[Event(name, time) for name, time in events],
    )
    return Outcome(log, BODIES, ROBOT, "can", rules)


def path(*points, turn=None):
    """Poses (10,7) from x, y, z offsets, the last one kept; `turn` (10,) angles about x."""
    out = np.repeat(BODIES["can"].pose[None], FRAMES, 0)
    for frame, offset in enumerate(points):
        out[frame:, :3] = BODIES["can"].pose[:3] + offset
    if turn is not None:
        out[:, 3:] = [
            compose(p, pose((0, 0, 0), quat_about((1, 0, 0), a)))[3:]
            for p, a in zip(out, turn, strict=True)
        ]
    return out


def test_frames_ride_on_their_body():
    o = outcome(path((0, 0, 0), (0, 0, 0.1)))
    top = CAN.frames()["top"]
    for frame in (0, 1, -1):
        np.testing.assert_allclose(o.frame("can", "top", frame), compose(o.pose("can", frame), top))
    np.testing.assert_allclose(
        o.offset(o.frame("can", "top"), o.pose("can")), [0, 0, top[2]], atol=1e-12
    )
    with pytest.raises(KeyError, match="no frame"):
        o.frame("can", "lid")


def test_rise_is_measured_from_where_the_body_began():
    o = outcome(path((0, 0, 0.01), (0, 0, 0.31), (0, 0, 0.06)))
    assert o.rise("can") == pytest.approx(0.05)
    assert o.highest_rise("can") == pytest.approx(0.30)
    assert o.rise("plate") == o.highest_rise("plate") == 0


def test_the_rise_and_turn_of_a_target_count_from_the_last_frame_before_it_was_met():
    """It comes down a ramp and turns on the way; it is met between frames 4 and 5."""
    down = [(0, 0, height) for height in (0.30, 0.24, 0.18, 0.12, 0.06, 0.07, 0.16, 0.11)]
    turns = np.linspace(0, 0.9, FRAMES)
    o = outcome(path(*down, turn=turns), events=[("meeting", 4.5 / 15)])
    assert o.rise("can") == pytest.approx(0.05)
    assert o.highest_rise("can") == pytest.approx(0.10)
    assert o.turned("can") == pytest.approx(0.5)
    assert outcome(path(*down)).highest_rise("can") == pytest.approx(0.0)
    assert outcome(path(*down)).rise("can") == pytest.approx(-0.19)
    beside = np.zeros((FRAMES, 3))
    beside[5:, 2] = 0.04
    assert outcome(plate=beside, events=[("meeting", 7.5 / 15)]).rise("plate") == pytest.approx(
        0.04
    )


@pytest.mark.parametrize(
    ("tilt", "yes"), [(0.0, True), (0.25, True), (0.27, False), (-0.27, False), (np.pi, False)]
)
def test_upright(tilt, yes):
    assert outcome(path(turn=np.full(FRAMES, tilt))).upright("can") is yes


def test_turned_is_the_angle_from_first_to_last():
    assert outcome(path(turn=np.linspace(0, 0.8, FRAMES))).turned("can") == pytest.approx(0.8)
    assert outcome(path(turn=np.full(FRAMES, 0.8))).turned("can") == pytest.approx(0, abs=1e-6)


def test_at_rest_looks_at_the_last_three_intervals_only():
    early, late = np.zeros((FRAMES, 3)), np.zeros((FRAMES, 3))
    early[:7, 0] = 0.1 * np.arange(7)
    early[7:, 0] = early[6, 0]
    early[6] = early[7]
    late[7:, 0] = [0.004, 0.008, 0.012]  # 0.06 m/s
    assert outcome(path(*early)).at_rest("can")
    assert not outcome(path(*late)).at_rest("can")
    assert outcome(path(*late)).at_rest("can", speed=0.07)
    assert not outcome().until(3).at_rest("can")


def test_what_lies_on_a_target_that_still_moves_rests_relative_to_it():
    ride = np.linspace((0, 0, 0), (0.1, 0, 0), FRAMES)  # 0.17 m/s
    carried, left_behind = outcome(path(*ride), plate=ride), outcome(path(*ride))
    assert carried.at_rest("plate")
    assert not carried.at_rest("can"), "the target itself moves in the world"
    assert not left_behind.at_rest("plate")
    let_go = [("release", 0.1)]
    assert not outcome(path(*ride), plate=ride, events=let_go).at_rest("plate")
    assert outcome(path(*ride), events=let_go).at_rest("plate")


def test_openings_are_the_measured_ones():
    o = outcome(gripper=(0.3, 0.9))
    assert (o.opening("left"), o.opening("right")) == (0.3, 0.9)
    assert not o.grippers_open()
    assert (o.gripper_open("left"), o.gripper_open("right")) == (False, True)
    assert outcome(gripper=(0.81, 0.9)).grippers_open()


DOMINO = Rules("domino")


def test_domino_rules_look_at_the_commanded_opening():
    command = [1.0] * 8 + [0.1, 0.9]  # the last entry is for the interval after the last frame
    assert outcome(gripper=(0.9, 0.9), command=command).gripper_open("left")
    assert not outcome(gripper=(0.9, 0.9), command=command, rules=DOMINO).gripper_open("left")
    assert outcome(gripper=(0.1, 0.9), command=command, rules=DOMINO).until(9).gripper_open("left")


@pytest.mark.parametrize("rules", [STRICT, DOMINO])
def test_closing_on_something_is_a_command(rules):
    o = outcome(gripper=(0.5, 0.5), command=[1.0] * 8 + [0.1, 0.9], rules=rules)
    assert o.closes("left")
    assert not o.until(9).closes("left")
    assert not o.until(1).closes("left")


def test_one_finger_holds_under_domino_rules():
    one = [(9, FINGERS[1], "can", ORIGIN)]
    assert outcome(contacts=one, rules=DOMINO).holds("left", "can")
    assert not outcome(contacts=one).holds("left", "can")
    assert not outcome(rules=DOMINO).holds("left", "can")


def test_contacts_are_found_in_either_order_and_in_the_last_frames():
    o = outcome(contacts=[(2, "can", "plate", ORIGIN), (8, "table", "can", ORIGIN)])
    assert o.contacts("plate", "can")["frame"].tolist() == [2]
    assert o.contacts("can", "table")["frame"].tolist() == [8]
    assert o.touching("can", "table")
    assert not o.touching("can", "plate")
    assert o.touching("can", "plate", last=8)
    assert not outcome(contacts=[(7, "can", "plate", ORIGIN)]).touching("can", "plate")
    assert not o.touching("plate", "table")


def test_holding_takes_both_fingers_of_the_arm_now():
    left = [(9, f, "can", ORIGIN) for f in FINGERS[:2]]
    assert outcome(contacts=left).holds("left", "can")
    assert not outcome(contacts=left).holds("right", "can")
    assert not outcome(contacts=left[:1]).holds("left", "can")
    assert not outcome(contacts=[(5, f, "can", ORIGIN) for f in FINGERS[:2]]).holds("left", "can")
    assert outcome(contacts=[(8, FINGERS[0], "can", ORIGIN), (9, FINGERS[1], "can", ORIGIN)]).holds(
        "left", "can"
    )


def test_handled_is_any_link_of_any_arm():
    assert outcome(contacts=[(9, "left_link1", "can", ORIGIN)]).handled("can")
    assert not outcome(contacts=[(9, "plate", "can", ORIGIN), (9, "table", "can", ORIGIN)]).handled(
        "can"
    )
    assert not outcome(contacts=[(3, "left_link1", "can", ORIGIN)]).handled("can")


def test_resting_on_something_takes_touch_rest_and_no_hand():
    touch = [(9, "can", "plate", ORIGIN)]
    assert failed(outcome(contacts=touch).resting("can", "plate")) == ()
    assert failed(outcome(contacts=touch).resting("can", "table")) == ("on_table",)
    assert failed(
        outcome(contacts=[*touch, (9, FINGERS[0], "can", ORIGIN)]).resting("can", "plate")
    ) == ("released",)
    moving = path(*np.linspace((0, 0, 0), (0.1, 0, 0), FRAMES))
    assert failed(outcome(moving, contacts=touch).resting("can", "plate")) == ("at_rest",)
    assert failed(
        outcome(moving, contacts=[(9, FINGERS[0], "can", ORIGIN)]).resting("can", "plate")
    ) == ("on_plate", "at_rest", "released")


@pytest.mark.parametrize(
    ("values", "limits", "yes"),
    [
        (0.009, 0.01, True),
        (-0.011, 0.01, False),
        (0.01, 0.01, False),
        ((0.04, -0.01), (0.05, 0.02), True),
        ((0.04, -0.03), (0.05, 0.02), False),
        ((0.01, -0.03), 0.02, False),
        ((float("nan"), 0.0), 0.02, False),
    ],
)
def test_within_compares_every_magnitude(values, limits, yes):
    assert within(values, limits) is yes


@pytest.mark.parametrize(
    ("offset", "yes"),
    [
        ((0, 0, 0), True),
        ((0.019, -0.019, 0.009), True),
        ((0.021, 0, 0), False),
        ((0, 0.021, 0), False),
        ((0, 0, 0.011), False),
    ],
)
def test_pressed_measures_from_the_frame_where_the_body_was_then(offset, yes):
    moving = path(*np.linspace((0, 0, 0), (0.2, 0, 0), FRAMES))
    there = outcome(moving).frame("can", "top", 4)[:3] + offset
    o = outcome(moving, contacts=[(4, FINGERS[1], "can", there)])
    limit = {"plane": 0.02, "height": 0.01}
    assert o.press("left", "can", "top", limit)["pressed"] is yes
    assert not o.press("right", "can", "top", limit)["pressed"]
    assert o.touched("left", "can")
    assert not o.touched("right", "can")
    assert not o.until(4).touched("left", "can")


def test_a_press_counts_if_the_gripper_is_closed_at_the_touch():
    there, limit = outcome().frame("can", "top")[:3], {"plane": 0.02, "height": 0.01}
    closed_then = outcome(gripper=(0.0, 1.0), contacts=[(9, FINGERS[1], "can", there)])
    assert closed_then.press("left", "can", "top", limit)["closed_at_press"]
    opened_then = outcome(gripper=(0.0, 1.0), contacts=[(4, FINGERS[1], "can", there)])
    opened_then.log.state[4, ROBOT.vector_names.index("left_gripper")] = 1.0
    assert not opened_then.press("left", "can", "top", limit)["closed_at_press"]
    opened_later = outcome(gripper=(1.0, 1.0), contacts=[(4, FINGERS[1], "can", there)])
    assert opened_later.press("left", "can", "top", limit)["closed_at_press"]


def test_swings_count_only_crossings_between_far_sides():
    assert outcome(path(turn=[0, 0.6, 0, -0.6, 0, 0.6, 0.2, -0.6, 0, 0])).swings("can", 0.4) == 3
    assert outcome(path(turn=[0, 0.6, 0, 0.6, 0, 0.6, 0, 0.6, 0, 0])).swings("can", 0.4) == 0
    assert outcome(path(turn=[0, 0.3, 0, -0.3, 0, 0.3, 0, -0.3, 0, 0])).swings("can", 0.4) == 0
    assert outcome().swings("can", 0.4) == 0


def test_an_episode_can_be_cut():
    o = outcome(
        path((0, 0, 0), (0, 0, 0.1), (0, 0, 0.2)),
        contacts=[(1, "can", "plate", ORIGIN), (5, "can", "table", ORIGIN)],
        events=[("meeting", 1 / 15), ("release", 0.5)],
    )
    cut = o.until(2)
    assert len(cut.log) == 2
    assert cut.rise("can") == pytest.approx(0.1)
    assert cut.touching("can", "plate")
    assert not len(cut.contacts("can", "table"))
    assert [e.name for e in cut.log.events] == ["meeting"]
    assert o.until(FRAMES).rise("can") == o.rise("can")


def test_a_body_was_taken_where_all_fingers_of_one_hand_touched_it_at_once():
    left, other, right = FINGERS[0], FINGERS[1], FINGERS[2]
    once = outcome(contacts=[(3, left, "can", ORIGIN), (3, other, "can", ORIGIN)])
    assert once.first_held("can") == 3 and not once.took("plate") and not once.until(3).took("can")
    apart = [(3, left, "can", ORIGIN), (4, other, "can", ORIGIN), (3, right, "can", ORIGIN)]
    assert not outcome(contacts=apart).took("can")
