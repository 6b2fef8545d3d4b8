"""The recipes of manifests/: each expands to the number of episodes that the paper's experiment
asks for."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from pipeline.data.cameras import CameraType, visible
from pipeline.data.episode.meta import NamedCamera
from pipeline.data.recipe.file import read_recipe
from pipeline.data.recipe.growth import differences, left_out
from pipeline.data.spec import EpisodeSpec
from pipeline.intake.catalogue.listings import list_objects
from pipeline.intake.fetch_objects import WHEELS, read_catalogue
from pipeline.run.names import recipe_from
from pipeline.stages.scene import build_scene
from pipeline.tasks import TASKS
from pipeline.tasks.contract import suites

ROOT = Path(__file__).parent.parent / "manifests"

EPISODES = {
    "domino-117k": 117_000,
    "real": 36 * 3 * (2 + 2),
    "smoke": 6 * 3 * 2,
    "events": 4 * 2 * 50,
    "dustbins": 2 * 3 * 2,
    "puma-tiny": 2 * 400,
    "puma-small": 3 * 100,
    "puma-many": 12 * 3 * 30,
    "puma-study": 2 * 2 * 200,
    "paper/35-tasks": 35 * 50,
    "paper/10-tasks": 10 * 50,
    "paper/5-tasks": 5 * 3 * 50,
    "paper/levels-2-3": 10 * 2 * 50,
    "paper/cross-level": 10 * 3 * 50,
    "paper/alpha-0.05": 10 * 50,
    "paper/alpha-drawn": 10 * 50,
    "paper/double": 10 * 2 * 50,
    "paper/static": 35 * 50,
    "paper/static-and-dynamic": 2 * 35 * 50,
}

SUBSET = ("10-tasks", "levels-2-3", "cross-level", "alpha-0.05", "alpha-drawn", "double")
INTERCEPTION = {
    "grab_roller",
    "handover_block",
    "place_a2b_left",
    "place_can_basket",
    "shake_bottle",
}
TRACKING = {
    "beat_block_hammer",
    "move_pillbottle_pad",
    "place_bread_basket",
    "place_container_plate",
    "press_stapler",
}
"""The ten tasks that the paper's appendix names."""


def recipe(name):
    settings = read_recipe(ROOT / f"{name}.yaml")
    settings.pop("objects", None)  # those of `real` are fetched
    return recipe_from(settings, name)


def test_every_manifest_is_counted_here():
    assert {
        path.relative_to(ROOT).with_suffix("").as_posix() for path in ROOT.rglob("*.yaml")
    } == set(EPISODES)


@pytest.mark.parametrize("name", EPISODES)
def test_a_manifest_expands_to_the_number_of_episodes(name):
    wanted = recipe(name)
    assert sum(wanted.counts().values()) * wanted.variants == EPISODES[name]
    if name.startswith("paper/"):
        assert (ROOT / f"{name}.yaml").read_text().startswith("# ")
        assert wanted.name == name.replace("/", "-")
        assert (wanted.embodiments, wanted.domains) == (("aloha-agilex",), ("clean",))
        if name != "paper/alpha-drawn":
            assert wanted.alpha == ((0.05,) if name == "paper/alpha-0.05" else (0.1,))


def test_real_names_all_tasks_of_domino_and_beyond_that_draw_a_fetched_object():
    settings = read_recipe(ROOT / "real.yaml")
    fetched = {each.name: each.family for source in WHEELS for each in read_catalogue(source)}
    named = {name: family for family, names in settings["objects"].items() for name in names}
    assert named == fetched
    drawing = [each["tasks"] for each in list_objects(sorted(settings["objects"])).values()]
    covered = {*suites()["domino"], *suites()["beyond"]}
    assert set(settings["tasks"]) == set().union(*drawing) & covered


@pytest.mark.parametrize("name", SUBSET)
def test_the_subset_is_the_papers(name):
    tasks = recipe(f"paper/{name}").tasks
    assert {task for task in tasks if TASKS[task].category == "interception"} == INTERCEPTION
    assert {task for task in tasks if TASKS[task].category == "tracking"} == TRACKING


def test_the_whole_dataset_is_spread_evenly():
    wanted = recipe("domino-117k")
    assert (len(wanted.tasks), len(wanted.embodiments), wanted.levels) == (35, 5, (1, 2, 3))
    counts = wanted.counts()
    for key, of in (("task", 35), ("embodiment", 5), ("level", 3)):
        sums = Counter[object]()
        for cell, count in counts.items():
            sums[getattr(cell, key)] += count
        # within half a per cent of equal parts
        assert len(sums) == of and all(abs(n * of / 117_000 - 1) < 0.005 for n in sums.values())
    assert sum(count for cell, count in counts.items() if cell.domain == "clean") == 23_400


def test_drawn_alphas_cover_their_range_evenly():
    alphas = recipe("paper/alpha-drawn").alpha
    parts = sorted(int((alpha - 0.05) / (0.1 / 50)) for alpha in alphas)
    assert parts == list(range(50))


def test_the_ten_tasks_grow_into_twice_the_data():
    small, large = recipe("paper/10-tasks"), recipe("paper/double")
    assert not differences(small, large) and not left_out(small, large)
    assert set(small.slots()) < set(large.slots())


@pytest.mark.parametrize("task", ["dump_bin_bigbin", "put_bottles_dustbin"])
def test_the_camera_over_the_bins_sees_their_floor_and_the_table(task):
    camera = next(c for c in recipe("dustbins").cameras if isinstance(c, NamedCamera))
    kind = CameraType(camera.width, camera.height, camera.fovy)
    for seed in range(4):
        bodies = build_scene(EpisodeSpec(task, "aloha-agilex", 0, 0.0, "clean", 0, seed)).bodies
        bin_ = next(body for name, body in bodies.items() if name in ("big_bin", "dustbin"))
        low, high = bin_.instance.shape().aabb()
        floor = bin_.pose[:3] + np.array(
            [[x, y, 0.02] for x in (low[0], high[0]) for y in (low[1], high[1])]
        )
        assert visible(kind, camera.pose, floor, margin=8).all()
        assert visible(kind, camera.pose, bodies[TASKS[task].target].pose[:3])
        # straight above the bin, so that its wall hides none of the middle of its floor
        assert np.abs(np.subtract(camera.pose[:2], bin_.pose[:2])).max() < min(high[:2])
