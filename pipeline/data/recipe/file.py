"""Recipe files: finding and reading them."""

from pathlib import Path
from typing import Any

import pipeline
from pipeline.data.keys import SEAL, is_unchanged
from pipeline.data.parsing import ParseError, read_mapping
from pipeline.data.setup import RecipeError

FOLDER = "manifests"


def shipped_folder() -> Path:
    """The folder of the recipes that ship with the package."""
    package = Path(str(pipeline.__file__)).parent
    inside = package / FOLDER  # in a wheel; beside the package in a checkout
    return inside if inside.is_dir() else package.parent / FOLDER


def shipped_recipes() -> dict[str, Path]:
    """The recipes that ship with the package, by name: "smoke", "paper/10-tasks", ..."""
    root = shipped_folder()
    return {
        path.relative_to(root).with_suffix("").as_posix(): path
        for path in sorted(root.rglob("*.yaml"))
    }


def find_recipe(given: Path) -> Path:
    """A recipe file as it is given, else the shipped one of that name."""
    name = given.with_suffix("").as_posix().removeprefix(f"{FOLDER}/")
    return given if given.exists() else shipped_recipes().get(name, given)


def read_recipe(path: Path) -> dict[str, Any]:
    """The keys of a recipe file. Raises RecipeError."""
    return {key: value for key, value in _read(path).items() if key != SEAL}


def is_edited(path: Path) -> bool:
    """Whether a sealed recipe file has other values than were written. Raises RecipeError."""
    values = _read(path)
    return SEAL in values and not is_unchanged(values)


def _read(path: Path) -> dict[str, Any]:
    try:
        return read_mapping(path, "levels: [1, 2]")
    except ParseError as error:
        raise RecipeError(str(error)) from error
