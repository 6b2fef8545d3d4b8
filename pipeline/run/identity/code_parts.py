"""What of the code can change a slot, part by part: hashes of sources, texts and package versions (run/identity/slot_keys.py).

`physics`: the core (everything that the three stages import), the sources of this task, of its object families, of this robot and
of the model of its motion, and the versions of the packages whose numbers matter. `looks`: the modules that only give the bodies of
a slot their look. `language`: templates, descriptions of the task's object families and grammar. `drawing_parts`: what draws any
episode from what it was stored with.
"""

import sys
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

from pipeline.data.keys import digest
from pipeline.data.names import NONE
from pipeline.data.rules import Rules
from pipeline.motion.models import MODELS as MOTIONS
from pipeline.run.identity import sources
from pipeline.stages.surroundings import CLUTTER_FAMILIES
from pipeline.tasks import TASKS
from pipeline.tasks.layout import families_of
from pipeline.world.objects.contract import FAMILIES
from pipeline.world.objects.from_files import directory_of
from pipeline.world.robots import MODELS, OURS
from pipeline.world.robots.directory import content_key

CORE = ("pipeline.stages.attempt", "pipeline.motion.recorded.group")
DRAWING = ("pipeline.stages.drawing.render", "pipeline.stages.drawing.tracks")
STANDS = ("pipeline.world.robots.stands",)
READING = ("pipeline.world.objects.from_files",)
LANGUAGE = ("pipeline.tasks.language", "pipeline.world.objects.words")

REGISTERED = ("pipeline.tasks.library", "pipeline.world.objects.families", "pipeline.motion.models")
"""Packages whose modules register themselves: the core imports them all, a slot uses a few, which are parts of their own."""

_SURFACES = ("materials", "textures", "visuals", "patterns", "tabletops", "walls", "prints", "png")
LOOKS = (
    *(f"pipeline.world.looks.{name}" for name in _SURFACES),
    *("pipeline.world.drawing.room", "pipeline.data.brought"),
)
"""Modules that give bodies their look and cannot move anything: they count for the images only."""

NEUTRAL = (
    *("pipeline.data.errors", "pipeline.data.parsing", "pipeline.data.reading"),
    *("pipeline.data.setup", "pipeline.data.sensors", "pipeline.data.recipe.model"),
)
"""Modules that the stages import and that decide nothing by themselves: what a recipe says is a part of its own."""


def code_version(root: Path) -> str:
    """One hash of everything that can change any slot."""
    registered = _modules_of([*TASKS.values(), *FAMILIES.values(), *MOTIONS.values()])
    known = sources.closure(root, [*CORE, *DRAWING, *LANGUAGE, *registered])
    robots = [robot_keys(root, name) for name in MODELS]
    objects = {name: content_key(files.path) for name, family in FAMILIES.items() if (files := directory_of(family))}
    files = [_files_hash(root, where) for where in sources.TEXTS]
    return digest([sources.sources_hash(root, known), robots, files, _packages(root, known), *([objects] if objects else [])])


def slot_parts(root: Path, task: str, embodiment: str, randomized: bool, motion: str | None = None) -> dict[str, Any]:
    """The parts of a cell's slots, plain data: `physics` and `language` by name, `looks` one hash. `motion` is the model of the
    target's motion, None for the task's own. Raises UnknownName for a task or a motion that the code does not have."""
    return {
        "physics": _physics(root, task, embodiment, randomized, (motion or TASKS[task].motion, *TASKS[task].movers.values())),
        "looks": _looks(root, task, embodiment, randomized),
        "language": _language(root, task),
    }


@cache
def robot_keys(root: Path, embodiment: str) -> list[dict[str, str]]:
    """What the directories of an embodiment's robots hold: `physics` and `looks` by robot."""
    directories = [MODELS[name].directory for name in embodiment.split("+") if name != NONE]
    package = OURS.parents[1]
    return [content_key(root / d.relative_to(package) if d.is_relative_to(package) else d) for d in directories]


@cache
def object_parts(root: Path, task: str, randomized: bool, wanted: tuple[tuple[str, tuple[str, ...]], ...]) -> dict[str, str]:
    """The content of the objects that stand for families of a task, as `wanted` says: `physics` and `looks`, or neither where none
    of its families is named. Raises UnknownName for an object that does not exist."""
    own, others = dict(Rules(objects=wanted).within(task).objects), dict(wanted if randomized else ())
    used = [(family, own[family]) for family in sorted(own.keys() & families_of(TASKS[task]))]
    used += [(family, others[family]) for family in sorted(others.keys() & {*CLUTTER_FAMILIES})]
    held = [[family, [content_of(name) for name in names]] for family, names in used]
    if not held:
        return {}
    code = sources.sources_hash(root, sources.closure(root, READING, (*REGISTERED, *LOOKS, *LANGUAGE, *NEUTRAL)))
    parts = {kind: [[family, [each[kind] for each in all_of]] for family, all_of in held] for kind in ("physics", "looks")}
    return {"physics": digest([code, parts["physics"]]), "looks": digest(parts["looks"])}


def content_of(name: str) -> dict[str, str]:
    """The content of an object from files, as of a robot's directory. Raises UnknownName for one that does not exist."""
    files = directory_of(FAMILIES[name])
    return {"physics": name, "looks": name} if files is None else content_key(files.path)


@cache
def _core(root: Path) -> frozenset[str]:
    return sources.closure(root, CORE, (*REGISTERED, *LOOKS, *LANGUAGE, *NEUTRAL))


@cache
def _physics(root: Path, task: str, embodiment: str, randomized: bool, motions: tuple[str, ...]) -> dict[str, str]:
    core, own = _core(root), _task_modules(root, task)
    objects = _object_modules(root, task, randomized)
    moved = sources.closure(root, _modules_of([MOTIONS[motion] for motion in motions]), NEUTRAL)
    used = core | own | objects | moved
    return {
        "core": sources.sources_hash(root, core),
        "task": sources.sources_hash(root, own - core),
        "objects": sources.sources_hash(root, objects - core),
        "robot": digest([embodiment, [key["physics"] for key in robot_keys(root, embodiment)]]),
        "motion": sources.sources_hash(root, moved - core),
        "packages": _packages(root, used),
    }


@cache
def drawing_parts(root: Path) -> dict[str, str]:
    """What draws any episode from what it was stored with: the same for all tasks and robots."""
    drawing = sources.closure(root, DRAWING, (*REGISTERED, *LANGUAGE, *NEUTRAL))
    return {
        "renderer": sources.sources_hash(root, drawing),
        "shaders": _files_hash(root, "world/drawing/shaders"),
        "packages": _packages(root, drawing),
    }


@cache
def _looks(root: Path, task: str, embodiment: str, randomized: bool) -> str:
    """What gives the bodies of a slot their look."""
    modules = sources.closure(root, [*_object_modules(root, task, randomized), *STANDS], REGISTERED)
    return digest(
        [sources.sources_hash(root, {m for m in modules if m in LOOKS}), [key["looks"] for key in robot_keys(root, embodiment)]]
    )


@cache
def _language(root: Path, task: str) -> dict[str, str]:
    named = families_of(TASKS[task])
    return {
        "phrases": _phrases(root, TASKS[task], task),
        "descriptions": digest({name: _phrases(root, FAMILIES[name], name) for name in sorted(named)}),
        "grammar": sources.sources_hash(root, LANGUAGE),
    }


def _phrases(root: Path, item: object, name: str) -> str:
    """Hash of the phrases of a task or a family, which are beside its module or, of a plugin, in it."""
    module = str(item.__module__)
    if module in sources.modules(root):
        folder = "/".join(module.split(".")[1:-1])
        return _files_hash(root, f"{folder}/phrases/{name}.txt")
    text = Path(str(sys.modules[module].__file__)).parent / "phrases" / f"{name}.txt"
    return digest([text.read_text("utf-8") if text.is_file() else "", sources.source(root, module).hash])


def _task_modules(root: Path, task: str) -> frozenset[str]:
    return sources.closure(root, _modules_of([TASKS[task]]), (*LOOKS, *LANGUAGE, *NEUTRAL))


def _object_modules(root: Path, task: str, randomized: bool) -> frozenset[str]:
    named = families_of(TASKS[task]) | frozenset(CLUTTER_FAMILIES if randomized else ())
    return sources.closure(root, _modules_of(FAMILIES[name] for name in named), (*LOOKS, *LANGUAGE, *NEUTRAL))


def _modules_of(registered: Iterable[object]) -> list[str]:
    """Modules in which tasks (instances) and families (classes) are written."""
    return sorted({str(x.__module__) for x in registered})


@cache
def _files_hash(root: Path, where: str) -> str:
    return digest([[f.relative_to(root).as_posix(), f.read_bytes().hex()] for f in sources.files(root, where)])


def _packages(root: Path, modules: Iterable[str]) -> str:
    names = frozenset().union(*(sources.source(root, m).foreign for m in modules))
    return digest({name: version for name, version in sources.versions().items() if name in names})
