"""The options of a recipe's keys, as `domino-data render` and the others take them."""

import pytest

from pipeline.commands.build import with_looks
from pipeline.commands.common import UsageError
from pipeline.commands.options import EVERY, cameras_of, parse_value
from pipeline.data.recipe.model import Recipe


def test_names_and_descriptions_of_cameras_may_be_mixed():
    top = '{"name": "top", "pose": [0, 0, 2, 1, 0, 0, 0], "width": 64, "height": 48, "fovy": 40}'
    described = {
        "name": "top",
        "pose": [0, 0, 2, 1, 0, 0, 0],
        "width": 64,
        "height": 48,
        "fovy": 40,
    }
    assert cameras_of(f"head, {top},observer") == ["head", described, "observer"]
    assert cameras_of(top) == [described]
    assert cameras_of("left") == ["left"]
    assert cameras_of("none") == []
    with pytest.raises(UsageError, match="--cameras"):
        cameras_of(" , ")


def test_options_become_keys_of_the_recipe():
    assert {
        key: parse_value(key, text)
        for key, text in (("levels", "1,3"), ("alpha", "0.1"), ("clutter", "0,4"))
    } == {"levels": [1, 3], "alpha": [0.1], "clutter": [0, 4]}
    assert (
        parse_value("size", "640x480"),
        parse_value("tasks", "a, b"),
        parse_value("fps", 30),
    ) == ((640, 480), ["a", "b"], 30)
    assert set(EVERY) == set(Recipe.model_fields) - {"name", "keep_failures"}


def test_looks_that_are_not_named_stay():
    assert with_looks({}, "keep") == {}
    assert with_looks({"variants": 3}, "randomized") == {
        "visuals": "randomized",
        "variants": 3,
        "visual_seed": 0,
    }
    assert with_looks({"size": (64, 48)}, "clean") == {
        "size": (64, 48),
        "visuals": "clean",
        "variants": 1,
        "visual_seed": 0,
    }
    with pytest.raises(UsageError, match="--visuals randomized"):
        with_looks({"visual_seed": 3}, "keep")


@pytest.mark.parametrize("size", ["640", "x", "1x2x3", "640x", "6 40x480", "axb", "-1x20"])
def test_a_size_that_is_none_is_refused(size):
    with pytest.raises(UsageError, match="--size"):
        parse_value("size", size)
