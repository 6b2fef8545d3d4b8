"""A setup alone, and as a part of a recipe."""

import pytest

from pipeline.data.recipe.model import KEYS, Recipe, RecipeError, parse_recipe
from pipeline.data.setup import DEFAULT, IMAGES, Setup

TOP = {"name": "top", "pose": [0, 0, 2, 1, 0, 0, 0], "width": 64, "height": 48, "fovy": 60}


def test_a_recipe_is_a_setup_and_the_choice_of_episodes():
    recipe = parse_recipe({"tasks": "click_bell", "fps": 30, "cameras": ["head_camera", TOP], "lead": 0.5})
    assert recipe.setup == Setup(fps=30, cameras=("head", TOP), lead=0.5)
    assert type(recipe.setup) is Setup and recipe.camera_names == ("head_camera", "top")
    assert set(KEYS) == set(Recipe.model_fields) and len(KEYS) == len(set(KEYS))
    assert parse_recipe({}).setup == DEFAULT


def test_setups_of_the_same_physics_differ_in_images_only():
    seen = Setup(fps=30, layout="original", size=(64, 48), cameras=("left",), textures="unseen")
    assert seen.physics == Setup(fps=30, layout="original") != seen
    assert hash(seen.physics) == hash(Setup(fps=30, layout="original"))
    assert seen.given().keys() == {"fps", "layout", "size", "cameras", "textures"}
    assert set(seen.given()) - set(IMAGES) == set(seen.physics.given())
    assert Setup.parse(seen.given()) == seen


@pytest.mark.parametrize(
    ("changes", "label"),
    [
        ({}, "strict"),
        ({"fps": 30, "size": (64, 48)}, "strict-30hz"),
        ({"rules": "domino", "lead": 0.5, "camera": "L515"}, "domino-L515-lead0.5"),
        ({"contact": "continue", "layout": "original", "speed_bound": "maximum"}, "strict-continue-original-maximum"),
    ],
)
def test_a_label_names_what_the_physics_has_of_its_own(changes, label):
    assert Setup(**changes).label == label


def test_a_setup_may_have_no_cameras_and_a_dataset_must_have_some():
    assert Setup(cameras=()).camera_names == ()
    with pytest.raises(RecipeError, match="cameras is empty"):
        parse_recipe({"cameras": []})
    with pytest.raises(RecipeError, match=r"^--pointcloud is made of the head camera's images"):
        Setup(cameras=()).override({"pointcloud": True}, "options", {"pointcloud": "--pointcloud"})
    with pytest.raises(RecipeError, match="speed is not a key of a setup"):
        Setup.parse({"speed": 3})
