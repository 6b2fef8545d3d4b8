"""Instructions: true, well formed, varied and repeatable."""

import re
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.tasks import TASKS, Draw, lay_out
from pipeline.tasks.language.check import check_templates
from pipeline.tasks.language.sentences import Wording, instructions, sentence, slots
from pipeline.world.objects.contract import Words

BELL = Words("bell", ("red bell", "small bell", "desk bell"), ("round chime", "table bell"))
PLATE = Words("plate", ("white plate", "dish"), ("flat plate",))
SEEN = ("Press {bell} with {arm}.", "ring {bell}", "Move {bell} next to {plate}.")
UNSEEN = ("Tap {bell} using {arm}", "Sound {bell}!")
OBJECTS = {"bell": BELL, "plate": PLATE}


def make(
    count: int = 100, seed: int = 0, seen=SEEN, unseen=UNSEEN, objects=OBJECTS, arms=None
) -> dict[str, list[str]]:
    return instructions(
        Wording(seen, unseen, objects, arms or {"arm": "left"}), np.random.default_rng(seed), count
    )


def test_the_combinations_are_exactly_those_of_templates_and_words():
    expected = {f"Press the {b} with the left arm." for b in BELL.seen} | {
        f"Ring the {b}." for b in BELL.seen
    }
    expected |= {f"Move the {b} next to the {p}." for b in BELL.seen for p in PLATE.seen}
    drawn = make(count=12)
    assert len(drawn["seen"]) == 12 == len(expected) and set(drawn["seen"]) == expected
    assert set(drawn["unseen"]) == {f"Tap the {b} using the left arm." for b in BELL.unseen} | {
        f"Sound the {b}!" for b in BELL.unseen
    }


def test_templates_take_turns():
    first = [text.split()[0] for text in make(count=9)["seen"]]
    assert all(set(first[i : i + 3]) == {"Press", "Ring", "Move"} for i in (0, 3, 6))


@given(seed=st.integers(0, 2**32), count=st.integers(1, 60))
def test_any_draw_is_repeatable_of_the_right_length_and_never_repeats_at_once(seed, count):
    drawn = make(count, seed)
    assert drawn == make(count, seed)
    for texts in drawn.values():
        assert len(texts) == count
        assert all(a != b for a, b in pairwise(texts))
        assert all(re.fullmatch(r"[A-Z][^{}]*[.!?]", t) and "  " not in t for t in texts)


def test_seeds_differ():
    assert make(seed=0)["seen"] != make(seed=1)["seen"]


def test_roles_name_the_arms_that_act():
    drawn = make(
        4,
        seen=("Pass {bell} from {giver} to {receiver}.",),
        unseen=("Go.",),
        arms={"giver": "right", "receiver": "left"},
    )
    assert all(t.endswith("from the right arm to the left arm.") for t in drawn["seen"])
    assert drawn["unseen"] == ["Go."] * 4
    assert make(3, unseen=("Go.", "Go."))["unseen"] == ["Go."] * 3


def test_an_arm_named_outright_is_used_only_where_it_acts():
    seen = ("Ring {bell}.", "Ring {bell} with your left hand.")
    assert any("left hand" in t for t in make(seen=seen, arms={"arm": "left"})["seen"])
    assert not any("left hand" in t for t in make(seen=seen, arms={"arm": "right"})["seen"])
    with pytest.raises(ValueError, match="no seen template is true"):
        make(seen=seen[1:], arms={"arm": "right"})


def test_two_bodies_do_not_share_a_description_where_they_need_not():
    blocks = {n: Words("block", ("red block", "cube"), ("block",)) for n in ("upper", "lower")}
    drawn = make(
        10, seen=("Put {upper} on {lower}.",), unseen=("Stack {upper} on {lower}.",), objects=blocks
    )
    assert set(drawn["seen"]) == {
        "Put the red block on the cube.",
        "Put the cube on the red block.",
    }
    assert set(drawn["unseen"]) == {"Stack the block on the block."}  # nothing else can be said


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"seen": ("Ring {gong}.",)}, r"Ring \{gong\}.*\{gong\}: there are arm, bell, plate"),
        ({"seen": ("Ring {bell.",)}, "malformed"),
        ({"seen": ("Ring {}.",)}, "not a plain name"),
        ({"objects": {"bell": Words("bell", (), ("x",)), "plate": PLATE}}, "no description"),
        ({"unseen": ()}, "no unseen template"),
    ],
)
def test_bad_input_is_named(change, message):
    with pytest.raises(ValueError, match=message):
        make(**change)


@pytest.mark.parametrize(
    ("seen", "unseen", "message"),
    [
        (("Ring {gong}.",), ("Go.",), r"unknown slot \{gong\}"),
        (("Ring {bell}.", "ring {bell}"), ("Go.",), "given twice"),
        (("Ring {bell}.",), ("Ring {bell}!",), "given twice"),
        (("Ring the {bell}.",), ("Go.",), "article"),
        (("Take {bell} and ring {bell}.",), ("Go.",), r"slot \{bell\} twice"),
        (("Ring {bell} while it moves.",), ("Go.",), "motion without the mark"),
        (("Ring {bell:moving}.",), ("Go.",), "motion without the mark"),
        (("~ Ring {bell}.",), ("Go.",), "has the mark and does not"),
        (("Take {bell} with {arm} and ring it with a finger.",), ("Go.",), "in one clause"),
        (("Stop at {bell}'s side.",), ("Go.",), r"possessive of \{bell\}"),
        (("Ring {bell!r}.",), ("Go.",), "not a plain name"),
        ((), ("Go.",), "no seen templates"),
    ],
)
def test_faults_of_templates_are_found(seen, unseen, message):
    with pytest.raises(ValueError, match=message):
        check_templates(seen, unseen, {"bell"}, {"arm"})


def test_all_faults_are_listed_at_once():
    with pytest.raises(ValueError, match=r"no unseen templates; .*\{gong\}; .*article"):
        check_templates(("Ring {gong}.", "Ring the {bell}."), (), {"bell"}, ())


def test_a_choice_is_a_bare_word_in_every_sentence():
    words = Wording(
        ("Press the {choice} one of {bell}.",),
        ("Tap the {choice} one.",),
        OBJECTS,
        {},
        choices={"choice": "green"},
    )
    drawn = instructions(words, np.random.default_rng(0), 12)
    assert {text.split(" one")[0] for text in drawn["seen"]} == {"Press the green"}
    assert set(drawn["unseen"]) == {"Tap the green one."}
    check_templates(words.seen, words.unseen, OBJECTS, (), words.choices)
    with pytest.raises(ValueError, match="article"):
        check_templates(words.seen, words.unseen, {*OBJECTS, "choice"}, ())


def test_an_adjective_goes_before_the_description_but_not_before_one_of_size():
    drawn = make(20, seen=("~ Press {bell:moving}.",), unseen=("Go.",))
    assert set(drawn["seen"]) == {"Press the moving red bell.", "Press the moving desk bell."}
    only_small = {"bell": Words("bell", ("small bell",), ("bell",))}
    assert set(
        make(5, seen=("~ Press {bell:moving}.",), unseen=("Go.",), objects=only_small)["seen"]
    ) == {"Press the moving small bell."}
    with pytest.raises(ValueError, match="not a plain name"):
        slots("Press {bell:>8}.")


def test_a_description_does_not_repeat_a_noun_of_the_template_where_it_need_not():
    objects = {
        "bell": Words(
            "bell",
            ("bell with a red button", "bell with red handles", "bell"),
            ("bell with a red button",),
        )
    }
    seen, unseen = (
        ("Press the button of {bell}.", "Take {bell} by its handle."),
        ("Push the button of {bell}.",),
    )
    drawn = make(20, seen=seen, unseen=unseen, objects=objects)
    assert set(drawn["seen"]) == {
        "Press the button of the bell.",
        "Press the button of the bell with red handles.",
        "Take the bell by its handle.",
        "Take the bell with a red button by its handle.",
    }
    # nothing else can be said
    assert set(drawn["unseen"]) == {"Push the button of the bell with a red button."}


def test_a_clause_has_one_phrase_with_with_where_it_can():
    objects = {"bell": Words("bell", ("bell with a knob", "red bell"), ("bell",)), "plate": PLATE}
    drawn = make(
        20, seen=("Take {bell} with {arm}, and ring {plate}.", "Lift {bell}."), objects=objects
    )
    assert "Lift the bell with a knob." in drawn["seen"]
    assert not [t for t in drawn["seen"] if "knob with" in t]


def test_a_template_with_two_roles_needs_two_arms():
    seen = ("Take {bell} with {arm}; {other} rings it.", "Ring {bell}.")
    both = make(30, seen=seen, arms={"arm": "right", "other": "left"})["seen"]
    one = make(30, seen=seen, arms={"arm": "left", "other": "left"})["seen"]
    assert any("left arm rings" in t for t in both)
    assert not any("arm" in t for t in one)


def test_good_templates_pass():
    check_templates(SEEN, UNSEEN, OBJECTS, {"arm"})


def test_slots_come_once_in_order():
    assert slots("Put {b} on {a}, then lift {b} with {arm}.") == ("b", "a", "arm")


def test_templates_of_motion_are_for_moving_targets_only():
    objects = {"bell": BELL}
    for moving, expected in ((True, 2), (False, 1)):
        wording = Wording(
            ("Press {bell}.", "~ Press {bell} while it moves."),
            ("Tap {bell}.",),
            objects,
            {},
            moving,
        )
        drawn = instructions(wording, np.random.default_rng(0), 50)
        assert (
            len({t.replace(b, "") for t in drawn["seen"] for b in BELL.seen if b in t}) == expected
        )
        assert not any("~" in t for t in drawn["seen"])
    with pytest.raises(ValueError, match="true of this scene"):
        instructions(
            Wording(("~ Catch {bell}.",), ("Tap {bell}.",), objects, {}, moving=False),
            np.random.default_rng(0),
            5,
        )


def test_sentences():
    assert sentence("  take it.  then  go ") == "Take it. Then go."
    assert sentence("really?") == "Really?"
    assert sentence("move 0.5 cm") == "Move 0.5 cm."


@pytest.mark.parametrize("name", sorted(TASKS))
def test_the_templates_of_every_task(name):
    task = TASKS[name]
    rng = np.random.default_rng(0)
    bodies = lay_out(task, Draw(rng, rng))
    arms = task.arms(bodies)
    choices = task.choices(bodies)
    check_templates(task.seen, task.unseen, bodies, arms, choices)
    words = {n: b.instance.words() for n, b in bodies.items()}
    wording = Wording(task.seen, task.unseen, words, arms, choices=choices)
    drawn = instructions(wording, rng, 200)
    assert not set(drawn["seen"]) & set(drawn["unseen"])
