"""Hashes of the files that can change an episode; imports no simulator.

Comments, docstrings and line breaks change no hash.
"""

import ast
import hashlib
import re
from collections.abc import Iterator
from functools import cache
from importlib.metadata import version
from pathlib import Path

import pipeline
from pipeline.data.keys import digest
from pipeline.plugins import directories, outside_modules

PACKAGE = Path(next(iter(pipeline.__path__)))

REGISTERED = ("tasks/library", "world/objects/families", "motion/models")
LANGUAGE = ("tasks/language", "world/objects/words.py")
OF_DRAWING = ("stages/drawing", "world/drawing", "world/looks")
CORE = (
    *("stages", "tasks", "expert", "planning", "motion", "world", "poses.py"),
    *("data/cameras.py", "data/clock.py", "data/joints.py", "data/setup/rules.py", "data/spec.py"),
    *("data/episode/events.py", "data/episode/state_log.py"),
)
NOT_CORE = (*REGISTERED, *LANGUAGE, *OF_DRAWING)
PHYSICS_PACKAGES = ("manifold3d", "numba", "numpy", "sapien", "scipy", "trimesh")
SHADERS = ("world/drawing/shaders",)
DRAWING = (
    *OF_DRAWING,
    *("world/cameras.py", "world/files.py", "world/shapes.py", "poses.py"),
    *("data/setup/brought.py", "data/cameras.py"),
    *("data/imperfections.py", "data/episode/visuals.py"),
)
DRAWING_PACKAGES = ("numba", "numpy", "opencv-python-headless", "sapien")

_STATED_TEXT = re.compile(
    r"""Expr\(value=Constant\(value=('(?:[^'\\]|\\.)*'|"(?:[^"\\]|\\.)*")\)\)(, )?"""
)
"""A statement that is a text, as `ast.dump` writes it."""


def code_version() -> str:
    """One hash of all that can change any slot: our code, robots and packages, and extensions."""
    outside = [*outside_modules().values()]
    for folder in directories():
        outside += [*files_below(folder / "robots"), *files_below(folder / "objects")]
    own = hash_files(PACKAGE, (*CORE, *DRAWING, "assets"))
    extensions = sorted([path.name, hash_file(path)] for path in outside)
    return digest([own, extensions, versions((*PHYSICS_PACKAGES, *DRAWING_PACKAGES))])


def policy_version() -> str:
    """A hash of the code by which policies act, are corrected and are scored."""
    return hash_files(PACKAGE, ("evaluate",), ("evaluate/templates",))


def shared_physics(root: Path | None = None) -> dict[str, str]:
    """The parts of a physics key that are the same for every slot."""
    own = hash_files(root or PACKAGE, CORE, NOT_CORE)
    return {"core": own, "packages": versions(PHYSICS_PACKAGES)}


@cache
def hash_files(root: Path, where: tuple[str, ...], without: tuple[str, ...] = ()) -> str:
    """One hash of all files below some paths, but `without`."""
    found = {path for each in where for path in files_below(root / each)}
    found -= {path for each in without for path in files_below(root / each)}
    return digest([[path.relative_to(root).as_posix(), hash_file(path)] for path in sorted(found)])


def files_below(path: Path) -> Iterator[Path]:
    """The files at or below a path, but those that Python makes."""
    below = path.rglob("*") if path.is_dir() else [path]
    return (each for each in below if each.is_file() and "__pycache__" not in each.parts)


@cache
def hash_file(path: Path) -> str:
    """A hash of a file's bytes; of a Python file, of its syntax tree without docstrings."""
    content = path.read_bytes()
    if path.suffix == ".py":
        tree = _STATED_TEXT.sub("", ast.dump(ast.parse(content)))
        content = tree.replace(", ]", "]").encode()
    return hashlib.sha256(content).hexdigest()[:32]


@cache
def versions(distributions: tuple[str, ...]) -> str:
    """A hash of the installed versions of packages."""
    return digest({name: version(name) for name in distributions})
