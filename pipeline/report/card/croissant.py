"""croissant.json: what an export is and where its records are, in the Croissant vocabulary of
MLCommons with its RAI extension.

Specifications: https://docs.mlcommons.org/croissant/docs/croissant-spec.html (1.0) and
croissant-rai-spec.html (1.0). Paths are relative to the file, so that it is right on the disk and
in a repository of the hub alike.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.report.card.survey import Seen
from pipeline.report.card.words import (
    BIASES,
    LICENSE_URL,
    PAPER,
    citation,
    identifier,
    is_failures,
    kind_of,
    limits,
    title,
    uses,
)

FILE = "croissant.json"
SPLITS = {"train": "training", "validation": "validation", "test": "test"}
MEDIA = {
    ".parquet": "application/x-parquet",
    ".mp4": "video/mp4",
    ".hdf5": "application/x-hdf5",
    ".pkl": "application/octet-stream",
    ".tfrecord": "application/x-tfrecord",
    ".zarr": "application/octet-stream",
}
TABLE, FRAMES = "episode-files", "frame-files"
RECORDS = {TABLE: "episodes", FRAMES: "frames"}
VERSION = "1.0.0"
OTHER_TERMS: dict[str, Any] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "conformsTo": "dct:conformsTo",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "sc": "https://schema.org/",
}
TERMS = """
    @language @vocab citeAs column conformsTo cr rai data dataType dct equivalentProperty examples extract field
    fileProperty fileObject fileSet format includes isLiveDataset jsonPath key md5 parentField path recordSet references
    regex repeated replace samplingRate sc separator source subField transform
"""  # noqa: E501
CONTEXT = {term: OTHER_TERMS.get(term, f"cr:{term}") for term in TERMS.split()}
"""Terms of the vocabulary in the order of the specification; most are those of Croissant itself."""


def croissant(folder: Path, summary: Mapping[str, Any], seen: Sequence[Seen]) -> dict[str, Any]:
    """The Croissant description of an export whose data files are in `folder`, as JSON-LD."""
    groups = _groups(folder)
    records = [_splits()] if TABLE in groups else []
    records += [_records(name, folder / groups[name][0]) for name in RECORDS if name in groups]
    return {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": [
            "http://mlcommons.org/croissant/1.0",
            "http://mlcommons.org/croissant/RAI/1.0",
        ],
        "name": f"domino-data-{identifier(seen)}-{summary['format']}",
        "description": (
            f"{title(seen, summary)}. {len(seen)} {kind_of(summary)} of robots that handle moving"
            " objects."
        ),
        "identifier": identifier(seen),
        "version": VERSION,
        "license": LICENSE_URL,
        "url": PAPER,
        "creator": {"@type": "sc:Organization", "name": "The domino-data authors"},
        "keywords": [
            "robotics",
            "simulation",
            "dynamic manipulation",
            *sorted({one.spec.task for one in seen}),
        ],
        "citeAs": citation(seen, summary),
        "isLiveDataset": False,
        **_rai(seen, summary),
        "distribution": [_file_set(name, files) for name, files in groups.items()],
        "recordSet": records,
    }


def _rai(seen: Sequence[Seen], summary: Mapping[str, Any]) -> dict[str, Any]:
    intended, unintended = uses(seen, summary)
    made = (
        "A scripted expert acts on a target whose motion is computed backwards from the moment of"
        " the meeting (SAPIEN physics)."
    )
    if policy := seen[0].meta.corrects:
        made += f" The policy {policy} acts until the expert takes over."
    judged = (
        "failed the named conditions of its task"
        if is_failures(summary)
        else "met the named conditions of its task"
    )
    action = summary.get("action", "the joint target of the interval after it")
    return {
        "rai:dataCollection": f"{made} Each attempt was judged from its state log and {judged}.",
        "rai:dataCollectionType": ["Software Collection"],
        "rai:dataCollectionRawData": (
            "State logs: poses, joints, contacts and events; images are drawn from them."
        ),
        "rai:dataCollectionMissingData": (
            "Failed attempts are left out of the episodes; no frame or value is imputed."
        ),
        "rai:dataPreprocessingProtocol": [f"State is measured at a frame; action is {action}."],
        "rai:dataAnnotationProtocol": (
            "Instructions are made from templates and descriptions of the objects."
        ),
        "rai:machineAnnotationTools": ["domino-data"],
        "rai:annotationsPerItem": f"{sum(map(len, seen[0].instructions))} instructions an episode",
        "rai:dataUseCases": [*intended, *(f"Not intended: {text}" for text in unintended)],
        "rai:dataLimitations": list(limits(seen, summary)),
        "rai:dataBiases": list(BIASES),
        "rai:dataSocialImpact": (
            "Better handling of moving objects may replace manual work; the data themselves concern"
            " no person."
        ),
        "rai:personalSensitiveInformation": ["None: the data are simulated and show no person."],
        "rai:dataReleaseMaintenancePlan": (
            "The recipe and the versions on the card make the same dataset again."
        ),
    }


def _groups(folder: Path) -> dict[str, list[str]]:
    """Data files of an export, relative, by the file set that they belong to."""
    groups: dict[str, list[str]] = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if (
            path.is_file()
            and _ending(name) in MEDIA
            and not name.startswith("card/")
            and (group := _group(path, name))
        ):
            groups.setdefault(group, []).append(name)
    return groups


def _ending(name: str) -> str:
    """What tells the kind of a file: that of the zarr store it lies in, that before the numbers of
    a shard, or its own."""
    if any(part.endswith(".zarr") for part in Path(name).parts[:-1]):
        return ".zarr"
    return ".tfrecord" if ".tfrecord-" in name else Path(name).suffix


def _group(path: Path, name: str) -> str:
    """The file set of a file; "" for tables that only the library of a format reads, and for group
    metadata of a zarr store."""
    if path.name in ("episodes.parquet", "domino_episodes.parquet"):
        return TABLE
    if path.suffix == ".parquet" and (
        path.name.startswith("data-") or "data" in Path(name).parts[:-1]
    ):
        return FRAMES
    return (
        "" if path.suffix == ".parquet" or path.name == ".zgroup" else f"{_ending(name)[1:]}-files"
    )


def _file_set(name: str, files: Sequence[str]) -> dict[str, Any]:
    """Where the files of a set are: a glob that leaves numbers and the directories of several
    datasets open."""
    first, ending = Path(files[0]), _ending(files[0])
    tail = f"*{first.suffix}"
    if name == TABLE:
        tail = f"meta/{first.name}" if first.parent.name == "meta" else first.name
    elif name == FRAMES:
        tail = "data-*.parquet" if first.name.startswith("data-") else "data/*/*.parquet"
    elif ending == ".mp4":
        tail = "videos/*/*/*.mp4"
    elif ending == ".tfrecord":
        tail = "*.tfrecord-*"
    elif ending == ".zarr":
        tail = "*.zarr/*/*/*"
    begin = "" if len(first.parts) == len(Path(tail).parts) else "**/"
    entry = {"@type": "cr:FileSet", "@id": name, "name": name, "encodingFormat": MEDIA[ending]}
    return entry | {"description": f"{len(files)} files", "includes": begin + tail}


def _splits() -> dict[str, Any]:
    """The splits of the episodes, as Croissant names them."""
    fields = [("name", "sc:Text"), ("url", "sc:URL")]
    return {
        "@type": "cr:RecordSet",
        "@id": "splits",
        "name": "splits",
        "dataType": "cr:Split",
        "key": {"@id": "splits/name"},
        "field": [
            {"@type": "cr:Field", "@id": f"splits/{name}", "name": name, "dataType": kind}
            for name, kind in fields
        ],
        "data": [
            {"splits/name": split, "splits/url": f"https://mlcommons.org/definitions/{name}_split"}
            for split, name in SPLITS.items()
        ],
    }


def _records(files: str, file: Path) -> dict[str, Any]:
    """One record a row of a set of Parquet files, with those of its columns that are numbers,
    words, or lists of them."""
    name, fields = RECORDS[files], list[dict[str, Any]]()
    for column in pq.read_schema(file):
        inner = (
            column.type.value_type
            if pa.types.is_list(column.type) or pa.types.is_fixed_size_list(column.type)
            else column.type
        )
        if (kind := _kind(inner)) is None:
            continue
        entry: dict[str, Any] = {
            "@type": "cr:Field",
            "@id": f"{name}/{column.name}",
            "name": column.name,
            "dataType": kind,
        }
        entry["source"] = {"fileSet": {"@id": files}, "extract": {"column": column.name}}
        if inner is not column.type:
            entry["repeated"] = True
        if (files, column.name) == (TABLE, "split"):
            entry["references"] = {"field": {"@id": "splits/name"}}
        fields.append(entry)
    return {"@type": "cr:RecordSet", "@id": name, "name": name, "field": fields}


def _kind(column: pa.DataType) -> str | None:
    if pa.types.is_boolean(column):
        return "sc:Boolean"
    if pa.types.is_integer(column):
        return "sc:Integer"
    if pa.types.is_floating(column):
        return "sc:Float"
    return "sc:Text" if pa.types.is_string(column) or pa.types.is_large_string(column) else None
