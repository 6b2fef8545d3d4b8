"""What made a dataset: provenance.json."""

import platform
from pathlib import Path
from typing import Any

from pipeline.data.recipe.model import Recipe
from pipeline.data.setup.brought import Brought
from pipeline.run.checks.doctor import installed_version
from pipeline.run.identity.slot_keys import code_version
from pipeline.world.objects.contract import FAMILIES, directory_of
from pipeline.world.robots.pairs import MODELS

_PACKAGES = (
    "domino-data",
    "sapien",
    "numpy",
    "numba",
    "h5py",
    "opencv-python-headless",
    "ray",
    "pyarrow",
)


def provenance(renderer: str, recipe: Recipe) -> dict[str, Any]:
    """What made the dataset: hash of the code, package versions, Python, renderer, processor. No
    clock."""
    return {
        "code_version": code_version(),
        "licences": _licences(recipe),
        **machine(),
        "renderer": renderer,
    }


def machine() -> dict[str, Any]:
    """What the numbers of physics depend on beside the code: packages, Python, processor."""
    return {
        "packages": {name: installed_version(name) or "missing" for name in _PACKAGES},
        "python": platform.python_version(),
        "platform": platform.platform(),
        "processor": processor(),
    }


def _licences(recipe: Recipe) -> dict[str, str]:
    """Licences of the robots, of the objects from files, and of what the recipe brings for the
    room."""
    robots = {name: MODELS[name].settings.licence for name in recipe.robots() if name in MODELS}
    families = [(name, FAMILIES[name]) for names in recipe.objects.values() for name in names]
    brought = {"textures": recipe.textures, "environment": recipe.environment}
    own = {name: found.licence for name, found in brought.items() if isinstance(found, Brought)}
    return (
        robots
        | own
        | {
            name: files.settings.licence
            for name, family in families
            if (files := directory_of(family))
        }
    )


def processor() -> str:
    """Model name of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return next(
        (line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")),
        platform.processor(),
    )
