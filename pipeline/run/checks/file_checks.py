"""Whether a file is what was written: hash, key, decoding."""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.annotate.stage import annotation_key, stage_key
from pipeline.data.dataset import Dataset
from pipeline.data.episode.file import EpisodeFile
from pipeline.data.errors import DAMAGE, DominoError
from pipeline.data.keys import digest, file_hash, is_unchanged
from pipeline.data.parsing import parse_json
from pipeline.data.reading import IRREGULAR, check_regular, read_regular
from pipeline.data.recipe.cells import Cell, Slot
from pipeline.data.slots.annotations import CorruptAnnotation, read_entry
from pipeline.data.slots.assets import AssetStore
from pipeline.data.slots.files import GIVEN_UP, read_given_up
from pipeline.data.store.place import drop, place_of
from pipeline.export.shared.record import read_record

AGAIN = "run the build again"
_ATTEMPT = re.compile(r"_attempt_\d{3}$")


@dataclass(frozen=True)
class FileJob:
    """A file to check, or an export's directory, below the dataset `root`; `sha256` is the
    index's, "" for none.
    """

    root: str
    path: str
    sha256: str = ""


def judge(job: FileJob) -> list[str]:
    """What is wrong with one file, in one line each without its path."""
    path, folder, problems = Path(job.root) / job.path, job.path.partition("/")[0], list[str]()
    try:
        if folder != "exports":
            check_regular(path)
        if job.sha256 and file_hash(path) != job.sha256:
            problems.append(f"its bytes are not those that were written; {AGAIN}")
        else:
            problems += _CHECKS[folder](path)
    except (*DAMAGE, DominoError, CorruptAnnotation, pa.ArrowException) as error:
        irregular = isinstance(error, OSError) and error.strerror == IRREGULAR
        text = " ".join(str(IRREGULAR if irregular else error).split())[:200]
        problems.append(text.removeprefix(f"{path}: ") or type(error).__name__)
    if folder == "episodes":
        drop(path)
    return problems


def _check_episode(path: Path) -> Iterator[str]:
    """An accepted episode, a kept failure, or a given-up note."""
    if path.name.endswith(GIVEN_UP):
        read_given_up(path, "/".join(path.parts[-5:]).removesuffix(GIVEN_UP))
        return
    with EpisodeFile(path) as file:
        if damaged := file.damaged():
            yield f"its content is not what was written ({', '.join(damaged[:3])}); {AGAIN}"
        meta, spec = file.meta, file.spec
        folder = "failures" if meta.failure else "episodes"
        place = f"{folder}/{Slot(Cell.of(spec), spec.slot, meta.variant).path}"
        if not _ATTEMPT.sub("", str(path.with_suffix(""))).endswith(f"/{place}"):
            yield f"holds {place}, not that of its place; {AGAIN}"
        if meta.keys:
            stated = (digest(meta.keys["physics"]), digest(meta.keys["render"]))
            if (meta.physics_key, meta.render_key) != stated:
                yield f"its keys are not those of their parts; {AGAIN}"
        file.read()
        for camera in file.cameras:
            for _ in file.frames(camera):
                pass


def _check_annotation(path: Path) -> Iterator[str]:
    above = (each for each in path.parents if each.parent.name == "annotations")
    directory = next(above, path.parent)
    stage = parse_json(read_regular(directory / "stage.json"))
    of = (str(stage["stage"]), int(stage["version"]), dict(stage["parameters"]))
    if directory.name != f"{of[0]}@{stage_key(*of)}":
        yield f"stage.json is not that of {directory.name}; run annotate again"
    if path.suffix == ".h5":
        entry = read_entry(path)
        if annotation_key(*of, entry.attributes.get("inputs", {})) != entry.key:
            yield "its key is not that of its stage and inputs; run annotate again"


def _check_asset(path: Path) -> Iterator[str]:
    store = AssetStore(path.parents[1])
    if store.path(path.stem) != path:
        yield "is no asset; remove it"
    else:
        store.get(path.stem)


def _check_export(place: Path) -> Iterator[str]:
    if there := place_of(place):
        there.pull(there.below(place))
    record = read_record(place)
    for path in record.foreign():
        yield f"{path.relative_to(place)} is no part of the export; move it away"
    for name in sorted(record.contents):
        if problem := record.problem(name):
            yield f"{name} {problem}; export again"


def _check_attempts(path: Path) -> Iterator[str]:
    pq.read_table(path)
    yield from ()


def _check_provenance(path: Path) -> Iterator[str]:
    if not is_unchanged(Dataset(path.parent).made_by()):
        yield f"was edited after it was written; {AGAIN}"


_CHECKS: dict[str, Callable[[Path], Iterator[str]]] = {
    "episodes": _check_episode,
    "failures": _check_episode,
    "exports": _check_export,
    "annotations": _check_annotation,
    "assets": _check_asset,
    "attempts.parquet": _check_attempts,
    "provenance.json": _check_provenance,
}
