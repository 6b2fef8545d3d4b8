"""Prompts: the paper's parser rules with its fallback, and metadata by default."""

import pytest

from pipeline.annotate.model_stages import ask, caption, parse_instruction
from pipeline.annotate.stage import AnnotateError
from tests.synthetic import make_log, make_meta

LOG = make_log("aloha-agilex", 3, 15, 0)
OBJECTS = {
    "block": {"noun": "block", "description": "small Red block"},
    "hammer": {"noun": "hammer", "description": "steel hammer"},
}
META = make_meta(LOG, 15, [], target="block", manipulated="hammer", objects=OBJECTS)


@pytest.mark.parametrize(
    ("text", "phrase"),
    [
        ("Target: the red mug, then stop", "the red mug"),
        ("pick it up; the object is a blue bottle.", "a blue bottle"),
        ("goal = small box", "small box"),
        ('grab the "bell" and press the "alarm clock"', "alarm clock"),
        ("take 'the cup' now", "the cup"),
        ("move the bell's lid to the table's edge", "move the bell's lid to the table's edge"),
        ("targeting is hard", "targeting is hard"),
        ("  click the bell ", "click the bell"),
    ],
)
def test_rules_then_quotes_then_everything(text: str, phrase: str):
    assert parse_instruction(text) == phrase


def test_captions_are_lower_case_with_one_dot():
    assert caption("The Red Mug. ") == "the red mug."
    assert caption("bell") == "bell."


def test_metadata_names_target_and_manipulated_separately():
    asked = ask(META, "beat the block", ("target", "manipulated"), "metadata")
    assert asked.objects == ("block", "hammer")
    assert asked.prompts == ("block.", "hammer.")
    assert asked.roles == {"target": 0, "manipulated": 1}
    assert ask(META, "x", ("target",), "description").prompts == ("small red block.",)


def test_same_object_in_both_roles_is_asked_once():
    asked = ask(
        META.model_copy(update={"manipulated": "block"}),
        "x",
        ("target", "manipulated", "hammer"),
        "metadata",
    )
    assert asked.objects == ("block", "hammer")
    assert asked.roles == {"target": 0, "manipulated": 0}


def test_instruction_source_and_unknown_object():
    asked = ask(META, "Beat the block with the hammer", ("target",), "instruction")
    assert (asked.objects, asked.prompts) == (
        ("instruction",),
        ("beat the block with the hammer.",),
    )
    with pytest.raises(
        AnnotateError, match="no object 'cup' in this episode: it has block, hammer"
    ):
        ask(META, "x", ("cup",), "metadata")
