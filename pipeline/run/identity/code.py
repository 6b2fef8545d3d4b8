"""What of the code decides an episode, as hashes of files of the package.

CORE counts as a whole; of REGISTERED, only the files that the episode's classes inherit. Comments,
docstrings and line breaks change no hash.
"""

import sys
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pipeline
from pipeline.data.keys import digest, file_hash
from pipeline.data.names import NONE
from pipeline.data.setup.rules import Rules
from pipeline.motion.models import MODELS as MOTIONS
from pipeline.motion.wrapped import CARRIED
from pipeline.plugins import outside_modules
from pipeline.stages.surroundings import CLUTTER_FAMILIES
from pipeline.tasks import TASKS
from pipeline.tasks.layout import families_of
from pipeline.world.objects.contract import FAMILIES, directory_of
from pipeline.world.robots import MODELS, OURS

from .core import (
    CORE,
    LANGUAGE,
    OF_DRAWING,
    PHYSICS_PACKAGES,
    REGISTERED,
    hash_file,
    hash_files,
    shared_physics,
    versions,
)

SHADERS = ("world/drawing/shaders",)
DRAWING = (
    *OF_DRAWING,
    *("world/cameras.py", "world/files.py", "world/shapes.py", "poses.py"),
    *("data/setup/brought.py", "data/cameras.py"),
    *("data/imperfections.py", "data/episode/visuals.py"),
)
DRAWING_PACKAGES = ("numba", "numpy", "opencv-python-headless", "sapien")


@dataclass(frozen=True)
class CellCode:
    """What of the code decides the slots of a cell: hashes by name, `looks` one hash."""

    physics: dict[str, str]
    looks: str
    language: dict[str, str]


def code_version(root: Path) -> str:
    """One hash of all code that can change any slot."""
    objects = [name for name, family in FAMILIES.items() if directory_of(family)]
    return digest(
        [
            hash_files(root, (*CORE, *DRAWING)),
            _hash_modules(root, [*TASKS.values(), *FAMILIES.values(), *MOTIONS.values()]),
            [robot_contents(root, name) for name in MODELS],
            [object_content(name) for name in objects],
            sorted((name, hash_file(path)) for name, path in outside_modules().items()),
            versions((*PHYSICS_PACKAGES, *DRAWING_PACKAGES)),
        ]
    )


@cache
def cell_code(root: Path, task: str, robots: str, randomized: bool, motion: str | None) -> CellCode:
    """What decides a cell's slots; `motion` None: the task's own. Raises UnknownName."""
    this = TASKS[task]
    named = sorted(families_of(this))
    placed = sorted({*named, *(CLUTTER_FAMILIES if randomized else ())})
    contents = robot_contents(root, robots)
    motions = (motion or this.motion, *(m for m in this.movers.values() if m != CARRIED))
    physics = {
        **shared_physics(root),
        "task": _hash_modules(root, [this]),
        "objects": _hash_modules(root, [FAMILIES[name] for name in placed]),
        "robot": digest([robots, [content["physics"] for content in contents]]),
        "motion": _hash_modules(root, [MOTIONS[name] for name in motions]),
    }
    language = {
        "phrases": _hash_phrases(root, this, task),
        "descriptions": digest({n: _hash_phrases(root, FAMILIES[n], n) for n in named}),
        "grammar": hash_files(root, LANGUAGE),
    }
    return CellCode(physics, digest([content["looks"] for content in contents]), language)


@cache
def drawing_code(root: Path) -> dict[str, str]:
    """What draws any episode: equal for all tasks and robots."""
    return {
        "renderer": hash_files(root, DRAWING, SHADERS),
        "shaders": hash_files(root, SHADERS),
        "packages": versions(DRAWING_PACKAGES),
    }


@cache
def evaluation_code(root: Path) -> str:
    """A hash of the code by which policies act, are corrected and are scored."""
    return hash_files(root, ("evaluate",), ("evaluate/templates",))


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
    ours = {"/".join(name.split(".")[1:]) for name in names if _is_ours(name)}
    own = sorted(f"{path}.py" for path in ours if path.startswith(REGISTERED))
    plugins = outside_modules() if any(not _is_ours(each.__module__) for each in classes) else {}
    outside = sorted((name, hash_file(path)) for name, path in plugins.items())
    return digest([hash_files(root, tuple(own)), outside])


def _is_ours(module: str) -> bool:
    return module.partition(".")[0] == pipeline.__name__


def _hash_phrases(root: Path, item: object, name: str) -> str:
    """A hash of a task's or family's phrases."""
    module = str(item.__module__)
    if _is_ours(module):
        return hash_files(root, ("/".join([*module.split(".")[1:-1], "phrases", f"{name}.txt"]),))
    path = Path(str(sys.modules[module].__file__))
    text = path.parent / "phrases" / f"{name}.txt"
    return digest([text.read_text("utf-8") if text.is_file() else "", hash_file(path)])
