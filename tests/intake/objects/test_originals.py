"""`assets: robotwin:DIR`: the original's objects by task, the names of those that cannot be used,
and datasets built with them."""

import json
import shutil

import pytest

from pipeline.data.recipe.model import Recipe, RecipeError
from pipeline.data.spec import EpisodeSpec
from pipeline.run.names import resolve
from pipeline.stages.scene import build_scene
from pipeline.world.objects.contract import FAMILIES, stands_for
from tests.intake.objects.meshes import box_file, robotwin_directory
from tests.run.command import inside


@pytest.fixture
def assets(tmp_path, monkeypatch, options):
    """A directory in the layout of RoboTwin-OD: cards, cups, and cards too wide for any hand."""
    monkeypatch.setenv("DOMINO_DATA_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("DOMINO_PLUGINS", "")
    root = tmp_path / "RoboTwin" / "assets" / "objects"
    robotwin_directory(root / "081_playingcards", (0, 1, 7))
    robotwin_directory(root / "021_cup", (0, 2))
    for i in (0, 1, 7):
        (root / "081_playingcards" / f"model_data{i}.json").write_text('{"scale": 0.1}')
    for kind in ("visual", "collision"):
        box_file(root / "081_playingcards" / kind / "base1.glb", (1.2, 0.9, 1.2))
    texts = tmp_path / "RoboTwin" / "description" / "objects_description" / "081_playingcards"
    texts.mkdir(parents=True)
    (texts / "base0.json").write_text(
        json.dumps({"seen": ["the deck of cards", "red box"], "unseen": ["A small deck"]})
    )
    return root


def test_each_task_has_the_instances_of_the_original(assets, capsys):
    tasks = ("place_empty_cup", "place_container_plate", "move_playingcard_away")
    found = resolve(Recipe(tasks=tasks, assets=f"robotwin:{assets.parents[1]}"))
    assert found.objects == {
        "place_empty_cup.cup": ("cup_021_0",),
        "place_container_plate.cup": ("cup_021_2",),
        "playing_cards": ("playing_cards_081_0",),
    }
    assert found.assets == f"robotwin:{assets}"
    assert "assets: not used: 081_playingcards 1: no grasp" in capsys.readouterr().err
    scenes = [
        build_scene(EpisodeSpec(task, "aloha-agilex", 1, 0.1, "clean", 0, 0), found.ruling())
        for task in tasks
    ]
    assert scenes[0].bodies["cup"].family == "cup_021_0" and scenes[1].bodies[
        "container"
    ].family in ("cup_021_2", "bowl")
    words = scenes[2].bodies["cards"].instance.words()
    assert words.seen[1:] == ("deck of cards", "red box") and words.unseen == ("small deck",)
    assert resolve(found) == found


def test_an_object_that_cannot_be_read_is_named(assets, tmp_path, capsys):
    damaged = assets / "021_cup" / "visual" / "base0.glb"
    damaged.write_bytes(damaged.read_bytes()[:200])
    with pytest.raises(RecipeError) as error:
        resolve(Recipe(tasks=("place_empty_cup",), assets=f"robotwin:{assets}"))
    message = str(error.value)
    assert message.startswith("assets: 021_cup 0: ") and "\n" not in message
    assert message.endswith(": repair it, or move its model_data file away to build without it")
    capsys.readouterr()
    found = resolve(Recipe(tasks=("all",), assets=f"robotwin:{assets}"))
    assert (
        "place_empty_cup.cup" not in found.objects and "place_container_plate.cup" in found.objects
    )
    (line,) = (line for line in capsys.readouterr().err.splitlines() if "021_cup" in line)
    assert line.startswith(
        "domino-data: assets: objects left out because they cannot be read: 1: 021_cup 0: "
    )


def forget(monkeypatch):
    """Make this process one that has not heard of the objects."""
    monkeypatch.setenv("DOMINO_PLUGINS", "")
    for name in [name for name, family in FAMILIES.items() if stands_for(family)]:
        FAMILIES.remove(name)


def test_a_dataset_with_them_is_whole_in_another_process(assets, tmp_path, monkeypatch):
    out = tmp_path / "out"
    wanted = (
        "--tasks",
        "move_playingcard_away",
        "--levels",
        "1",
        "--episodes",
        "1",
        "--cameras",
        "head",
        "--size",
        "64x48",
    )
    given = (*wanted, "--assets", f"robotwin:{assets}", "--executor", "inline", "--quiet", "--json")
    code, said, err = inside("build", *given, "--out", out)
    assert code == 0 and json.loads(said)["accepted"] == 1, err
    forget(monkeypatch)
    code, said, err = inside("status", out, "--json")
    assert code == 0 and json.loads(said)["accepted"] == 1, said
    assert "playing_cards_081_0" in FAMILIES
    forget(monkeypatch)
    shutil.rmtree(assets)
    code, said, err = inside("build", *given, "--out", out)
    assert (code, said, err.count("\n")) == (2, "", 1) and "is no directory" in err
    # files are judged by their own hashes
    assert inside("verify", out, "--json")[0] == 0


def test_a_directory_without_objects_is_refused(assets, tmp_path):
    for given, said in (
        ("robotwin:", "written as robotwin:DIR"),
        (f"robotwin:{tmp_path}/gone", "is no directory"),
        (f"robotwin:{tmp_path}/cache", "is no directory"),
    ):
        with pytest.raises((RecipeError, ValueError), match=said):
            resolve(Recipe(tasks=("move_playingcard_away",), assets=given))
    with pytest.raises(RecipeError, match="holds no object for these tasks"):
        resolve(Recipe(tasks=("click_bell",), assets=f"robotwin:{assets}"))
