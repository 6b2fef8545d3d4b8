"""The check of a machine that joins: what it reports of itself, and what it refuses."""

import pickle
from functools import partial

import pytest

from pipeline.data.dataset import Dataset, DatasetError
from pipeline.data.process.machine import CACHE
from pipeline.data.recipe.model import parse_recipe
from pipeline.data.store.files import Store
from pipeline.run.identity.core import code_version
from pipeline.run.slot import fill
from pipeline.run.slot.fill import check_node
from pipeline.world.drawing.vulkan import NoRenderer

RECIPE = parse_recipe({"tasks": "click_bell", "levels": [1], "episodes": 1})


@pytest.fixture(autouse=True)
def renderer(monkeypatch):
    """A machine with a renderer, which is not started here."""
    monkeypatch.setattr(fill, "device_of", lambda *_: "a renderer, 1.0")


@pytest.fixture
def root(tmp_path):
    Dataset(tmp_path / "set").create(RECIPE)
    return tmp_path / "set"


def test_a_machine_that_has_all_reports_its_renderer(root):
    # as it travels to a node
    check = pickle.loads(pickle.dumps(partial(check_node, str(root), code_version(), "raster")))
    assert check() == {"renderer": "a renderer, 1.0"}


def test_a_machine_that_does_not_reach_the_dataset_is_refused(root):
    (root / "manifest.yaml").unlink()
    for there in (root, root / "nowhere"):
        with pytest.raises(
            DatasetError,
            match=rf"^{there} is not there: --out must be where all nodes of the cluster reach it$",
        ):
            check_node(str(there), code_version(), "raster")


def test_a_machine_with_other_code_is_refused_and_both_versions_are_named(root):
    said = rf"^runs code {code_version()}, the driver 1.2.3: install the same version on all nodes$"
    with pytest.raises(DatasetError, match=said):
        check_node(str(root), "1.2.3", "raster")


def test_a_machine_without_a_renderer_is_refused(root, monkeypatch):
    def none(*_):
        raise NoRenderer("no Vulkan driver")

    monkeypatch.setattr(fill, "device_of", none)
    with pytest.raises(NoRenderer, match="no Vulkan driver"):
        check_node(str(root), code_version(), "raster")


def test_of_a_dataset_on_a_store_the_store_is_asked_and_nothing_is_fetched(tmp_path, monkeypatch):
    monkeypatch.setenv(CACHE, str(tmp_path / "cache"))
    place = tmp_path / f"cache/places/memory%3A%2F%2F{tmp_path.name}%2Fset~head.1.x"
    check = partial(check_node, str(place), code_version(), "raster")
    with pytest.raises(DatasetError, match="is not there"):
        check()
    store = Store(f"memory://{tmp_path.name}/set")
    assert store.write_new("manifest.yaml", RECIPE.to_yaml().encode())
    assert check() == {"renderer": "a renderer, 1.0"} and not place.exists()
