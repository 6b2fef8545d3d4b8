"""Which of the project's sources can change what: the import graph of the package, read from the files, and hashes of parts of it.

Sources are compared by their syntax trees without docstrings, so that a comment, a docstring or a line break changes no hash.
"""

import ast
import hashlib
import json
import sys
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import pipeline
from pipeline.plugins import outside_modules

PACKAGE = pipeline.__name__

TEXTS = ("assets/robots", "world/drawing/shaders", "tasks/library", "world/objects/families")
"""Directories of the package with files that are no modules and count as sources."""

NUMERIC = {
    **{name: name for name in ("coal", "manifold3d", "numba", "numpy", "sapien", "scipy", "trimesh")},
    "cv2": "opencv-python-headless",
}
"""Packages whose numbers matter: imported module and distribution."""


@dataclass(frozen=True)
class Source:
    """One module: its hash, and the project's modules and the foreign packages that it imports."""

    hash: str
    imports: frozenset[str]
    foreign: frozenset[str]


def package_root() -> Path:
    """Directory of the package."""
    return Path(next(iter(pipeline.__path__)))


@cache
def modules(root: Path) -> dict[str, Path]:
    """Every module below a package directory, by dotted name; a package goes by its own name."""
    found = {}
    for path in sorted(root.rglob("*.py")):
        parts = path.relative_to(root).with_suffix("").parts
        found[".".join([PACKAGE, *(parts[:-1] if parts[-1] == "__init__" else parts)])] = path
    return found


def files(root: Path, where: str) -> list[Path]:
    """Every file at or below a path of the package that is no module, sorted."""
    path = root / where
    below = path.rglob("*") if path.is_dir() else [path]
    return sorted(f for f in below if f.is_file() and f.suffix not in (".py", ".pyc"))


@cache
def versions() -> dict[str, str]:
    """Versions of the packages NUMERIC, "" for one that is not installed."""
    return {name: installed_version(distribution) for name, distribution in sorted(NUMERIC.items())}


def installed_version(distribution: str) -> str:
    """The version of a package, "" for one that is not installed."""
    try:
        return version(distribution)
    except PackageNotFoundError:
        return ""


@cache
def fingerprint(root: Path) -> str:
    """One hash (32 hex digits) of everything that parts of the code are made from: the bytes of all modules and TEXTS, `versions`,
    and Python, whose parser makes the syntax trees."""
    paths = [*modules(root).values(), *(path for where in TEXTS for path in files(root, where))]
    sums = [[path.relative_to(root).as_posix(), hashlib.sha256(path.read_bytes()).hexdigest()] for path in paths]
    return hashlib.sha256(json.dumps([sums, versions(), sys.version]).encode()).hexdigest()[:32]


@cache
def source(root: Path, module: str) -> Source:
    """What a module is and imports. Imports that only a type checker sees do not count."""
    known = modules(root)
    outside = {} if module in known else outside_modules() | {module: Path(str(sys.modules[module].__file__))}
    path = known[module] if module in known else outside[module]
    return _read(path.read_text("utf-8"), module, frozenset(known.keys() | outside.keys()))


@lru_cache(maxsize=2048)
def _read(text: str, module: str, known: frozenset[str]) -> Source:
    tree = ast.parse(text)
    imports: set[str] = set()
    foreign: set[str] = set()
    for node in _runtime(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            # a name of `from package import name` may be a module of the package
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
            names = [n for n in names if n in known] if node.module in known else [node.module]
        else:
            continue
        for name in names:
            if name in known:
                imports.add(name)
            elif name.split(".")[0] != PACKAGE:
                foreign.add(name.split(".")[0])
    return Source(_tree_hash(tree), frozenset(imports - {module}), frozenset(foreign))


def _runtime(tree: ast.AST) -> Iterable[ast.AST]:
    """All nodes but those under `if TYPE_CHECKING:`."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            continue
        yield node
        yield from _runtime(node)


def _tree_hash(tree: ast.Module) -> str:
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            kept = [n for n in node.body if not (isinstance(n, ast.Expr) and isinstance(n.value, ast.Constant))]
            node.body = kept or [ast.Pass()]
    return hashlib.sha256(ast.dump(tree).encode()).hexdigest()


def closure(root: Path, start: Iterable[str], stop: Collection[str] = ()) -> frozenset[str]:
    """The modules `start` and everything of the project that they import, directly or not.

    A module of `stop`, or below a package of `stop`, is not entered unless it is in `start`.
    """
    return _closure(root, frozenset(start), frozenset(stop))


@lru_cache(maxsize=4096)
def _closure(root: Path, start: frozenset[str], stop: frozenset[str]) -> frozenset[str]:
    below = tuple(f"{package}." for package in stop)
    found: set[str] = set()
    queue = list(start)
    while queue:
        module = queue.pop()
        if module not in found:
            found.add(module)
            queue += [m for m in source(root, module).imports if m not in stop and not m.startswith(below)]
    return frozenset(found)


def sources_hash(root: Path, names: Iterable[str]) -> str:
    """One hash (32 hex digits) of a set of modules."""
    parts = [f"{name}:{source(root, name).hash}" for name in sorted(names)]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:32]
