"""How a total is spread over cells, and which cells share their scenes."""

import itertools
from fractions import Fraction
from math import ceil, floor

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.data.intact import count_pairs
from pipeline.data.recipe.cells import Cell, Slot, evenly, largest_remainder, spread
from pipeline.data.recipe.growth import differences, left_out
from pipeline.data.recipe.model import RecipeError
from pipeline.data.spec import EpisodeSpec
from pipeline.run.names import recipe_from

WEIGHTS = st.lists(st.integers(1, 300), min_size=1, max_size=7)
TASKS = ["click_bell", "grab_roller", "press_stapler", "shake_bottle", "stamp_seal"]


@given(WEIGHTS, st.integers(0, 5000))
def test_largest_remainder_as_defined_with_fractions(weights, total):
    shares = [Fraction(total * weight, sum(weights)) for weight in weights]
    counts = largest_remainder(weights, total)
    assert sum(counts) == total
    assert all(
        floor(share) <= count <= ceil(share) for share, count in zip(shares, counts, strict=True)
    )
    # nobody who got nothing more has a larger remainder than one who did
    left = {True: [Fraction(-1)], False: [Fraction(-1)]}
    for share, count in zip(shares, counts, strict=True):
        left[count > floor(share)].append(share - floor(share))
    assert len(left[True]) == 1 or min(left[True][1:]) >= max(left[False])


@given(st.integers(1, 60), st.integers(1, 300), st.integers(0, 300), st.integers(0, 3000))
def test_a_total_is_met_within_one_of_every_share_and_only_grows(places, clean, randomized, total):
    weights = {
        Cell(f"t{i}", "e", 1, 0.1, domain): weight
        for i in range(places)
        for domain, weight in (("clean", clean), ("randomized", randomized))
    }
    counts, more = spread(weights, total), spread(weights, total + 1)
    assert sum(counts.values()) == total and list(counts) == list(weights)
    for cell, weight in weights.items():
        share = Fraction(total * weight, sum(weights.values()))
        assert floor(share) <= counts[cell] <= ceil(share)
    assert sorted(more[cell] - counts[cell] for cell in counts) == [0] * (len(counts) - 1) + [1]


@given(st.integers(1, 400), st.integers(0, 2000))
def test_what_is_left_lies_evenly_among_the_places(places, total):
    counts = evenly(places, total)
    assert sum(counts) == total and max(counts) - min(counts) <= 1
    chosen = [i for i, count in enumerate(counts) if count > min(counts)]
    gaps = {b - a for a, b in itertools.pairwise(chosen)}
    # three-distance theorem: the largest is the sum of the other two
    assert len(gaps) <= 3
    if len(gaps) == 3:
        low, middle, high = sorted(gaps)
        assert high == low + middle


def test_a_recipe_may_name_its_total():
    recipe = recipe_from(
        {
            **{"tasks": TASKS, "levels": [0, 1, 2, 3], "domains": ["clean", "randomized"]},
            **{
                "episodes": {"clean": 1, "randomized": 4},
                "total": 1003,
                "variants": 2,
                "visuals": "randomized",
            },
        }
    )
    slots = list(recipe.physical_slots())
    assert len(slots) == 1003 and len(list(recipe.slots())) == 2006
    # 1003 / 5 = 200.6 and 802.4: the clean ones have the larger remainder
    assert sum(slot.cell.domain == "clean" for slot in slots) == 201
    for cell, count in recipe.counts().items():
        assert [s.index for s in slots if s.cell == cell] == list(range(count))
    larger = recipe.model_copy(update={"total": 1500})
    assert not differences(recipe, larger) and not left_out(recipe, larger)
    assert left_out(larger, recipe) == ["60 episodes a cell"]
    assert set(slots) < set(larger.physical_slots())
    # more tasks for the same total are fewer episodes of each
    assert left_out(recipe, recipe.model_copy(update={"tasks": (*recipe.tasks, "place_shoe")}))


def test_paired_cells_try_the_same_scenes():
    wanted = {
        "tasks": TASKS[:2],
        "levels": [0, 1, 3],
        "domains": ["clean", "randomized"],
        "alpha": [0.1, 0.2],
        "episodes": 2,
    }
    recipe = recipe_from(wanted | {"paired": ["levels", "alpha"]})
    seeds: dict = {}
    for slot in recipe.physical_slots():
        spec = recipe.spec(slot, 1)
        seeds.setdefault((slot.cell.task, slot.cell.domain, slot.index), set()).add(
            (spec.seed, spec.slot_seed)
        )
    assert len(seeds) == 2 * 2 * 2 and all(len(same) == 1 for same in seeds.values())
    assert len({next(iter(same)) for same in seeds.values()}) == 8
    unpaired = recipe_from(wanted)
    assert len({unpaired.spec(slot, 1).seed for slot in unpaired.physical_slots()}) == 2 * 2 * 2 * 5
    # a level more changes no scene of the others
    fewer = recipe_from(wanted | {"paired": ["levels", "alpha"], "levels": [1]})
    assert all(fewer.spec(slot, 0) == recipe.spec(slot, 0) for slot in fewer.physical_slots())
    assert not differences(fewer, recipe) and not left_out(fewer, recipe)
    assert recipe_from(wanted | {"paired": ["alpha", "levels"]}) == recipe
    assert differences(unpaired, recipe) == ["paired is [] there, not ['levels', 'alpha']"]


def test_a_scene_is_complete_where_every_cell_accepted_it():
    recipe = recipe_from(
        {"tasks": "click_bell", "levels": [1, 2], "episodes": 3, "paired": ["levels"]}
    )
    slots = list(recipe.physical_slots())
    seeds: dict[Slot, int | None] = {slot: recipe.spec(slot, 0).seed for slot in slots}
    assert [*count_pairs(recipe, seeds).values()] == [3, 3, 3]
    seeds[slots[0]] = recipe.spec(slots[0], 1).seed
    seeds[slots[2]] = None
    seeds[slots[3]] = None
    assert [*count_pairs(recipe, seeds).values()] == [3, 3, 1]
    del seeds[slots[5]]
    assert [*count_pairs(recipe, seeds).values()] == [3, 2, 0]


@pytest.mark.parametrize(
    "paired", [["levels"], ["domains"], ["alpha"], ["levels", "domains", "alpha"]]
)
def test_cells_share_scenes_where_they_differ_in_nothing_else(paired):
    keys = {"levels": "level", "domains": "domain", "alpha": "alpha"}
    cells = [
        Cell(t, "e", n, a, d)
        for t in "st"
        for n in (1, 2)
        for a in (0.05, 0.1)
        for d in ("clean", "randomized")
    ]
    for a in cells:
        for b in cells:
            differ = {key for key, name in keys.items() if getattr(a, name) != getattr(b, name)}
            assert (a.scenes(paired) == b.scenes(paired)) == (
                a.task == b.task and differ <= set(paired)
            )


def test_seeds_of_recipes_that_pair_nothing_stay_what_they_were():
    recipe = recipe_from(
        {"tasks": "click_bell", "levels": [1], "alpha": [0.1, 0.2], "episodes": 1, "seed": 3}
    )
    first, second = recipe.physical_slots()
    assert (recipe.spec(first, 0).seed, recipe.spec(first, 2).slot_seed) == (FIRST, SHARED)
    assert recipe.spec(second, 0).seed == SECOND


FIRST, SHARED, SECOND = 2843299916294182776, 2209047519188021894, 2492708319668480249
"""As version 0.1 drew them."""


def test_conditions_are_arms_of_one_scene_and_cells_multiply():
    wanted = {"tasks": "click_bell", "levels": 1, "episodes": 8}
    wanted |= {"events": ["stop@0.5", "push@0.8"]}
    recipe = recipe_from(wanted | {"paired": ["conditions"]})
    specs = [recipe.spec(slot, 1) for slot in recipe.physical_slots()]
    assert [spec.arm for spec in specs] == ["00", "01", "10", "11"] * 2
    assert len({spec.seed for spec in specs[:4]}) == len({spec.pair for spec in specs[:4]}) == 1
    assert specs[0].pair != specs[4].pair
    seeds = {slot: recipe.spec(slot, 1).seed for slot in recipe.physical_slots()}
    assert count_pairs(recipe, seeds) == {"scenes": 2, "finished": 2, "complete": 2}
    first = [spec.rng("placement").random() for spec in specs]
    assert first == [first[0]] * 4 + [first[4]] * 4 and first[0] != first[4]
    withheld = [[spec.withholds(n) for n in (0, 1)] for spec in specs[:4]]
    assert withheld == [[True, True], [True, False], [False, True], [False, False]]
    assert all(EpisodeSpec.from_json(spec.to_json()) == spec for spec in specs)
    for bad in ({"episodes": 6}, {"events": []}, {"paired": ["conditions", "events"]}):
        with pytest.raises(RecipeError, match="paired: "):
            recipe_from(wanted | {"paired": ["conditions"]} | bad)
