"""The keys of a slot: what can change its physics, its images (`render`) and its sentences
(`language`). Each later key includes `physics`.

The core counts as a whole; of REGISTERED, only the files that the slot's classes inherit.
"""

import sys
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from pipeline.data.keys import Key, SlotKeys, digest, file_hash
from pipeline.data.names import NONE
from pipeline.data.process.own_code import is_outside
from pipeline.data.recipe.model import CHOOSING, Recipe, RecipeError, Slot
from pipeline.data.setup import IMAGES
from pipeline.data.setup.rules import Rules
from pipeline.data.slots.records import slot_part
from pipeline.motion.models import MODELS as MOTIONS
from pipeline.motion.wrapped import CARRIED
from pipeline.plugins import outside_modules
from pipeline.run.names import add_originals
from pipeline.stages.surroundings import CLUTTER_FAMILIES
from pipeline.tasks import TASKS
from pipeline.tasks.layout import families_of
from pipeline.world.objects.contract import FAMILIES, directory_of
from pipeline.world.robots import MODELS, OURS

from . import core


@dataclass(frozen=True)
class CellCode:
    """What of the code decides the slots of a cell: hashes by name, `looks` one hash."""

    physics: dict[str, str]
    looks: str
    language: dict[str, str]


@cache
def cell_code(root: Path, task: str, robots: str, randomized: bool, motion: str | None) -> CellCode:
    """What decides a cell's slots; `motion` None: the task's own. Raises UnknownName."""
    this = TASKS[task]
    named = sorted(families_of(this))
    placed = sorted({*named, *(CLUTTER_FAMILIES if randomized else ())})
    contents = robot_contents(root, robots)
    motions = (motion or this.motion, *(m for m in this.movers.values() if m != CARRIED))
    physics = {
        **core.shared_physics(root),
        "task": _hash_modules(root, [this]),
        "objects": _hash_modules(root, [FAMILIES[name] for name in placed]),
        "robot": digest([robots, [content["physics"] for content in contents]]),
        "motion": _hash_modules(root, [MOTIONS[name] for name in motions]),
    }
    language = {
        "phrases": _hash_phrases(root, this, task),
        "descriptions": digest({n: _hash_phrases(root, FAMILIES[n], n) for n in named}),
        "grammar": core.hash_files(root, core.LANGUAGE),
    }
    return CellCode(physics, digest([content["looks"] for content in contents]), language)


@cache
def drawing_code(root: Path) -> dict[str, str]:
    """What draws any episode: equal for all tasks and robots."""
    return {
        "renderer": core.hash_files(root, core.DRAWING, core.SHADERS),
        "shaders": core.hash_files(root, core.SHADERS),
        "packages": core.versions(core.DRAWING_PACKAGES),
    }


@cache
def robot_contents(root: Path, embodiment: str) -> list[dict[str, str]]:
    """What the directories of an embodiment's robots hold: `physics` and `looks` of each."""
    package = OURS.parents[1]
    directories = [MODELS[name].directory for name in embodiment.split("+") if name != NONE]
    return [
        content_key(root / each.relative_to(package) if each.is_relative_to(package) else each)
        for each in directories
    ]


def object_contents(task: str, randomized: bool, rules: Rules) -> dict[str, str]:
    """Contents of the objects from files for a task: `physics` and `looks`; empty for none.
    Raises UnknownName.
    """
    own, others = dict(rules.within(task).objects), dict(rules.objects if randomized else ())
    used = [(family, own[family]) for family in sorted(own.keys() & families_of(TASKS[task]))]
    used += [(family, others[family]) for family in sorted(others.keys() & {*CLUTTER_FAMILIES})]
    held = [(family, [object_content(name) for name in names]) for family, names in used]
    kinds = ("physics", "looks") if held else ()
    return {
        kind: digest([[f, [each[kind] for each in all_of]] for f, all_of in held]) for kind in kinds
    }


def object_content(name: str) -> dict[str, str]:
    """Hashes of an object. Raises UnknownName."""
    files = directory_of(FAMILIES[name])
    return {"physics": name, "looks": name} if files is None else content_key(files.path)


def content_key(directory: Path) -> dict[str, str]:
    """Hashes of a directory's GLB meshes (`looks`), and of all its other files (`physics`)."""
    files = sorted(p for p in directory.rglob("*") if p.is_file() and not p.name.startswith("."))
    hashes = {p.relative_to(directory).as_posix(): file_hash(p) for p in files}
    looks = {name: value for name, value in hashes.items() if name.endswith(".glb")}
    physics = {name: value for name, value in hashes.items() if name not in looks}
    return {"looks": digest(looks), "physics": digest(physics)}


def _hash_modules(root: Path, items: Iterable[object]) -> str:
    """A hash of the files that define items and their bases. Any of a plugin stands for all
    plugin files.
    """
    classes = [each if isinstance(each, type) else type(each) for each in items]
    names = {base.__module__ for each in classes for base in each.__mro__}
    ours = {"/".join(name.split(".")[1:]) for name in names if name.startswith("pipeline.")}
    own = sorted(f"{path}.py" for path in ours if path.startswith(core.REGISTERED))
    plugins = outside_modules() if any(map(is_outside, classes)) else {}
    outside = sorted((name, core.hash_file(path)) for name, path in plugins.items())
    return digest([core.hash_files(root, tuple(own)), outside])


def _hash_phrases(root: Path, item: object, name: str) -> str:
    """A hash of a task's or family's phrases."""
    module = str(item.__module__)
    if module.startswith("pipeline."):
        folder = "/".join(module.split(".")[1:-1])
        return core.hash_files(root, (f"{folder}/phrases/{name}.txt",))
    path = Path(str(sys.modules[module].__file__))
    text = path.parent / "phrases" / f"{name}.txt"
    return digest([text.read_text("utf-8") if text.is_file() else "", core.hash_file(path)])


class RecipeKeys:
    """The keys of a recipe's slots with the present code and packages."""

    def __init__(self, recipe: Recipe) -> None:
        self._recipe, self._root = recipe, core.PACKAGE
        self._placed: dict[tuple[str, bool], dict[str, str]] = {}
        if recipe.assets is not None:
            with suppress(RecipeError):  # slots whose objects are missing have no keys
                add_originals(recipe)
        # a frozen recipe has all values written out; without defaults, a key which a later version
        # adds changes nothing
        given = recipe.model_dump(mode="json", exclude=set(CHOOSING), exclude_defaults=True)
        # objects count by content
        every = {name: value for name, value in given.items() if name not in (*IMAGES, "objects")}
        if recipe.corrections:
            every["corrections"] = recipe.corrections.label  # wherever the policy is
        spoken = {"instructions": every.pop("instructions", None)}
        self._physics, self._language = digest(every), digest(spoken)
        for name, key in zip(("textures", "environment"), recipe.brought, strict=True):
            given |= {name: key} if name in given else {}
        self._drawn = {name: given[name] for name in (*IMAGES, "camera") if name in given}
        if recipe.visuals != "randomized":
            self._drawn.pop("visual_seed", None)

    def of(self, slot: Slot) -> SlotKeys:
        """The keys of a slot. Raises UnknownName for a task that the code does not have."""
        cell, root = slot.cell, self._root
        randomized = cell.domain == "randomized"
        parts = cell_code(root, cell.task, cell.embodiment, randomized, self._recipe.motion)
        own = {"slot": slot_part(slot), "recipe": self._physics}
        acting = {"policy": core.policy_version()} if self._recipe.corrections else {}
        # what bodies look like decides which attempts are accepted
        if self._recipe.view == "unoccluded":
            acting["view"] = digest([drawing_code(root), parts.looks])
        looks = parts.looks
        if self._recipe.objects and (files := self._objects(cell.task, randomized)):
            looks = digest([looks, files["looks"]])
            acting["files"] = files["physics"]
        physics = Key(own | parts.physics | acting)
        language = Key({"physics": physics.digest, "recipe": self._language, **parts.language})
        return SlotKeys(physics, self._render(slot, physics, looks), language)

    def redrawn(self, slot: Slot, source: SlotKeys) -> SlotKeys:
        """The keys of a slot that is drawn again from an episode with the keys `source`."""
        looks = source.render.parts["looks"]
        return SlotKeys(source.physics, self._render(slot, source.physics, looks), source.language)

    def _objects(self, task: str, randomized: bool) -> dict[str, str]:
        """Contents of the objects from files for a task; may be empty."""
        if (task, randomized) not in self._placed:
            rules = Rules(objects=tuple(sorted(self._recipe.objects.items())))
            self._placed[task, randomized] = object_contents(task, randomized, rules)
        return self._placed[task, randomized]

    def _render(self, slot: Slot, physics: Key, looks: str) -> Key:
        drawn = self._drawn | ({"variant": slot.variant} if slot.variant else {})
        made = {"physics": physics.digest, "recipe": digest(drawn), "looks": looks}
        return Key(made | drawing_code(self._root))
