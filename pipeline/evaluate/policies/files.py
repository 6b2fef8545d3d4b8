"""Python files and weights that policies come from."""

import hashlib
import importlib.util
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import ModuleType

from pipeline.data.reading import open_regular
from pipeline.evaluate.policies.policy import PolicyError, foreign

CODE = (".py", ".yml", ".yaml", ".json")
WEIGHTS = (
    ".pt",
    ".pth",
    ".ckpt",
    ".bin",
    ".safetensors",
    ".npz",
    ".npy",
    ".pkl",
    ".onnx",
    ".h5",
    ".msgpack",
)


def digest_of(files: Iterable[Path]) -> str:
    """Short hash of the bytes of files. Raises PolicyError for one that cannot be read."""
    digest = hashlib.sha256()
    for path in files:
        try:
            with open_regular(path) as file:
                digest.update(hashlib.file_digest(file, "sha256").digest())
        except OSError as error:
            raise PolicyError(f"--policy {path}: cannot be read ({error.strerror})") from error
    return digest.hexdigest()[:8]


def files_of(folder: Path, values: object) -> list[Path]:
    """Code, settings and weights of a policy, sorted: those below its directory, and those below
    every path that `values`, the options of the policy, name, from here or from its directory."""
    found = {path for path in _below(folder) if path.suffix in (*CODE, *WEIGHTS)}
    for text in _texts(values):
        for place in (Path(text), folder / text):
            if place.is_file():
                found.add(place.resolve())
            elif place.is_dir() and place.resolve() not in (folder, *folder.parents):
                found |= {path for path in _below(place.resolve()) if path.suffix in WEIGHTS}
    return sorted(found)


def _below(folder: Path) -> Iterator[Path]:
    return (path for path in folder.rglob("*") if path.is_file())


def _texts(values: object) -> Iterator[str]:
    """All texts in plain data that could be paths."""
    if isinstance(values, str) and 0 < len(values) < 1000 and "\0" not in values:
        yield values
    elif isinstance(values, dict | list):
        for value in values.values() if isinstance(values, dict) else values:
            yield from _texts(value)


def module_of(path: Path) -> ModuleType:
    """The module in a file. Raises PolicyError if it cannot be loaded."""
    spec = importlib.util.spec_from_file_location(f"domino_policy_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise PolicyError(f"{path}: is no Python file")
    module = importlib.util.module_from_spec(spec)
    with foreign(f"{path}: cannot be loaded"):
        spec.loader.exec_module(module)
    return module
