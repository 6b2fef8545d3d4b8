"""What made a dataset: provenance.json."""

import platform
from importlib import metadata
from pathlib import Path
from typing import Any

from pipeline.data.atomic import write_atomic
from pipeline.data.dataset import Dataset
from pipeline.data.keys import seal
from pipeline.data.recipe.model import Recipe
from pipeline.data.setup.brought import Brought
from pipeline.world.objects.contract import FAMILIES, directory_of
from pipeline.world.robots.pairs import MODELS

from .identity.core import code_version

_PACKAGES = (
    *("domino-data", "sapien", "numpy", "numba", "h5py"),
    *("opencv-python-headless", "ray", "pyarrow"),
)


def write_provenance(dataset: Dataset, renderer: str, recipe: Recipe, **more: Any) -> None:
    """Write what made the dataset: code hash, licences, machine, renderer; no clock."""
    values = {"code_version": code_version(), "licences": licences_of(recipe)}
    values |= machine() | {"renderer": renderer} | more
    write_atomic(dataset.provenance, seal(values))


def machine() -> dict[str, Any]:
    """What physics depends on beside the code: packages, Python, processor."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    names = (line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    return {
        "packages": {name: installed_version(name) or "missing" for name in _PACKAGES},
        "python": platform.python_version(),
        "platform": platform.platform(),
        "processor": next(names, platform.processor()),
    }


def installed_version(distribution: str) -> str:
    """The version of a package, "" for one that is not installed."""
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return ""


def licences_of(recipe: Recipe) -> dict[str, str]:
    """Of the robots, of what the recipe brings for the room, and of the objects from files."""
    licences = {name: MODELS[name].settings.licence for name in recipe.robots() if name in MODELS}
    for key in ("textures", "environment"):
        if isinstance(brought := getattr(recipe, key), Brought):
            licences[key] = brought.licence
    for name in (name for names in recipe.objects.values() for name in names):
        if files := directory_of(FAMILIES[name]):
            licences[name] = files.settings.licence
    return licences
