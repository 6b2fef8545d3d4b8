"""The keys of a slot: what can change its physics, its images and its sentences (design.md section 7).

`physics`: the slot and the recipe's parameters, the core (everything that the three stages import), the sources of this task, of
its object families and of this robot, and the versions of the packages whose numbers matter. `render`, on top of it: preset,
cameras, sensors and visuals, the renderer with its shaders, and the modules that only give things their look. `language`, on top
of the physics: templates, descriptions of the task's object families and grammar. An episode drawn again from its state log keeps
the physics, the looks and the language that it had: `redrawn_keys` needs neither its task nor its robot.
"""

from collections.abc import Iterable
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from pipeline.data.keys import Key, SlotKeys, digest
from pipeline.data.recipe import CHOOSING, Cell, Recipe, Slot
from pipeline.run import sources
from pipeline.tasks import TASKS
from pipeline.world.objects.contract import FAMILIES
from pipeline.world.robots import MODELS

CORE = ("pipeline.stages.attempt", "pipeline.motion.interception_group")
DRAWING = ("pipeline.stages.render", "pipeline.stages.tracks")
LANGUAGE = ("pipeline.tasks.language", "pipeline.world.objects.words")

REGISTERED = ("pipeline.tasks.library", "pipeline.world.objects.families", "pipeline.world.robots.models")
"""Packages whose modules register themselves: the core imports them all, a slot uses a few, which are parts of their own."""

LOOKS = (
    *("pipeline.world.materials", "pipeline.world.textures", "pipeline.world.visuals", "pipeline.world.room"),
    *("pipeline.world.robots.parts", "pipeline.world.robots.arx_look", "pipeline.world.robots.franka_look"),
    *("pipeline.world.robots.piper_look", "pipeline.world.robots.ur5_look"),
)
"""Modules that give bodies their look and cannot move anything: they count for the images only."""

RANDOMIZED = "pipeline.stages.surroundings"
"""The module that names the families of distractors."""

NEUTRAL = ("pipeline.data.errors", "pipeline.data.reading", "pipeline.data.recipe")
"""Modules that the stages import and that decide nothing by themselves: what a recipe says is a part of its own."""

NUMERIC = {
    **{name: name for name in ("coal", "manifold3d", "numba", "numpy", "sapien", "scipy", "trimesh")},
    "cv2": "opencv-python-headless",
}
"""Packages whose numbers matter: imported module and distribution."""

FOR_IMAGES = (
    *("render", "depth", "segmentation", "pointcloud", "cameras", "size", "visuals", "visual_seed", "textures"),
    "robot_meshes",
)
FOR_SENTENCES = ("instructions",)


def slot_keys(recipe: Recipe, slot: Slot) -> SlotKeys:
    """The keys that a slot has with the code, the packages and the recipe as they are now."""
    cell = slot.cell
    every = _given(recipe)
    for name in FOR_IMAGES:
        every.pop(name, None)
    spoken = {name: every.pop(name, None) for name in FOR_SENTENCES}
    root = sources.package_root()
    physics = Key({"slot": digest([slot.physical.path, cell.alpha]), "recipe": digest(every), **_physics(root, cell)})
    render = _render_key(recipe, slot, physics, _looks(root, cell.task, cell.embodiment, cell.domain == "randomized"))
    language = Key({"physics": physics.digest, "recipe": digest(spoken), **_language(root, cell.task)})
    return SlotKeys(physics, render, language)


def redrawn_keys(recipe: Recipe, slot: Slot, source: SlotKeys) -> SlotKeys:
    """The keys of a slot that is drawn again from an episode with the keys `source`: those that a build would give it, where what
    its physics and its looks were made from is still the same."""
    return SlotKeys(source.physics, _render_key(recipe, slot, source.physics, source.render.parts["looks"]), source.language)


def _render_key(recipe: Recipe, slot: Slot, physics: Key, looks: str) -> Key:
    given = _given(recipe)
    drawn = {name: given[name] for name in (*FOR_IMAGES, "camera") if name in given}
    used = set(slot.cell.embodiment.split("+"))
    drawn["robot_meshes"] = {name: key for name, key in recipe.robot_meshes.items() if name in used}
    if recipe.visuals != "randomized":
        drawn.pop("visual_seed", None)
    if slot.variant:
        drawn["variant"] = slot.variant
    parts = {"physics": physics.digest, "recipe": digest(drawn), "looks": looks}
    return Key(parts | _drawing_parts(sources.package_root()))


def _given(recipe: Recipe) -> dict[str, Any]:
    """The recipe's values that can change a slot.

    Defaults are left out, so that a key which a later version adds changes nothing; a frozen recipe has all values written out.
    """
    return recipe.model_dump(mode="json", exclude=set(CHOOSING), exclude_defaults=True)


def code_version() -> str:
    """One hash of everything that can change any slot: for provenance, and to see that all workers run the same code."""
    root = sources.package_root()
    robots = [m for name in MODELS for m in _robot_files(root, name)]
    known = sources.closure(root, [*CORE, *DRAWING, *LANGUAGE, *_modules_of([*TASKS.values(), *FAMILIES.values()]), *robots])
    files = [_files_hash(root, where) for where in ("world/shaders", "tasks/library/phrases", "world/objects/phrases")]
    return digest([sources.sources_hash(root, known), files, _packages(root, known)])


@cache
def _core(root: Path) -> frozenset[str]:
    return sources.closure(root, CORE, (*REGISTERED, *LOOKS, *LANGUAGE, *NEUTRAL))


def _physics(root: Path, cell: Cell) -> dict[str, str]:
    return _parts(root, cell.task, cell.embodiment, cell.domain == "randomized")


@cache
def _parts(root: Path, task: str, embodiment: str, randomized: bool) -> dict[str, str]:
    core, own = _core(root), _task_modules(root, task)
    objects = _object_modules(root, task, randomized)
    robot = _robot_modules(root, embodiment)
    used = core | own | objects | robot
    return {
        "core": sources.sources_hash(root, core),
        "task": sources.sources_hash(root, own - core),
        "objects": sources.sources_hash(root, objects - core),
        "robot": sources.sources_hash(root, robot - core),
        "packages": _packages(root, used),
    }


@cache
def _drawing_parts(root: Path) -> dict[str, str]:
    """What draws any episode from what it was stored with: the same for all tasks and robots."""
    drawing = sources.closure(root, DRAWING, (*REGISTERED, *LANGUAGE, *NEUTRAL))
    return {
        "renderer": sources.sources_hash(root, drawing),
        "shaders": _files_hash(root, "world/shaders"),
        "packages": _packages(root, drawing),
    }


@cache
def _looks(root: Path, task: str, embodiment: str, randomized: bool) -> str:
    """What gives the bodies of a slot their look."""
    roots = [*_object_modules(root, task, randomized), *_robot_modules(root, embodiment)]
    return sources.sources_hash(root, {m for m in sources.closure(root, roots, REGISTERED) if m in LOOKS})


@cache
def _language(root: Path, task: str) -> dict[str, str]:
    named = families_of(root, {m for m in _task_modules(root, task) if m.startswith(REGISTERED[0])})
    return {
        "phrases": _files_hash(root, f"tasks/library/phrases/{task}.txt"),
        "descriptions": digest({name: _files_hash(root, f"world/objects/phrases/{name}.txt") for name in sorted(named)}),
        "grammar": sources.sources_hash(root, LANGUAGE),
    }


def _task_modules(root: Path, task: str) -> frozenset[str]:
    return sources.closure(root, _modules_of([TASKS[task]]), (*LOOKS, *LANGUAGE, *NEUTRAL))


def families_of(root: Path, modules: Iterable[str]) -> frozenset[str]:
    """Object families that some modules may use: those whose names stand in them as strings."""
    return frozenset().union(*(sources.source(root, m).strings for m in modules)) & FAMILIES.keys()


def _object_modules(root: Path, task: str, randomized: bool) -> frozenset[str]:
    naming = {m for m in _task_modules(root, task) if m.startswith(REGISTERED[0])} | ({RANDOMIZED} if randomized else set())
    roots = _modules_of(FAMILIES[name] for name in families_of(root, naming))
    return sources.closure(root, roots, (*LOOKS, *LANGUAGE, *NEUTRAL))


def _robot_modules(root: Path, embodiment: str) -> frozenset[str]:
    roots = [m for name in embodiment.split("+") for m in _robot_files(root, name)]
    return sources.closure(root, roots, (*LOOKS, *LANGUAGE, *NEUTRAL))


def _robot_files(root: Path, robot: str) -> list[str]:
    """Modules that register a robot: those below models/ in which its name stands as a string."""
    return [m for m in sources.modules(root) if m.startswith(REGISTERED[2]) and robot in sources.source(root, m).strings]


def _modules_of(registered: Iterable[object]) -> list[str]:
    """Modules in which tasks (instances) and families (classes) are written."""
    return sorted({str(x.__module__) for x in registered})


@cache
def _files_hash(root: Path, where: str) -> str:
    path = root / where
    files = sorted(f for f in path.rglob("*") if f.is_file()) if path.is_dir() else [path] if path.is_file() else []
    return digest([[f.relative_to(root).as_posix(), f.read_bytes().hex()] for f in files])


def _packages(root: Path, modules: Iterable[str]) -> str:
    names = frozenset().union(*(sources.source(root, m).foreign for m in modules))
    return digest({name: _version(NUMERIC[name]) for name in sorted(names & NUMERIC.keys())})


@cache
def _version(distribution: str) -> str:
    try:
        return version(distribution)
    except PackageNotFoundError:
        return ""
