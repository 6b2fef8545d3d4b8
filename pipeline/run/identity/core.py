"""Hashes of the package's files; imports no simulator."""

import ast
import hashlib
import re
from collections.abc import Iterator
from functools import cache
from importlib.metadata import version
from pathlib import Path

import pipeline
from pipeline.data.keys import digest

REGISTERED = ("tasks/library", "world/objects/families", "motion/models")
LANGUAGE = ("tasks/language", "world/objects/words.py")
OF_DRAWING = ("stages/drawing", "world/drawing", "world/looks")
CORE = (
    *("stages", "tasks", "expert", "planning", "motion", "world", "poses.py"),
    *("data/cameras.py", "data/clock.py", "data/setup/rules.py", "data/spec.py"),
    *("data/episode/events.py", "data/episode/state_log.py"),
)
NOT_CORE = (*REGISTERED, *LANGUAGE, *OF_DRAWING)
PHYSICS_PACKAGES = ("manifold3d", "numba", "numpy", "sapien", "scipy", "trimesh")

_STATED_TEXT = re.compile(
    r"""Expr\(value=Constant\(value=('(?:[^'\\]|\\.)*'|"(?:[^"\\]|\\.)*")\)\)(, )?"""
)
"""A statement that is a text, as `ast.dump` writes it."""


def package_root() -> Path:
    """Directory of the package."""
    return Path(next(iter(pipeline.__path__)))


def shared_physics(root: Path) -> dict[str, str]:
    """The parts of a physics key that are the same for every slot."""
    return {"core": hash_files(root, CORE, NOT_CORE), "packages": versions(PHYSICS_PACKAGES)}


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
