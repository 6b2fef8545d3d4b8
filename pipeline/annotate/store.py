"""Writes and checks the files of annotations (data/slots/annotations.py)."""

import json
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from pipeline.annotate.stage_key import AnnotateError
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

GZIP_LEVEL = 1
CHUNK_BYTES = 1 << 20


def episode_paths(dataset: Path) -> list[Path]:
    """Episode files of a dataset, relative to `dataset`/episodes, sorted. Raises AnnotateError if
    there is no such directory."""
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
    """Write one annotation atomically; `compressed` arrays with gzip in chunks of whole frames.
    Raises OSError or StoreError."""
    entry = Entry(key, arrays, attributes, checksum(arrays, attributes))
    with atomic_path(path) as temporary, new_hdf5(temporary) as f:
        f.attrs["key"] = key
        f.attrs["attributes"] = canonical(dict(attributes)).decode()
        f.attrs["checksum"] = entry.checksum
        for name in sorted(arrays):
            a = arrays[name]
            options: dict[str, Any] = {}
            if name in compressed and a.size:
                frames = max(1, min(len(a), CHUNK_BYTES * len(a) // a.nbytes))
                options = {
                    "chunks": (frames, *a.shape[1:]),
                    "compression": "gzip",
                    "compression_opts": GZIP_LEVEL,
                }
            f.create_dataset(name, data=a, track_times=False, **options)
    put(path)
    return entry


def entry_header(path: Path) -> tuple[str, str]:
    """Key and checksum that a file claims. Raises as `read_entry`."""
    if not path.is_file():
        raise FileNotFoundError(path)
    try:
        with open_hdf5(path) as f:
            return str(f.attrs["key"]), str(f.attrs["checksum"])
    except (OSError, KeyError, RuntimeError) as error:
        raise CorruptAnnotation(
            f"{path}: cannot be read ({error}); run annotate again to recompute it"
        ) from error


def check_entry(path: Path, key: str) -> str:
    """Whether an annotation is "valid", "missing", "stale" (another key) or "corrupt"."""
    try:
        return "valid" if read_entry(path).key == key else "stale"
    except FileNotFoundError:
        return "missing"
    except CorruptAnnotation:
        return "corrupt"


def write_stage(dataset: Path, directory: str, description: Mapping[str, Any]) -> None:
    """Write stage.json (name, version, parameters) of a stage's directory, unless it is there."""
    path = Path(dataset) / "annotations" / directory / "stage.json"
    text = json.dumps(dict(description), indent=2, sort_keys=True) + "\n"
    if path.is_file() and path.read_text() == text:
        return
    write_atomic(path, text.encode())
    put(path)


def find_stage(dataset: Path, stage: str, **parameters: Any) -> str:
    """The one directory of a stage with these parameters: `find_stage(out, "flow", stride=4)`.
    Raises AnnotateError if none or several fit."""
    candidates = {d: s for d, s in stages_of(dataset).items() if s["stage"] == stage}
    fit = [
        d
        for d, s in candidates.items()
        if all(s["parameters"].get(k) == v for k, v in parameters.items())
    ]
    if len(fit) == 1:
        return fit[0]
    description = " ".join([stage, *(f"{k}={v}" for k, v in parameters.items())])
    if not fit:
        raise AnnotateError(
            f"{dataset} has no {description} annotations; run: domino-data annotate {dataset}"
            f" --stages {stage}"
        )
    raise AnnotateError(
        f"{dataset} has several {description} annotations ({', '.join(fit)}): give more parameters"
        " to choose one"
    )
