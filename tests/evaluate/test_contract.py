"""What a policy was made for against what an evaluation gives: the first difference is named with both values."""

from types import SimpleNamespace

import pytest

from pipeline.evaluate.contract import Contract, check_contract, mismatch, served
from pipeline.evaluate.policy import PolicyError, Start

START = Start("press the bell", "aloha-agilex", ("left_a", "left_gripper"), 15, ("head_camera",), 3, {"head_camera": (240, 320)})


def test_a_policy_without_wishes_fits_everything():
    assert mismatch(Contract(), served(START)) == ""
    exact = Contract(("left_a", "left_gripper"), {"head_camera": (240, 320)}, 15, 50)
    assert mismatch(exact, served(START)) == ""
    check_contract(SimpleNamespace(contract=exact), START)
    check_contract(SimpleNamespace(), START)


@pytest.mark.parametrize(
    ("wanted", "both"),
    [
        (Contract(action_names=("left_a", "right_gripper")), ("left_a right_gripper", "left_a left_gripper")),
        (Contract(action_names=("left_gripper", "left_a")), ("left_gripper left_a", "left_a left_gripper")),
        (Contract(image_sizes={"head_camera": (480, 640)}), ("480x640", "240x320")),
        (Contract(image_sizes={"left_camera": (240, 320)}), ("left_camera", "head_camera")),
        (Contract(rate=50), ("50 Hz", "15 Hz")),
        (Contract(chunk=5000), ("5000", "1000")),
        (Contract(normalization="evaluator"), ("to the evaluator", "to the policy")),
    ],
)
def test_a_difference_is_one_line_with_both_values(wanted, both):
    reason = mismatch(wanted, served(START))
    assert all(value in reason for value in both)
    assert "\n" not in reason
    with pytest.raises(PolicyError) as error:
        check_contract(SimpleNamespace(contract=wanted), START)
    assert str(error.value) == reason
