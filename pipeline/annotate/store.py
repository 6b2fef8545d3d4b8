"""Writes and checks annotation files."""

import json
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from pipeline.data.atomic import atomic_path, write_atomic
from pipeline.data.episode.hdf5 import new_hdf5, open_hdf5
from pipeline.data.keys import canonical
from pipeline.data.slots.annotations import (
    CorruptAnnotation,
    Entry,
    checksum,
    read_entry,
    stages_of,
)
from pipeline.data.store.place import put

from .stage import AnnotateError

CHUNK_BYTES = 1 << 20


def episode_paths(dataset: Path) -> list[Path]:
    """Episode files relative to `dataset`/episodes, sorted. Raises AnnotateError."""
    root = Path(dataset) / "episodes"
    if not root.is_dir():
        raise AnnotateError(f"{dataset} is no dataset: it has no episodes directory")
    return sorted(p.relative_to(root) for p in root.rglob("episode_*.hdf5"))


def write_entry(
    path: Path,
    key: str,
    arrays: Mapping[str, NDArray[Any]],
    attributes: Mapping[str, Any],
    compressed: Collection[str] = (),
) -> Entry:
    entry = Entry(key, arrays, attributes, checksum(arrays, attributes))
    with atomic_path(path) as temporary, new_hdf5(temporary) as f:
        f.attrs["key"] = key
        f.attrs["attributes"] = canonical(dict(attributes)).decode()
        f.attrs["checksum"] = entry.checksum
        for name, a in sorted(arrays.items()):
            options: dict[str, Any] = {}
            if name in compressed and a.size:
                frames = max(1, min(len(a), CHUNK_BYTES * len(a) // a.nbytes))
                options = {"chunks": (frames, *a.shape[1:])}
                options |= {"compression": "gzip", "compression_opts": 1}
            f.create_dataset(name, data=a, track_times=False, **options)
    put(path)
    return entry


def entry_header(path: Path) -> tuple[str, str]:
    if not path.is_file():
        raise FileNotFoundError(path)
    try:
        with open_hdf5(path) as f:
            return str(f.attrs["key"]), str(f.attrs["checksum"])
    except (OSError, KeyError, RuntimeError) as error:
        raise CorruptAnnotation(f"{path}: cannot be read ({error}); annotate again") from error


def check_entry(path: Path, key: str) -> str:
    """Whether an annotation is "valid", "missing", "stale" (another key) or "corrupt"."""
    try:
        return "valid" if read_entry(path).key == key else "stale"
    except FileNotFoundError:
        return "missing"
    except CorruptAnnotation:
        return "corrupt"


def write_stage(dataset: Path, directory: str, description: Mapping[str, Any]) -> None:
    path = Path(dataset) / "annotations" / directory / "stage.json"
    text = json.dumps(dict(description), indent=2, sort_keys=True) + "\n"
    if not path.is_file() or path.read_text() != text:
        write_atomic(path, text.encode())
        put(path)


def find_stage(dataset: Path, stage: str, **parameters: Any) -> str:
    """The one directory of a stage with these parameters. Raises AnnotateError."""
    fit = [
        directory
        for directory, s in stages_of(dataset).items()
        if s["stage"] == stage and all(s["parameters"].get(k) == v for k, v in parameters.items())
    ]
    if len(fit) == 1:
        return fit[0]
    named = " ".join([stage, *(f"{k}={v}" for k, v in parameters.items())])
    if not fit:
        again = f"run: domino-data annotate {dataset} --stages {stage}"
        raise AnnotateError(f"{dataset} has no {named} annotations; {again}")
    raise AnnotateError(f"{dataset} has several {named} annotations: {', '.join(fit)}")
