"""Where annotations live: OUT/annotations/<stage>@<key8>/<path of the episode>.h5 and a stage.json with the full parameters.

One file per episode and stage; arrays are indexed by absolute frame. A file appears by atomic rename, carries its full
annotation key and a checksum of its content, and counts as done only where both hold.
"""

import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from pipeline.annotate.keys import AnnotateError, digest
from pipeline.data.atomic import atomic_path, write_atomic
from pipeline.data.episode import INFLATION
from pipeline.data.keys import arrays_digest, canonical

GZIP_LEVEL = 1
CHUNK_BYTES = 1 << 20


class CorruptAnnotation(Exception):
    """An annotation file that cannot be read or whose content is not what was written; the message names the file."""


@dataclass(frozen=True, eq=False)
class Entry:
    """One annotation file: its full key, its arrays (first axis = absolute frame), plain attributes, and the content checksum."""

    key: str
    arrays: Mapping[str, NDArray[Any]]
    attributes: Mapping[str, Any]
    checksum: str


def episode_paths(dataset: Path) -> list[Path]:
    """Episode files of a dataset, relative to `dataset`/episodes, sorted. Raises AnnotateError where there is no such directory."""
    root = Path(dataset) / "episodes"
    if not root.is_dir():
        raise AnnotateError(f"{dataset} is no dataset: it has no episodes directory")
    return sorted(p.relative_to(root) for p in root.rglob("episode_*.hdf5"))


def annotation_path(dataset: Path, directory: str, episode: Path) -> Path:
    """File of one episode (relative path as from `episode_paths`) in a stage's directory such as "flow@0a1b2c3d"."""
    return Path(dataset) / "annotations" / directory / episode.with_suffix(".h5")


def checksum(arrays: Mapping[str, NDArray[Any]], attributes: Mapping[str, Any]) -> str:
    """sha256 of what an entry holds: its arrays and its attributes."""
    return digest([arrays_digest(arrays), canonical(dict(attributes)).decode()])


def write_entry(
    path: Path, key: str, arrays: Mapping[str, NDArray[Any]], attributes: Mapping[str, Any], compressed: Collection[str] = ()
) -> Entry:
    """Write one annotation atomically. Arrays named in `compressed` are stored with gzip in chunks of whole frames.

    The same arguments give the same bytes. Raises OSError where the disk refuses; nothing is left behind then.
    """
    entry = Entry(key, arrays, attributes, checksum(arrays, attributes))
    with atomic_path(path) as temporary, h5py.File(temporary, "w", libver=("v110", "v110")) as f:
        f.attrs["key"] = key
        f.attrs["attributes"] = canonical(dict(attributes)).decode()
        f.attrs["checksum"] = entry.checksum
        for name in sorted(arrays):
            a = arrays[name]
            options: dict[str, Any] = {}
            if name in compressed and a.size:
                frames = max(1, min(len(a), CHUNK_BYTES * len(a) // a.nbytes))
                options = {"chunks": (frames, *a.shape[1:]), "compression": "gzip", "compression_opts": GZIP_LEVEL}
            f.create_dataset(name, data=a, track_times=False, **options)
    return entry


def read_entry(path: Path) -> Entry:
    """Read an annotation whole and check it. Raises FileNotFoundError, or CorruptAnnotation for a damaged file."""
    if not path.is_file():
        raise FileNotFoundError(path)
    try:
        with h5py.File(path, "r") as f:
            claimed = sum(item.nbytes for item in f.values() if isinstance(item, h5py.Dataset))
            if claimed > INFLATION * path.stat().st_size:
                raise ValueError(f"claims {claimed} bytes, more than the file can hold")
            arrays = {str(name): np.asarray(f[name]) for name in f}
            attributes = json.loads(str(f.attrs["attributes"]))
            entry = Entry(str(f.attrs["key"]), arrays, attributes, str(f.attrs["checksum"]))
    # h5py answers damage with any of these, depending on which byte it is
    except (OSError, KeyError, ValueError, TypeError, RuntimeError, UnicodeError, MemoryError) as error:
        raise CorruptAnnotation(f"{path}: cannot be read ({error}); run annotate again to recompute it") from error
    if checksum(arrays, attributes) != entry.checksum:
        raise CorruptAnnotation(f"{path}: content does not match its checksum; run annotate again to recompute it")
    return entry


def entry_header(path: Path) -> tuple[str, str]:
    """Key and content checksum that a file claims, without reading its arrays. Raises as `read_entry`."""
    if not path.is_file():
        raise FileNotFoundError(path)
    try:
        with h5py.File(path, "r") as f:
            return str(f.attrs["key"]), str(f.attrs["checksum"])
    except (OSError, KeyError, RuntimeError) as error:
        raise CorruptAnnotation(f"{path}: cannot be read ({error}); run annotate again to recompute it") from error


def check_entry(path: Path, key: str) -> str:
    """State of a stored annotation against the key it should have: "valid", "missing", "stale" (another key) or "corrupt"."""
    try:
        return "valid" if read_entry(path).key == key else "stale"
    except FileNotFoundError:
        return "missing"
    except CorruptAnnotation:
        return "corrupt"


def write_stage(dataset: Path, directory: str, description: Mapping[str, Any]) -> None:
    """Write stage.json (name, version, full parameters) of a stage's directory atomically, unless it says just that already."""
    path = Path(dataset) / "annotations" / directory / "stage.json"
    text = json.dumps(dict(description), indent=2, sort_keys=True) + "\n"
    if path.is_file() and path.read_text() == text:
        return
    write_atomic(path, text.encode())


def stages_of(dataset: Path) -> dict[str, dict[str, Any]]:
    """Stage directories that a dataset has: directory name -> content of its stage.json, sorted by name."""
    found = sorted((Path(dataset) / "annotations").glob("*@*/stage.json"))
    return {path.parent.name: json.loads(path.read_text()) for path in found}


def find_stage(dataset: Path, stage: str, **parameters: Any) -> str:
    """The one stage directory with that name whose parameters have the given values, e.g. `find_stage(out, "flow", stride=4)`.

    Raises AnnotateError where none or several fit, naming them.
    """
    candidates = {d: s for d, s in stages_of(dataset).items() if s["stage"] == stage}
    fit = [d for d, s in candidates.items() if all(s["parameters"].get(k) == v for k, v in parameters.items())]
    if len(fit) == 1:
        return fit[0]
    wanted = " ".join([stage, *(f"{k}={v}" for k, v in parameters.items())])
    if not fit:
        raise AnnotateError(f"{dataset} has no {wanted} annotations; run: domino-data annotate {dataset} --stages {stage}")
    raise AnnotateError(f"{dataset} has several {wanted} annotations ({', '.join(fit)}): give more parameters to choose one")


def load(dataset: Path, directory: str, episode: Path, names: Collection[str] | None = None) -> dict[str, np.ndarray]:
    """Arrays of one episode (path relative to episodes/) from a stage's directory, for readers such as a data loader.

    With `names` only those datasets are read, unchecked; without, all of them, checked as in `read_entry`.
    """
    path = annotation_path(dataset, directory, episode)
    if names is None:
        return dict(read_entry(path).arrays)
    with h5py.File(path, "r") as f:
        return {name: np.asarray(f[name]) for name in names}
