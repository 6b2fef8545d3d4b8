"""Recipes: what they expand to, and how wrong ones are refused."""

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.data.recipe.file import read_recipe
from pipeline.data.recipe.model import DEFAULT_ALPHA, Cell, Recipe, RecipeError, Slot, parse_recipe
from pipeline.data.setup.rules import Sight
from pipeline.run.names import recipe_from
from pipeline.tasks.contract import suites

CAMERA = {"name": "top", "pose": [0, 0, 2, 1, 0, 0, 0], "width": 64, "height": 48, "fovy": 40}


def several(*choices):
    return st.lists(st.sampled_from(choices), min_size=1, max_size=len(choices), unique=True)


def wants_an_episode(given_values):
    episodes = given_values.get("episodes", 50)
    return isinstance(episodes, int) or any(
        episodes[domain] for domain in given_values.get("domains", ["clean"])
    )


values = st.fixed_dictionaries(
    {"tasks": several("click_bell", "grab_roller", "shake_bottle"), "levels": several(0, 1, 2, 3)},
    optional={
        "seed": st.integers(0, 100),
        "embodiments": several("aloha-agilex", "piper"),
        "domains": several("clean", "randomized"),
        "alpha": several(0.05, 0.1, 0.3),
        "episodes": st.one_of(
            st.integers(1, 4),
            st.fixed_dictionaries({"clean": st.integers(0, 3), "randomized": st.integers(0, 3)}),
        ),
        "fps": st.sampled_from([15, 30, 60]),
    },
).filter(wants_an_episode)


@given(values)
@settings(deadline=None, max_examples=40)
def test_a_recipe_expands_to_every_wanted_episode_once(given_values):
    recipe = recipe_from(given_values)
    cells = recipe.cells()
    moving = [level for level in recipe.levels if level]
    per_level = len(moving) * len(recipe.alpha) + (0 in recipe.levels)
    assert (
        len(cells)
        == len(set(cells))
        == len(recipe.tasks) * len(recipe.embodiments) * len(recipe.domains) * per_level
    )
    slots = list(recipe.slots())
    assert len(slots) == len({s.path for s in slots}) == sum(recipe.wanted(c) for c in cells)
    for cell in cells:
        assert [s.index for s in slots if s.cell == cell] == list(range(recipe.wanted(cell)))
    assert [s.index for s in slots] == sorted(s.index for s in slots)
    specs = {recipe.spec(s, a).seed for s in slots for a in range(2)}
    assert len(specs) == 2 * len(slots)


@given(values)
@settings(deadline=None, max_examples=40)
def test_yaml_restores_a_recipe(given_values):
    recipe = recipe_from(given_values)
    again = recipe_from(yaml.safe_load(recipe.to_yaml()))
    assert again == recipe
    assert again.to_yaml() == recipe.to_yaml()
    assert list(again.slots()) == list(recipe.slots())


def test_variants_follow_the_slot_whose_physics_they_show():
    wanted = {
        "tasks": "click_bell",
        "levels": [1, 2],
        "episodes": 2,
        "visuals": "randomized",
        "variants": 3,
    }
    recipe = recipe_from(wanted)
    slots = list(recipe.slots())
    assert [s.physical for s in slots[::3]] == list(recipe.physical_slots()) == slots[::3]
    assert [s.variant for s in slots] == [0, 1, 2] * 4
    assert [s.path.split("/")[-1] for s in slots[:3]] == [
        "episode_0000000",
        "episode_0000000_v1",
        "episode_0000000_v2",
    ]
    assert len({s.path for s in slots}) == 12
    # the spec, and with it the physics, knows nothing of variants
    assert {recipe.spec(s, 0) for s in slots} == {
        recipe.spec(s, 0) for s in recipe.physical_slots()
    }


def test_cameras_go_by_short_or_long_names():
    top = {"name": "top", "pose": [0, 0, 2, 0, 0, 0, 2], "width": 64, "height": 48, "fovy": 40}
    recipe = recipe_from({"cameras": ["head_camera", "observer", top]})
    assert recipe.cameras[:2] == ("head", "observer")
    assert recipe.cameras[2].pose == (0, 0, 2, 0, 0, 0, 1)
    assert recipe_from(yaml.safe_load(recipe.to_yaml())) == recipe
    assert recipe_from({"cameras": "left"}).cameras == ("left",)


def test_nothing_at_all_is_the_default_recipe():
    recipe = recipe_from({})
    assert recipe.embodiments == ("aloha-agilex",)
    assert recipe.levels == (1, 2, 3)
    assert recipe.tasks == recipe_from({"tasks": "all"}).tasks == suites()["domino"]


def test_a_recipe_frozen_with_the_retired_key_of_vendor_meshes_is_read():
    assert parse_recipe({"robot_meshes": {}}) == parse_recipe({})
    with pytest.raises(RecipeError, match="robot_meshes is not a key of a recipe"):
        parse_recipe({"robot_meshes": {"piper": "abcd"}})


def test_single_values_aliases_and_repeats():
    recipe = recipe_from(
        {
            "tasks": "click_bell",
            "embodiments": ["aloha", "aloha-agilex", "arx"],
            "levels": [1, 1, 0],
            "alpha": 0.2,
        }
    )
    assert recipe.embodiments == ("aloha-agilex", "arx-x5")
    assert recipe.levels == (1, 0)
    assert recipe.alpha == (0.2,)


def test_paths_name_alpha_only_where_it_is_not_the_default():
    def path(level, alpha):
        return Slot(Cell("t", "e", level, alpha, "clean"), 12).path

    assert path(1, DEFAULT_ALPHA) == "t/e/L1/clean/episode_0000012"
    assert path(1, 0.25) == "t/e/L1@0.25/clean/episode_0000012"
    assert path(0, 0.25) == "t/e/L0/clean/episode_0000012"


def test_domains_may_want_different_numbers():
    recipe = recipe_from(
        {
            "tasks": "click_bell",
            "levels": 1,
            "domains": ["clean", "randomized"],
            "episodes": {"clean": 2, "randomized": 1},
        }
    )
    assert [(s.cell.domain, s.index) for s in recipe.slots()] == [
        ("clean", 0),
        ("randomized", 0),
        ("clean", 1),
    ]


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"episdoes": 3}, "episdoes"),
        ({"tasks": ["clik_bell"]}, "clik_bell"),
        ({"expert": "psychic"}, "expert must be 'planned' or 'reactive'"),
        ({"sight": {"dely": 0.1}}, "sight has no dely"),
        ({"sight": {"noise": -1}}, "sight: noise must be greater"),
        ({"sight": "100 km"}, "sight is not written as a delay and an error, such as 100ms,5mm"),
        ({"sight": "100ms,5m"}, "sight: noise must be less than or equal to 0.1 (got 5.0)"),
        ({"sight": "100ms,5mm"}, "sight: needs the reactive expert"),
        ({"takeover": "error"}, "takeover: needs a policy to correct"),
        ({"corrections": "psychic"}, "corrections: 'psychic' is unknown"),
        ({"perturb": "push"}, "perturb: needs a policy to correct"),
        ({"perturb": "kick"}, "perturb must be 'pause' or 'push'"),
        ({"embodiments": ["r2d2"]}, "r2d2"),
        ({"embodiments": ["aloha+piper+ur5"]}, "piper"),
        ({"levels": [10]}, "levels"),
        ({"levels": []}, "levels"),
        ({"levels": "fast"}, "levels"),
        ({"alpha": [-0.1]}, "alpha"),
        ({"alpha": [float("nan")]}, "alpha is NaN"),
        ({"alpha": float("nan")}, "alpha is NaN"),
        ({"alpha": []}, "alpha"),
        ({"domains": ["dirty"]}, "domains"),
        ({"episodes": 0}, "episodes"),
        ({"episodes": "many"}, "episodes"),
        ({"episodes": {"dirty": 1}}, "episodes"),
        ({"seed": -1}, "seed"),
        ({"attempts": 0}, "attempts"),
        ({"total": 0}, "total"),
        ({"clutter": [4, 3]}, "clutter"),
        ({"clutter": [3, 11]}, "clutter"),
        ({"textures": "new"}, "textures"),
        ({"total": 3, "episodes": {"clean": 0}}, "wants 0 episodes"),
        ({"paired": ["tasks"]}, "paired"),
        (
            {
                "alpha": [0.01 * i for i in range(1, 101)],
                "tasks": [f"t{i}" for i in range(200)],
                "embodiments": [f"e{i}" for i in range(999)],
            },
            "cells",
        ),
        ({"fps": 16}, "fps"),
        ({"camera": "GoPro"}, "camera"),
        ({"render": "lovely"}, "render"),
        ({"cameras": "hed"}, "hed"),
        ({"cameras": []}, "cameras"),
        ({"cameras": ["head", "head_camera"]}, "twice"),
        ({"cameras": [{"name": "top"}]}, "width"),
        ({"cameras": [CAMERA | {"name": "../up"}]}, "../up"),
        ({"cameras": [CAMERA | {"pose": [0] * 7}]}, "pose"),
        ({"cameras": [CAMERA | {"pose": [float("nan")] * 7}]}, "pose"),
        ({"cameras": [CAMERA | {"fovy": 180}]}, "fovy"),
        ({"cameras": [CAMERA | {"zoom": 2}]}, "zoom"),
        ({"cameras": [3]}, "3"),
        ({"size": [640]}, "size"),
        ({"size": [640, 8]}, "size"),
        ({"visuals": "dirty"}, "visuals"),
        ({"variants": 0}, "variants"),
        ({"variants": 2}, "visuals: randomized"),
        ({"visual_seed": -1}, "visual_seed"),
        ({"pointcloud": True, "cameras": ["left"]}, "head"),
        ({"lead": -1}, "lead"),
        ({"tasks": {"a": 1}}, "tasks"),
        ({"levels": [[1]]}, "levels"),
        ({"levels": None}, "levels"),
        ({1: 2}, "1"),
    ],
)
def test_a_wrong_recipe_is_refused_in_one_line_that_names_the_key(wrong, said):
    with pytest.raises(RecipeError) as error:
        recipe_from(wrong, "my.yaml")
    text = str(error.value)
    assert "\n" not in text
    assert text.startswith("my.yaml: ")
    assert said in text


def test_recipe_files_that_cannot_be_read(tmp_path):
    (tmp_path / "list.yaml").write_text("- 1\n- 2\n")
    (tmp_path / "broken.yaml").write_text("a: [1\nb: {")
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x00\x01")
    for name in ("missing.yaml", "list.yaml", "broken.yaml", "binary.yaml"):
        with pytest.raises(RecipeError, match=name) as error:
            read_recipe(tmp_path / name)
        assert "\n" not in str(error.value)
    (tmp_path / "good.yaml").write_text("seed: 3\n")
    assert read_recipe(tmp_path / "good.yaml") == {"seed": 3}


def test_a_recipe_cannot_be_changed():
    with pytest.raises(ValueError, match="frozen"):
        Recipe().seed = 1  # type: ignore[misc]


def test_a_recipe_alone_names_the_reactive_expert():
    recipe = Recipe(tasks=("click_bell",), expert="reactive", sight=Sight(delay=0.1))
    assert (
        recipe.reactive == Sight(delay=0.1)
        and recipe.setup.reactive is None
        and recipe.physics.reactive is None
    )
    assert recipe.label == "strict-reactive-delay0.1-noise0" and Recipe().label == "strict"
