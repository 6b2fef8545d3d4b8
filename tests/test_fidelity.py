"""The page that sets our tasks beside the original's is up to date, and what it claims of the rules
is so."""

import csv
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from benchmarks.beside_original import (
    conditions,
    extents,
    layouts,
    moved,
    original,
    originals,
    reasons,
    visible_range,
)
from benchmarks.fidelity import PAGE, PAPER, is_written, page
from pipeline.tasks import TASKS

EVERY = pytest.mark.parametrize("name", PAPER)
AT_LEAST = {
    "out",
    "cap",
    "lift",
    "rise",
    "head",
    "hole",
    "strike_height",
    "least",
    "least_rise",
    "near",
}
"""Limits that a value must be over."""

OTHER_FLOOR = ("put_bottles_dustbin", "least")
"""The original's bin has its floor higher up: its lower end would refuse what lies in ours, which
the outline tells instead."""


def test_the_page_is_up_to_date():
    old = PAGE.read_text()
    assert is_written(PAGE, page(old)), "run python -m benchmarks.fidelity"


def test_every_task_is_there():
    assert set(original()) == set(PAPER)
    full = 0
    for table in (PAGE.parent / "tables").glob("fidelity_*.csv"):
        with table.open() as file:
            header, *rows = csv.reader(file)
        if header[0] == "task":
            full += 1
            assert [row[0] for row in rows] == list(PAPER), table.name
    assert full == 5


def test_regions_that_differ_have_a_reason_and_no_other_does():
    assert {name for name in PAPER if moved(name)} == set(reasons())


@EVERY
def test_what_moves_and_for_how_long_is_the_original_s(name):
    task, facts = TASKS[name], original()[name]
    assert task.category == facts["category"]
    assert task.step_limit == facts["step_limit"]
    bodies = {p.name for layout in layouts(name) for p in layout}
    assert set(facts["bodies"]) <= bodies
    assert set(originals(name)) == set(extents(name))


@EVERY
def test_domino_limits_and_sizes_are_those_of_the_dynamic_version(name):
    task, facts = TASKS[name], original()[name]
    for limit, value in facts["limits"]["dynamic"].items():
        if (name, limit) == OTHER_FLOOR:
            continue
        found = task.limits[limit]
        assert (found.strict if found.domino is None else found.domino) == value, limit
    for body, size in task.sizes.items():
        half = facts["bodies"][body]["half"]
        assert list(size.domino) == half["dynamic"]
        assert size.strict is None or list(size.strict) == half["static"]
        for layout in layouts(name, "domino"):
            pad = next(p.instance for p in layout if p.name == body)
            assert [pad.hx, pad.hy] == half["dynamic"]


@EVERY
def test_strict_limits_are_no_looser_than_those_of_the_dynamic_version(name):
    for limit, value in original()[name]["limits"]["dynamic"].items():
        if (name, limit) == OTHER_FLOOR:
            continue
        strict = TASKS[name].limits[limit].strict
        assert strict >= value if limit in AT_LEAST else strict <= value, limit


@EVERY
def test_strict_rules_ask_for_everything_that_domino_rules_ask_for(name):
    both, own = conditions(name)
    assert both
    assert not set(both) & set(own)
    assert set(TASKS[name].own_conditions) & set(both) == set()


@EVERY
def test_rules_change_sizes_and_nothing_else_of_a_layout(name):
    for strict, domino in zip(layouts(name), layouts(name, "domino"), strict=True):
        assert [(p.name, p.fixed, p.gap, p.inside) for p in strict] == [
            (p.name, p.fixed, p.gap, p.inside) for p in domino
        ]
        for ours, theirs in zip(strict, domino, strict=True):
            assert type(ours.instance) is type(theirs.instance)
            assert ours.region == theirs.region
            if ours.name not in TASKS[name].sizes:
                assert ours.instance == theirs.instance


def test_extents_take_both_sides_together():
    mouse = extents("place_mouse_pad")["mouse"]
    assert mouse.x == (-0.25, 0.25)
    assert mouse.away == 0.05
    assert mouse.y == (-0.20, 0.0)
    assert mouse.yaw == pytest.approx(3.14, abs=0.002)
    turned = extents("rotate_qrcode")["sign"]
    assert turned.yaw == pytest.approx(0.7)
    assert all(a.differs(b) is (a != b) for a, b in pairwise([mouse, mouse, turned]))


def test_a_yaw_of_either_width_is_a_difference_but_for_bodies_of_revolution():
    sign = extents("rotate_qrcode")["sign"]
    for yaw in (0.0, sign.yaw + 0.1):
        assert sign.differs(replace(sign, yaw=yaw))
        assert replace(sign, yaw=yaw).differs(sign)
        assert not replace(sign, turns=0).differs(replace(sign, yaw=yaw))
    turned = {(name, body) for name in PAPER for body, e in extents(name).items() if not e.turns}
    assert ("place_can_basket", "can") in turned
    assert not turned & {
        ("place_fan", "fan"),
        ("stamp_seal", "stamp"),
        ("handover_mic", "microphone"),
    }


def test_headings_are_compared_over_the_whole_turn_as_far_as_the_body_shows_them():
    bottle, pad, scanner = (
        extents("adjust_bottle")["bottle"],
        extents("place_mouse_pad")["pad"],
        extents("scan_object")["scanner"],
    )
    assert (bottle.turns, pad.turns, scanner.turns) == (1, 2, 1)
    assert str(bottle).endswith("yaw ±0.40 about 0.00 and 3.14")
    mirrored = replace(scanner, headings=(-np.pi / 2, np.pi / 2))
    assert len(scanner.headings) == 1
    assert mirrored.differs(scanner)
    assert scanner.differs(mirrored)
    assert not replace(scanner, headings=(0.0,)).differs(scanner), (
        "which way the original's meshes face at yaw 0 is not known"
    )
    assert mirrored.differs(replace(mirrored, headings=(0.0, np.pi / 2)))
    assert not replace(pad, headings=(0.0, np.pi)).differs(replace(pad, headings=(0.0, 0.0)))


def test_a_least_distance_is_a_difference():
    can = extents("move_can_pot")["can"]
    assert can.least == (("pot", 0.3),)
    assert can.differs(replace(can, least=()))


def test_a_region_that_the_image_cuts_is_told_by_side():
    low, high = visible_range("put_object_cabinet") or (0, 0)
    assert low < -0.30
    assert 0.24 < high < 0.28
    assert visible_range("place_mouse_pad") is None
