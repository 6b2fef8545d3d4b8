"""Objects from files in recipes: where they are placed, what is refused, and that their content
counts in keys."""

import pickle
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.data.recipe.cells import Slot
from pipeline.data.recipe.model import Recipe, RecipeError
from pipeline.data.setup.rules import Rules
from pipeline.data.spec import EpisodeSpec
from pipeline.intake.objects.draft import ObjectOptions
from pipeline.run.identity.slot_keys import RecipeKeys
from pipeline.run.names import resolve
from pipeline.run.provenance import licences_of
from pipeline.stages.scene import build_scene
from pipeline.tasks import TASKS, Draw
from pipeline.tasks.contract import UndeclaredFamily
from pipeline.world.objects.contract import FAMILIES
from pipeline.world.objects.from_files import ObjectError, add_directory
from tests.intake.objects.conftest import add_here
from tests.intake.objects.meshes import box_file


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The directory of an object that stands for playing cards, made once."""
    root = tmp_path_factory.mktemp("made")
    options = ObjectOptions("cards_0", "playing_cards", root, up="z", licence="Proprietary")
    directory, _ = add_here(box_file(root / "box.obj", (0.06, 0.03, 0.08)), options)
    FAMILIES.remove("cards_0")
    return directory


@pytest.fixture
def cards(made, options):
    """A copy of it to edit, which is registered."""
    directory = Path(shutil.copytree(made, options.to / "objects" / "cards_0"))
    add_directory(directory)
    return directory


def recipe(**changes) -> Recipe:
    return Recipe(
        tasks=("move_playingcard_away",), objects={"playing_cards": ("cards_0",)}
    ).model_copy(update=changes)


def test_a_layout_places_the_object_and_the_rules_come_back(cards):
    resolved = resolve(recipe(objects={"playing_cards": ("cards",)}))
    assert resolved.objects == {"playing_cards": ("cards_0",)}
    scene = build_scene(
        EpisodeSpec("move_playingcard_away", "aloha-agilex", 1, 0.1, "clean", 0, 1),
        resolved.ruling(),
    )
    body = scene.bodies[scene.task.target]
    assert body.family == "cards_0" and pickle.loads(pickle.dumps(body.instance)) == body.instance
    assert (
        scene.rules == Rules(objects=(("playing_cards", ("cards_0",)),))
        and "objects" in scene.rules.label
    )
    assert Recipe(objects="playing_cards=cards_0,playing_cards=robotwin:cards_1").objects[
        "playing_cards"
    ] == ("cards_0", "cards_1")
    made = licences_of(resolved)
    assert made["cards_0"] == "Proprietary" and made["aloha-agilex"] == "Apache-2.0"


def test_the_content_of_an_object_counts_where_it_is_used(cards):
    def keys(task: str):
        asked = resolve(recipe(tasks=("move_playingcard_away", "click_bell")))
        found = RecipeKeys(asked).of(
            Slot(next(cell for cell in asked.cells() if cell.task == task), 0)
        )
        return found.physics.digest, found.render.digest

    before, other = keys("move_playingcard_away"), keys("click_bell")
    bare = resolve(Recipe(tasks=("click_bell",)))
    assert other[0] == RecipeKeys(bare).of(Slot(bare.cells()[0], 0)).physics.digest
    (cards / "looks.glb").write_bytes((cards / "looks.glb").read_bytes() + b"    ")
    seen = keys("move_playingcard_away")
    assert seen[0] == before[0] and seen[1] != before[1]
    (cards / "solid.obj").write_text((cards / "solid.obj").read_text() + "\n")
    assert keys("move_playingcard_away")[0] != before[0] and keys("click_bell") == other


@pytest.mark.parametrize(
    ("objects", "said"),
    [
        ({"playing_cards": ("ghost",)}, "no object 'ghost'"),
        ({"ghosts": ("cards_0",)}, "no object family 'ghosts'"),
        ({"mug": ("cards_0",)}, "no task of the recipe draws a mug; they draw playing_cards"),
        ({"hanging_mug.mug": ("cards_0",)}, "stands for playing_cards, not for mug"),
        ({"hanging_mug.mug": ("bottle",)}, "no object 'bottle'"),
        ({"hanging_mugs.mug": ("cards_0",)}, "no task 'hanging_mugs'"),
        (
            {"click_bell.playing_cards": ("cards_0",)},
            "no task of the recipe draws a playing_cards; they draw bell",
        ),
    ],
)
def test_a_recipe_with_wrong_objects_is_refused(cards, objects, said):
    with pytest.raises(RecipeError, match=said):
        resolve(recipe(objects=objects))


def test_a_size_that_a_task_gives_is_no_object_s(options, tmp_path):
    add_here(
        box_file(tmp_path / "flat.obj", (0.1, 0.1, 0.01)),
        replace(options, name="slab", family="pad"),
    )
    rng = np.random.default_rng(0)
    with pytest.raises(UndeclaredFamily, match="given by the task"):
        list(
            TASKS["move_pillbottle_pad"].layout(
                Draw(rng, rng, Rules(objects=(("pad", ("slab",)),)))
            )
        )


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("mass = ", "mass = -", "mass"),
        ("family = ", "famly = ", "fam"),
        ("[frames]", "[frames", "not readable"),
        ("top = ", "topp = ", "no top"),
        ('family = "playing_cards"', 'family = "ghost"', "no object family"),
    ],
)
def test_a_damaged_directory_is_refused_in_one_line(cards, old, new, said):
    FAMILIES.remove("cards_0")
    (cards / "object.toml").write_text((cards / "object.toml").read_text().replace(old, new))
    with pytest.raises(ObjectError, match=said) as error:
        add_directory(cards)
    assert "\n" not in str(error.value)
    add = (cards / "object.toml").read_text().replace(new, old)
    (cards / "object.toml").write_text(add)
    (cards / "solid.obj").write_text("v 1 2 nan\n")
    add_directory(cards)
    with pytest.raises(ObjectError, match=r"solid\.obj"):
        FAMILIES["cards_0"].draw(np.random.default_rng()).shape()
