"""Faults of instructions: each is found where it was put, and none is in what the tasks say."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from pipeline.tasks import TASKS
from pipeline.tasks.contract import Draw
from pipeline.tasks.language.sentences import Wording, instructions
from pipeline.tasks.layout import lay_out
from pipeline.world.objects.contract import Words
from tests.tasks.language.grammar import CHECKS, GRAMMAR, faults

CUP = Words("cup", ("cup", "red cup", "cup with an orange stripe"), ("tumbler",))
BASKET = Words("bread basket", ("bread basket", "basket with a brown handle"), ("wicker tray",))
BREAD = Words("bread", ("bread", "bun"), ("loaf",))
SCENE = Wording(
    (), (), {"cup": CUP, "basket": BASKET, "bread": BREAD}, {"arm": "left", "other": "right"}
)
STILL = replace(SCENE, moving=False)
ONE_ARM = replace(SCENE, arms={"arm": "left"})


FAULTY = [
    ("Take {cup}.", SCENE, "slot leak"),
    ("Take the cup  now.", SCENE, "slot leak"),
    ("Take the cup , now.", SCENE, "slot leak"),
    ("Take the cup;, now.", SCENE, "slot leak"),
    ("~ Take the cup.", SCENE, "slot leak"),
    ("take the cup.", SCENE, "start or end"),
    ("Take the cup", SCENE, "start or end"),
    ("Take the cup,", SCENE, "start or end"),
    ("Take the cup. lift it.", SCENE, "start or end"),
    ("Take the cup with a orange stripe.", SCENE, "article"),
    ("Take an cup.", SCENE, "article"),
    ("Take the a cup.", SCENE, "article"),
    ("Take the the cup.", SCENE, "word twice running"),
    ("Put the cup and and the bun there.", SCENE, "word twice running"),
    ("Take the red cup and lift the cup.", SCENE, "repeated noun"),
    ("Take the basket with a brown handle by its handle.", SCENE, "repeated noun"),
    ("Let the left arm take the cup and the left arm lift it.", SCENE, "repeated noun"),
    ("Take the cup and lift them.", SCENE, "number"),
    ("When the cup stand there, let go.", SCENE, "number"),
    ("The red cup are empty; take it.", SCENE, "number"),
    ("Let the cup stands there.", SCENE, "number"),
    ("Tip it until the balls falls out.", SCENE, "number"),
    ("Lift the cup while the left arm hold the bun.", SCENE, "number"),
    ("Take the cup while it moves.", STILL, "motion at level 0"),
    ("Catch the cup.", STILL, "motion at level 0"),
    ("Take the sliding cup.", STILL, "motion at level 0"),
    ("Wait for the cup to come and take it.", STILL, "motion at level 0"),
    ("Take the cup with the right arm.", ONE_ARM, "arm"),
    ("I need the cup: pick up it.", SCENE, "verb"),
    ("Remove the bun off the table.", SCENE, "verb"),
    ("Take the cup with your right hand.", ONE_ARM, "arm"),
    ("Hand the cup to the other arm.", ONE_ARM, "arm"),
    ("Take the cup with both hands.", ONE_ARM, "arm"),
    ("Put the cup in the bread basket with the left arm.", SCENE, "attachment"),
    ("Place the cup beside the bun using the left arm.", SCENE, "attachment"),
    ("Take the cup with an orange stripe with the left arm.", SCENE, "attachment"),
    ("Put the cup with an orange stripe on it.", SCENE, "attachment"),
    ("Put the bun in the basket with a brown handle of the shop.", SCENE, "attachment"),
    ("Close the left arm on the cup.", SCENE, "vague"),
    ("Take the cup in the left arm.", SCENE, "vague"),
    ("The left arm is to lift the cup.", SCENE, "vague"),
    ("Set the cup down in the middle, then lift it.", SCENE, "vague"),
    ("Take the cup and the bun and bring them together.", SCENE, "vague"),
    ("Take the cup and the bun and lay the one in the other.", SCENE, "vague"),
    ("Put the bun in the basket and lift by the handle.", SCENE, "vague"),
]


@pytest.mark.parametrize(("text", "scene", "fault"), FAULTY)
def test_a_fault_is_found(text, scene, fault):
    assert fault in faults(text, scene)


def test_every_check_has_a_sentence_that_fails_it():
    assert {fault for _, _, fault in FAULTY} == {*CHECKS, *GRAMMAR}


@pytest.mark.parametrize(
    "text",
    [
        "Put the loaf in the bread basket.",
        "With the left arm, put the bun in the basket with a brown handle.",
        "Let the cup stand on the table once the left arm holds the bun.",
        "Take the cup and the bun and hold them over the middle of the table.",
        "Let the left arm lift the basket with a brown handle off the table.",
        "Catch the moving cup with the left arm and hand it to the right arm.",
        "Take the cup with an orange stripe, and hold it with both arms.",
    ],
)
def test_good_sentences_pass(text):
    assert faults(text, SCENE) == []


def wording(name: str, seed: int, moving: bool) -> Wording:
    """What the instructions of one layout of a task are made from; `moving` as at levels above
    0."""
    task = TASKS[name]
    bodies = lay_out(task, Draw(np.random.default_rng([seed, 0]), np.random.default_rng([seed, 1])))
    words = {body.name: body.instance.words() for body in bodies.values()}
    return Wording(task.seen, task.unseen, words, task.arms(bodies), moving, task.choices(bodies))


def test_thousands_of_instructions_have_no_fault():
    checked, wrong = 0, []
    for name, moving in product(sorted(TASKS), (False, True)):
        scene = wording(name, 11, moving)
        for texts in instructions(scene, np.random.default_rng(0), 24).values():
            checked += len(texts)
            wrong += [(name, text, found) for text in texts if (found := faults(text, scene))]
    assert checked >= 3_000
    assert wrong == []
