"""Events of recipes: how they are written, drawn, and kept in specs."""

import numpy as np
import pytest

from pipeline.data.episode.events import EventSpec, When, draw_events, spans
from pipeline.data.episode.state_log import Event
from pipeline.data.recipe.model import Recipe, parse_recipe
from pipeline.data.setup import RecipeError, Setup
from pipeline.data.spec import EpisodeSpec


@pytest.mark.parametrize(
    ("text", "when"),
    [
        ("stop@0.8", When(time=0.8)),
        ("stop@share=0.6", When(share=0.6)),
        ("stop@distance=0.2", When(distance=0.2)),
        ("stop@near", When(phase="near")),
        ("stop@meeting", When(meeting=0.0)),
        ("stop", When(share=0.6)),
    ],
)
def test_one_word_is_an_event(text, when):
    assert EventSpec.model_validate(text) == EventSpec(kind="stop", when=when)
    setup = Setup.parse({"events": text})
    assert Setup.parse(setup.given()) == setup
    assert setup.calm == Setup() == Setup.parse({"events": ["none"]})


@pytest.mark.parametrize(
    "wrong",
    [
        "explode@1",
        "stop@never",
        {"kind": "stop", "when": {"time": 1, "share": 0.5}},
        {"kind": "stop", "when": {"time": [2.0, 1.0]}},
        {"kind": "stop", "when": {"time": -1.0}},
        {"kind": "stop", "cause": 1},
        {"kind": "stop", "when": {"after": 0.3}},
        {"kind": "stop", "cameras": ["head"]},
        {"kind": "stop", "amount": 1.0},
        {"kind": "light", "amount": 1.5},
        {"kind": "swap", "lasts": 1.0},
        "instruction@meeting",
        "instruction@after",
    ],
)
def test_other_words_are_refused_in_one_line(wrong):
    with pytest.raises(RecipeError, match="events") as refused:
        Setup.parse({"events": [wrong]})
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ("stopp@0.5", "must be one of stop, reverse, .*, latency"),
        ("stop@", "is not written as KIND@WHEN"),
        ("stop@nan", "time must be 0 to 60"),
        ("stop@inf", "time must be 0 to 60"),
        ("stop@-1", "time must be 0 to 60"),
        ("stop@1e9", "time must be 0 to 60"),
        ("stop@share=1.5", "share must be 0 to 1 "),
        ("stop@distance=-1", "distance must be 0.01 to 2"),
        ("stop@foo=1", "time, share, distance, meeting, after"),
        ({"kind": "speed", "amount": 1000}, "amount must be 0 to 100"),
        ({"kind": "stop", "lasts": 0}, "lasts must be 0.01 to 60"),
    ],
)
def test_a_number_out_of_range_and_a_wrong_word_are_named(wrong, said):
    with pytest.raises(RecipeError, match=said):
        Setup.parse({"events": ["push@1", wrong]}, flags={"events": "--events"})


def test_ranges_are_drawn_and_no_event_shifts_another():
    wide = EventSpec.model_validate({"kind": "push", "when": {"time": [0.5, 1.0]}})
    stop = EventSpec.model_validate("stop@1")

    def draw(*specs):
        return draw_events(specs, np.random.default_rng(7), np.random.default_rng(8))

    assert 0.5 < draw(wide)[0].value < 1.0
    assert draw(stop, wide)[1].value == draw(wide, wide)[1].value
    assert [e.name for e in draw(wide, wide, stop)] == ["push", "push2", "stop"]
    one = EventSpec.model_validate({"kind": ["stop", "push", "light"], "when": {"time": 1.0}})
    kinds = {
        draw_events([one], np.random.default_rng(0), np.random.default_rng(n))[0].kind
        for n in range(20)
    }
    assert kinds == {"stop", "push", "light"}
    log = [Event("event", 1.0, "push"), Event("event_end", 2.0, "push")]
    (span,) = spans(draw(wide, stop), log)
    assert span.holds(np.array([1.0, 1.1, 2.0, 2.1])).tolist() == [False, True, True, False]


def test_arms_of_a_pair_share_all_draws_and_an_id():
    recipe = Recipe(
        tasks=("click_bell",), levels=(1,), paired=("events",), events=("stop@1",), episodes=4
    )
    first, second, third = (recipe.spec(slot, 0) for slot in list(recipe.slots())[:3])
    assert (first.arm, second.arm) == ("event", "control")
    assert first.pair == second.pair != third.pair
    assert first.rng("placement").random() == second.rng("placement").random()
    assert EpisodeSpec.from_json(first.to_json()) == first


def test_without_events_nothing_is_written_of_them():
    spec = Recipe(tasks=("click_bell",)).spec(next(Recipe(tasks=("click_bell",)).slots()), 0)
    assert "arm" not in spec.to_json() and not spec.pair
    assert "events" not in Recipe().to_yaml()


@pytest.mark.parametrize("more", [{"episodes": 3, "events": ["stop"]}, {"episodes": 2}])
def test_pairs_need_events_and_two_slots_each(more):
    with pytest.raises(RecipeError, match="paired"):
        parse_recipe({"tasks": ["click_bell"], "paired": ["events"], **more})


@pytest.mark.parametrize("other", ["stop", "swap", "instruction"])
def test_an_exchange_is_alone_with_the_motion_of_the_target(other):
    with pytest.raises(RecipeError, match="events have instruction and"):
        Setup.parse({"events": ["instruction@1", f"{other}@2"]})
    Setup.parse({"events": ["instruction@1", "light@2", {"kind": ["slip", "freeze"]}]})
