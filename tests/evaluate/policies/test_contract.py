"""What a policy was made for against what an evaluation gives: the first difference is named with
both values."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from pipeline.data.setup import Setup
from pipeline.evaluate.policies.contract import Contract, check_contract, mismatch
from pipeline.evaluate.policies.policy import PolicyError, Start

START = Start(
    "press the bell",
    "aloha-agilex",
    ("left_a", "left_gripper"),
    15,
    ("head_camera",),
    3,
    {"head_camera": (240, 320)},
)


def test_a_policy_without_wishes_fits_everything():
    assert mismatch(Contract(), START) == ""
    exact = Contract(("left_a", "left_gripper"), {"head_camera": (240, 320)}, 15, 50)
    assert mismatch(exact, START) == ""
    check_contract(SimpleNamespace(contract=exact), START)
    check_contract(SimpleNamespace(), START)


@pytest.mark.parametrize(
    ("wanted", "both"),
    [
        (
            Contract(action_names=("left_a", "right_gripper")),
            ("left_a right_gripper", "left_a left_gripper"),
        ),
        (
            Contract(action_names=("left_gripper", "left_a")),
            ("left_gripper left_a", "left_a left_gripper"),
        ),
        (Contract(image_sizes={"head_camera": (480, 640)}), ("640x480", "320x240")),
        (Contract(image_sizes={"left_camera": (240, 320)}), ("left_camera", "head_camera")),
        (Contract(rate=50), ("50 Hz", "15 Hz")),
        (Contract(chunk=5000), ("5000", "1000")),
    ],
)
def test_a_difference_is_one_line_with_both_values(wanted, both):
    reason = mismatch(wanted, START)
    assert all(value in reason for value in both)
    assert "\n" not in reason
    with pytest.raises(PolicyError) as error:
        check_contract(SimpleNamespace(contract=wanted), START)
    assert str(error.value) == reason


WRIST = {
    "name": "wrist",
    "link": "right_link6",
    "pose": (0, 0, 0, 1, 0, 0, 0),
    "width": 64,
    "height": 48,
    "fovy": 60,
}


@pytest.mark.parametrize(
    ("policy", "changes", "helps"),
    [
        ({"fps": 30}, {}, "--fps 30"),
        ({"size": [160, 120]}, {}, "--size 160x120"),
        (
            {"cameras": ["head_camera", "observer"]},
            {"cameras": ["head"]},
            "--cameras head_camera,observer_camera",
        ),
        ({"setup": Setup(camera="L515")}, {}, "--camera-type L515"),
        ({"setup": {"layout": "original"}}, {}, "--layout original"),
        ({"setup": Setup(depth=True)}, {}, "--depth, or --like"),
        ({"setup": {"cameras": [WRIST]}}, {"cameras": [WRIST | {"fovy": 40}]}, "--cameras wrist"),
        ({"fps": 7}, {}, "must be 5, 10"),
        ({"contract": {"rate": 15}}, {}, "contract is a dict: make it a"),
    ],
)
def test_a_policy_of_another_setup_is_refused_with_the_option_that_helps(policy, changes, helps):
    setup = Setup().override(changes)
    start = replace(START, setup=setup)
    with pytest.raises(PolicyError) as error:
        check_contract(SimpleNamespace(**policy), start)
    assert helps in str(error.value) and "\n" not in str(error.value)


def test_a_policy_of_the_same_setup_or_of_less_is_taken():
    start = replace(
        START,
        setup=Setup(
            fps=30, depth=True, cameras=("left", "head", "observer"), lead=1.0, rules="domino"
        ),
    )
    check_contract(SimpleNamespace(setup=start.setup, size="large", cameras=3), start)
    check_contract(SimpleNamespace(fps=30, cameras=["head_camera"], setup={"depth": False}), start)
