"""Which edit makes which slots stale: a table of edits to a copy of the sources."""

import shutil
from contextlib import contextmanager, suppress
from dataclasses import replace
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest

from pipeline.data.episode.events import EventSpec
from pipeline.data.imperfections import DriveErrors, Sensors
from pipeline.data.recipe.model import Slot
from pipeline.data.setup.brought import Brought
from pipeline.data.setup.rules import Corrections, Sight
from pipeline.data.spec import EpisodeSpec
from pipeline.run.identity import core
from pipeline.run.identity import slot_keys as code
from pipeline.run.identity.core import code_version
from pipeline.run.identity.slot_keys import RecipeKeys
from pipeline.run.names import recipe_from
from pipeline.stages.failure import Failure
from pipeline.stages.scene import build_scene
from pipeline.stages.surroundings import CLUTTER_FAMILIES
from pipeline.tasks import TASKS
from pipeline.tasks.contract import Draw, Placement, Region, UndeclaredFamily
from pipeline.tasks.layout import families_of, lay_out
from pipeline.world.objects.contract import FAMILIES
from pipeline.world.robots import MODELS
from tests.run.identity.sources import hashing_once

RECIPE = recipe_from(
    {
        "tasks": ["click_bell", "place_container_plate", "grab_roller"],
        "embodiments": ["aloha", "franka-panda"],
        "levels": [1],
        "domains": ["clean", "randomized"],
        "episodes": 1,
    }
)
SLOTS = {slot.cell.path: slot for slot in RECIPE.slots()}
SLOT = next(iter(RECIPE.slots()))
PACKAGE = core.PACKAGE

ALL = ("",)
NONE = ()
PHYSICS, IMAGES, SENTENCES = {"physics", "render", "language"}, {"render"}, {"language"}
CODE = "\nADDED = 1\n"
DOC = "\n# a remark\n"

# file, what is appended, cells whose keys change (parts of their paths), which keys
EDITS = [
    ("tasks/library/domino/press/press.py", CODE, ("click_bell",), PHYSICS),
    ("tasks/library/domino/press/press.py", DOC, NONE, set()),
    ("tasks/library/domino/set_down/set_down.py", CODE, ("place_container_plate",), PHYSICS),
    (
        "tasks/library/domino/press/phrases/click_bell.txt",
        "Ring {bell} for me with {arm}.\n",
        ("click_bell",),
        SENTENCES,
    ),
    ("tasks/library/domino/handle/shake_bottle.py", CODE, NONE, set()),
    ("tasks/library/domino/handle/phrases/shake_bottle.txt", "Shake.\n", NONE, set()),
    (
        "world/objects/families/devices/phrases/bell.txt",
        "{colour} chime\n",
        ("click_bell",),
        SENTENCES,
    ),
    ("world/objects/families/containers/phrases/cabinet.txt", "{colour} chest\n", NONE, set()),
    ("world/objects/words.py", CODE, ALL, SENTENCES),
    ("intake/catalogue/tasks.py", CODE, NONE, set()),
    ("tasks/language/sentences.py", CODE, ALL, SENTENCES),
    ("tasks/contract.py", CODE, ALL, PHYSICS),
    ("world/objects/families/containers/tableware.py", CODE, ("place_container_plate",), PHYSICS),
    ("world/objects/families/devices/ringers.py", CODE, ("click_bell", "randomized"), PHYSICS),
    ("world/objects/families/containers/cabinet.py", CODE, NONE, set()),
    ("world/objects/families/goods/boxes.py", CODE, ("randomized",), PHYSICS),
    ("motion/models/planar.py", CODE, ALL, PHYSICS),
    ("motion/models/turntable.py", CODE, NONE, set()),
    ("world/objects/geometry.py", CODE, ALL, PHYSICS),
    ("intake/catalogue/gallery.py", CODE, NONE, set()),
    ("assets/robots/franka-panda/robot.toml", DOC, ("franka-panda",), PHYSICS),
    ("assets/robots/franka-panda/meshes/ADDED.glb", "glTF", ("franka-panda",), IMAGES),
    ("assets/robots/piper/robot.urdf", DOC, NONE, set()),
    ("intake/catalogue/robots.py", CODE, NONE, set()),
    ("world/physics/simulation.py", CODE, ALL, PHYSICS),
    ("planning/path.py", CODE, ALL, PHYSICS),
    ("planning/path.py", DOC, NONE, set()),
    ("motion/planar_shapes.py", CODE, ALL, PHYSICS),
    ("world/looks/materials.py", CODE, ALL, IMAGES),
    ("world/looks/textures.py", CODE, ALL, IMAGES),
    ("world/drawing/renderer.py", CODE, ALL, IMAGES),
    ("world/drawing/sensing.py", CODE, ALL, IMAGES),
    ("run/slot/redraw.py", CODE, NONE, set()),
    ("world/drawing/shaders/raster/ADDED.frag", "void main() {}", ALL, IMAGES),
    ("stages/drawing/render.py", CODE, ALL, IMAGES),
    ("stages/dry_run.py", CODE, ALL, PHYSICS),
    ("data/recipe/model.py", CODE, NONE, set()),
    ("poses.py", CODE, ALL, PHYSICS),
    ("data/dataset.py", CODE, NONE, set()),
    ("export/formats/parquet.py", CODE, NONE, set()),
    ("report/summary.py", CODE, NONE, set()),
    ("run/build.py", CODE, NONE, set()),
    ("commands/build.py", CODE, NONE, set()),
    ("cli.py", CODE, NONE, set()),
    ("__pycache__/spec.cpython-312.pyc", "x", NONE, set()),
]


def all_keys():
    return {path: RecipeKeys(RECIPE).of(slot) for path, slot in SLOTS.items()}


@pytest.fixture(scope="module", autouse=True)
def plain_hash_file():
    """Syntax trees are made once for each content: all but one file of every tree here are
    equal. The function without that."""
    plain = core.hash_file
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(core, "hash_file", hashing_once())
        yield plain


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    """A copy of the sources; `edited` changes and restores it."""
    root = tmp_path_factory.mktemp("package") / "pipeline"
    return Path(shutil.copytree(PACKAGE, root, ignore=shutil.ignore_patterns("__pycache__")))


@contextmanager
def edited(package, to, file, text):
    """The copy of the sources by a path of its own, where a file ends with a text as long as the
    context lasts."""
    path = package / file
    before = path.read_bytes() if path.exists() else None
    new = path.parent if not path.parent.exists() else None
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes((before or b"") + text.encode())
    to.symlink_to(package)
    try:
        yield to
    finally:
        path.unlink()
        if before is not None:
            path.write_bytes(before)
        if new is not None:
            new.rmdir()


@pytest.fixture(scope="module")
def before():
    return all_keys()


@pytest.mark.parametrize(
    ("file", "text", "cells", "changed"),
    EDITS,
    ids=[f"{e[0]}:{'' if e[1] == CODE else 'text'}" for e in EDITS],
)
def test_an_edit_makes_only_those_slots_stale_that_it_can_change(
    tmp_path, monkeypatch, package, before, file, text, cells, changed
):
    with edited(package, tmp_path / "pipeline", file, text) as root:
        monkeypatch.setattr(core, "PACKAGE", root)
        keys = all_keys()
    for cell, new in keys.items():
        stale = {
            name
            for name in ("physics", "render", "language")
            if getattr(before[cell], name) != getattr(new, name)
        }
        assert stale == (changed if any(part in cell for part in cells) else set()), cell


def test_a_copy_of_the_sources_has_the_same_keys(tmp_path, monkeypatch, before, plain_hash_file):
    monkeypatch.setattr(core, "hash_file", plain_hash_file)
    shutil.copytree(PACKAGE, tmp_path / "pipeline")
    monkeypatch.setattr(core, "PACKAGE", tmp_path / "pipeline")
    assert all_keys() == before
    version = code_version()
    monkeypatch.undo()
    assert code_version() == version


def test_a_key_says_which_part_changed(tmp_path, monkeypatch, package, before):
    changed_file = "assets/robots/aloha-agilex/robot.toml"
    with edited(package, tmp_path / "pipeline", changed_file, DOC) as root:
        monkeypatch.setattr(core, "PACKAGE", root)
        keys = RecipeKeys(RECIPE).of(SLOT)
    assert keys.physics.changed(before[SLOT.cell.path].physics) == ["robot"]


def test_a_package_whose_numbers_matter_is_a_part(monkeypatch, before):
    monkeypatch.setattr(core, "version", lambda name: "9.9" if name == "sapien" else "1")
    for cached in (core.versions, code.cell_code, code.drawing_code):
        cached.cache_clear()
    changed = RecipeKeys(RECIPE).of(SLOT).physics.changed(before[SLOT.cell.path].physics)
    for cached in (core.versions, code.cell_code, code.drawing_code):
        cached.cache_clear()
    assert changed == ["packages"]


@pytest.mark.parametrize(("task", "robot"), zip(sorted(TASKS), cycle(MODELS)))
def test_every_scene_places_what_its_key_names(task, robot):
    """With each robot in turn, and with distractors."""
    known = families_of(TASKS[task])
    assert known
    scene = first_scene(EpisodeSpec(task, robot, 1, 0.1, "randomized", slot=0, seed=1000))
    placed = {body.family: name in scene.clutter for name, body in scene.bodies.items()}
    assert all(
        family in (CLUTTER_FAMILIES if clutter else known) for family, clutter in placed.items()
    )
    assert {type(body.instance) for body in scene.bodies.values()} == {
        FAMILIES[family] for family in placed
    }


def first_scene(spec):
    """The scene of the first seed for which there is room."""
    for seed in range(spec.seed, spec.seed + 20):
        with suppress(Failure):
            return build_scene(replace(spec, seed=seed))
    raise AssertionError(f"no scene of {spec}")


class Computed(type(TASKS["click_bell"])):
    """The name of its family is written nowhere."""

    def layout(self, draw):
        yield Placement("bell", draw.one_of("lleb"[::-1]), Region(x=(-0.2, 0.2), y=(-0.1, 0.1)))


def test_a_family_whose_name_is_computed_is_a_part_of_the_key(tmp_path, monkeypatch, package):
    monkeypatch.setitem(TASKS._items, "computed", Computed())  # pyright: ignore[reportAbstractUsage]
    cell = "computed", "piper", False, "planar"
    for number, (family, changes) in enumerate(
        (("containers/tableware", False), ("devices/ringers", True))
    ):
        plain, file = tmp_path / f"plain{number}", f"world/objects/families/{family}.py"
        plain.symlink_to(package)
        objects = [code.cell_code(plain, *cell).physics["objects"]]
        with edited(package, tmp_path / str(number), file, CODE) as root:
            objects.append(code.cell_code(root, *cell).physics["objects"])
        assert (objects[0] != objects[1]) == changes, family


def test_a_task_of_a_plugin_counts_with_all_files_of_plugins(tmp_path, monkeypatch, before):
    (tmp_path / "mine.py").write_text("")
    (tmp_path / "near.py").write_text("")
    monkeypatch.setenv("DOMINO_PLUGINS", str(tmp_path))
    task = type("Mine", (type(TASKS["click_bell"]),), {"__module__": "mine"})
    hashes = set()
    for name in ("", "mine.py", "near.py"):
        if name:
            (tmp_path / name).write_text(CODE)
        core.hash_file.cache_clear()
        hashes.add(code._hash_modules(PACKAGE, [task]))
    assert len(hashes) == 3
    assert all_keys() == before


def test_a_family_that_the_key_does_not_name_is_refused():
    class Undeclared(Computed):
        name, families = "undeclared", ("plate",)

    with pytest.raises(
        UndeclaredFamily,
        match=r"task undeclared: places a bell, .* write families = \('bell', 'plate'\)",
    ):
        lay_out(Undeclared(), Draw(np.random.default_rng(0), np.random.default_rng(1)))  # pyright: ignore[reportAbstractUsage]


def test_the_core_draws_nothing_and_looks_collide_with_nothing():
    files = [path for each in core.CORE for path in core.files_below(PACKAGE / each)]
    outside = {path for each in core.NOT_CORE for path in core.files_below(PACKAGE / each)}
    for path in (path for path in files if path not in outside):
        if path.suffix == ".py":
            text = path.read_text()
            drawing = ("pipeline.world.drawing", "pipeline.stages.drawing")
            assert not any(f"import {name}" in text or f"from {name}" in text for name in drawing)
    for path in core.files_below(PACKAGE / "world/looks"):
        assert "Collider" not in path.read_text(), path


PHYSICS_KEYS = {
    "events": (EventSpec(kind="stop"),),
    "motion": "planar",
    "seed": 1,
    "attempts": 31,
    "fps": 30,
    "camera": "L515",
    "lead": 0.5,
    "keep_failures": "all",
    "expert": "reactive",
    "sight": Sight(delay=0.1),
    "corrections": Corrections(policy="static", label="static"),
    "takeover": "error",
    "perturb": "push",
    "speed_bound": "maximum",
    "start": "late",
    "jumps": "capped",
    "rules": "domino",
    "contact": "continue",
    "layout": "original",
    "paired": ("levels",),
    "clutter": (3, 10),
    "view": "unoccluded",
    "drive": DriveErrors(lag=0.1),
}
IMAGE_KEYS = {
    "render": "raster-fast",
    "depth": True,
    "segmentation": True,
    "pointcloud": True,
    "cameras": ("head", "observer"),
    "size": (640, 480),
    "sensors": Sensors(noise=1.0),
    "visuals": "clean",
    "textures": "unseen",
    "environment": Brought(path="/sky.hdr", content="0" * 64),
}
SENTENCE_KEYS = {"instructions": 99}
NO_KEYS = {
    "name": "other",
    "tasks": ("click_bell", "grab_roller"),
    "embodiments": ("aloha-agilex", "piper"),
    "levels": (1,),
    "domains": ("clean", "randomized"),
    "alpha": (0.1, 0.2),
    "episodes": 7,
    "total": 70,
    "variants": 3,
    "visual_seed": 4,  # of looks that are not drawn from it
    "assets": "robotwin:elsewhere",
    "objects": {"mug": ("mug7",)},  # of a family that is not in the scene
}


@pytest.mark.parametrize(
    ("values", "changed"),
    [
        *(({k: v}, PHYSICS) for k, v in PHYSICS_KEYS.items()),
        *(({k: v}, IMAGES) for k, v in IMAGE_KEYS.items()),
        *(({k: v}, SENTENCES) for k, v in SENTENCE_KEYS.items()),
        *(({k: v}, set()) for k, v in NO_KEYS.items()),
        ({"visuals": "randomized"}, IMAGES),
    ],
)
def test_each_key_of_a_recipe_changes_what_it_decides(values, changed):
    old, new = RecipeKeys(RECIPE).of(SLOT), RecipeKeys(RECIPE.model_copy(update=values)).of(SLOT)
    assert {
        name
        for name in ("physics", "render", "language")
        if getattr(old, name) != getattr(new, name)
    } == changed


def test_every_key_of_a_recipe_is_in_that_table():
    tested = {*PHYSICS_KEYS, *IMAGE_KEYS, *SENTENCE_KEYS, *NO_KEYS}
    assert tested == set(type(RECIPE).model_fields)


def test_variants_differ_in_their_images_alone():
    drawn = RECIPE.model_copy(update={"visuals": "randomized", "variants": 3})
    slots = [replace(SLOT, variant=v) for v in range(3)]
    found = [RecipeKeys(drawn).of(slot) for slot in slots]
    assert len({k.render.digest for k in found}) == 3
    assert len({(k.physics.digest, k.language.digest) for k in found}) == 1
    other = drawn.model_copy(update={"visual_seed": 1})
    assert RecipeKeys(other).of(SLOT).render.changed(found[0].render) == ["recipe"]


def test_what_is_drawn_again_has_the_keys_of_a_build(before, monkeypatch):
    drawn = RECIPE.model_copy(update={"depth": True, "visuals": "randomized", "variants": 2})
    slot = replace(SLOT, variant=1)
    assert RecipeKeys(drawn).redrawn(slot, before[SLOT.cell.path]) == RecipeKeys(drawn).of(slot)
    # without its task, its robot and its families
    for name in ("TASKS", "FAMILIES", "MODELS"):
        monkeypatch.setattr(code, name, {})
    assert RecipeKeys(RECIPE).redrawn(SLOT, before[SLOT.cell.path]) == before[SLOT.cell.path]


@pytest.mark.parametrize(
    ("file", "changed"),
    [
        ("world/drawing/renderer.py", ["renderer"]),
        ("world/looks/visuals.py", ["renderer"]),
        ("data/cameras.py", ["renderer"]),
        ("world/drawing/shaders/raster/ADDED.frag", ["shaders"]),
        ("tasks/library/domino/press/press.py", []),
        ("world/objects/families/devices/ringers.py", []),
        ("assets/robots/aloha-agilex/robot.urdf", []),
        ("assets/robots/aloha-agilex/meshes/link1.glb", []),
        ("world/physics/simulation.py", []),
        ("stages/dry_run.py", []),
        ("tasks/language/sentences.py", []),
    ],
)
def test_only_what_draws_makes_a_drawing_stale(
    tmp_path, monkeypatch, package, before, file, changed
):
    text = CODE if file.endswith(".py") else "void main() {}"
    source = before[SLOT.cell.path]
    with edited(package, tmp_path / "pipeline", file, text) as root:
        monkeypatch.setattr(core, "PACKAGE", root)
        keys = RecipeKeys(RECIPE).redrawn(SLOT, source)
    assert keys.render.changed(source.render) == changed


def test_slots_have_keys_of_their_own():
    slots = [*RECIPE.slots(), Slot(SLOT.cell, 1), replace(SLOT, cell=replace(SLOT.cell, alpha=0.2))]
    assert len({RecipeKeys(RECIPE).of(slot).physics.digest for slot in slots}) == len(slots)
