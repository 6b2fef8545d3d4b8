"""A setup alone, and as a part of a recipe."""

import numpy as np
import pytest
from pydantic import ValidationError

from pipeline.data.cameras import project
from pipeline.data.episode.meta import NamedCamera
from pipeline.data.recipe.model import KEYS, Recipe, RecipeError, parse_recipe
from pipeline.data.setup import DEFAULT, IMAGES, Setup

TOP = {"name": "top", "pose": [0, 0, 2, 1, 0, 0, 0], "width": 64, "height": 48, "fovy": 60}


def test_a_recipe_is_a_setup_and_the_choice_of_episodes():
    recipe = parse_recipe(
        {"tasks": "click_bell", "fps": 30, "cameras": ["head_camera", TOP], "lead": 0.5}
    )
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
        (
            {"contact": "continue", "layout": "original", "speed_bound": "maximum"},
            "strict-continue-original-maximum",
        ),
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


def test_a_camera_may_be_placed_by_what_it_looks_at():
    size = {"name": "side", "width": 320, "height": 240, "fovy": 45}
    for position, point in (((0.8, -0.4, 1.2), (0, 0, 0.8)), ((0.1, 0.2, 1.5), (0.1, 0.2, 0.7))):
        camera = NamedCamera(**size, position=position, look_at=point).camera("side")
        uv, depth = project(camera.type, camera.pose, np.array(point, float))
        np.testing.assert_allclose(uv, [160, 120], atol=1e-6)
        assert depth == pytest.approx(np.linalg.norm(np.subtract(point, position)))
        above, _ = project(camera.type, camera.pose, np.add(point, [0, 0.01, 0.01]))
        assert above[1] < 120
    for wrong in ({"position": (1, 1, 1)}, {"position": (1, 1, 1), "look_at": (1, 1, 1)}):
        with pytest.raises(ValidationError):
            NamedCamera(**size, **wrong)
    with pytest.raises(ValueError, match="valid integer"):
        NamedCamera(**{**size, "width": True}, pose=[0, 0, 2, 1, 0, 0, 0])
