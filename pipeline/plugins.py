"""Extensions from outside the package, which register themselves: of entry points (GROUPS), and at
the top of the directories of DOMINO_PLUGINS, which --plugins sets and all workers have."""

import importlib
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path

from pipeline.data.errors import DominoError
from pipeline.data.process.machine import PLUGINS, directories
from pipeline.data.process.own_code import describe_error, line_of_error

GROUPS = tuple(
    f"domino_data.{kind}" for kind in ("tasks", "objects", "robots", "motions", "exporters")
)


class PluginError(DominoError):
    """A plugin that cannot be found or imported; the message is one line that names it."""


def load_plugins() -> None:
    """Import the extensions of entry points and of DOMINO_PLUGINS. Raises PluginError for a missing
    directory, and a module that cannot be imported or whose name another one has."""
    for point in _points():
        _import(point.module, f"entry point {point.name}")
    for directory in directories():
        if not os.path.isdir(directory):  # False also for a name that is too long
            raise PluginError(f"--plugins {directory}: is no directory")
        if str(directory) not in sys.path:
            sys.path.append(str(directory))
        if (directory / "robots").is_dir():
            # it takes a second, and most plugins bring no robot
            from pipeline.world.robots import register_all

            register_all(directory / "robots")
        for name in _top(directory):
            module = _import(name, f"--plugins {directory}")
            if directory not in Path(str(module.__file__)).resolve().parents:
                raise PluginError(
                    f"--plugins {directory}: another module is called {name!r} ({module.__file__});"
                    " rename yours"
                )
    for directory in directories():  # their families may be of another directory
        if (directory / "objects").is_dir():
            from pipeline.world.objects.from_files import add_all

            add_all(directory / "objects")


def use_plugins(added: Sequence[str]) -> None:
    """Add directories to DOMINO_PLUGINS, for this process and those that it starts."""
    paths = dict.fromkeys([*directories(), *(Path(each).resolve() for each in added)])
    if paths:
        os.environ[PLUGINS] = os.pathsep.join(map(str, paths))


def outside_modules() -> dict[str, Path]:
    """The modules of plugins by name."""
    modules = {}
    for directory in directories():
        modules |= dict(_modules(directory))
    for point in _points():
        package = point.module.partition(".")[0]
        if (top := sys.modules.get(package)) is None:
            continue
        for folder in getattr(top, "__path__", ()):
            modules |= {f"{package}.{name}": path for name, path in _modules(Path(folder))}
        if top.__file__:
            modules[package] = Path(top.__file__)
    return modules


def load_verb(point: EntryPoint) -> Callable[..., None]:
    """The function of an entry point that announces a command. Raises PluginError."""
    source = f"entry point {point.name}"
    verb = getattr(_import(point.module, source), point.attr, None)
    if verb is None:
        raise PluginError(f"{source}: {point.module} has no {point.attr}")
    return verb


def _points() -> list[EntryPoint]:
    """Entry points of GROUPS, from one reading of the metadata of all installed packages."""
    points = entry_points()
    return [point for group in GROUPS for point in points.select(group=group)]


def _import(name: str, source: str):
    try:
        return importlib.import_module(name)
    except (DominoError, KeyboardInterrupt):
        raise
    except BaseException as error:
        spec = find_spec(name.partition(".")[0])
        place = line_of_error(error, spec.origin) if spec else ""
        raise PluginError(f"{place or f'{source}: {name}'}: {describe_error(error)}") from error


def _top(directory: Path) -> list[str]:
    names = [path.stem for path in directory.glob("*.py")]
    names += [path.parent.name for path in directory.glob("*/__init__.py")]
    left_out = ("_", ".", "test", "setup", "conftest")
    return sorted(name for name in names if not name.startswith(left_out))


def _modules(directory: Path) -> Iterator[tuple[str, Path]]:
    for path in sorted(directory.rglob("*.py")):
        parts = path.relative_to(directory).with_suffix("").parts
        if all(part.isidentifier() for part in parts):
            yield ".".join(parts[:-1] if parts[-1] == "__init__" else parts), path
