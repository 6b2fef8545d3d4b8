"""Flat Parquet: one row a frame, images as the JPEG bytes of the episode file, annotations joined
(docs/exports.md). Images are structs {bytes, path}, as Hugging Face datasets stores them; joint
names are in the metadata, key "domino"."""

from collections.abc import Collection, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa

from pipeline.data.actions import JOINTS, Representation
from pipeline.export.exporter import Exporter, Job, register
from pipeline.export.formats.parquet_table import CONSTANTS, Plan, episode_table
from pipeline.export.options import LabelOptions, camera_names_option, option, whole
from pipeline.export.shared.annotations import Joined, joined_of
from pipeline.export.shared.draft import ExportDraft
from pipeline.export.shared.episodes import (
    ExportError,
    Facts,
    exported_cameras,
    read_facts,
    reading,
    sort_episodes,
    source_of,
)
from pipeline.export.shared.provenance import PROVENANCE, Provenance
from pipeline.export.shared.sensors import IMAGE, SENSORS, sensors_of
from pipeline.export.shared.tables import TableWriter

FILE_BYTES = 200 * 1024 * 1024
# the hub's viewer refuses row groups of some 300 MB, and reads smaller ones faster
GROUP_BYTES = 64 * 1024 * 1024


@dataclass(frozen=True)
class ParquetOptions(LabelOptions):
    """Options of the format; a new file begins at `file_bytes`."""

    file_bytes: int = option("bytes after which another file begins", whole(1), FILE_BYTES)
    group_bytes: int = option(
        "bytes of images and annotations that a row group does not exceed", whole(1), GROUP_BYTES
    )
    annotations: str = option(
        "annotations to join: all, none, or directories like flow@0a1b2c3d,masks@...", str, "all"
    )
    camera_names: Mapping[str, str] = camera_names_option()


@register
class Parquet(Exporter[ParquetOptions]):
    """One row a frame; mixed embodiments share the files."""

    name = "parquet"
    options = ParquetOptions

    def write(self, job: Job[ParquetOptions], draft: ExportDraft) -> dict[str, Any]:
        paths = sort_episodes(job.episodes)
        firsts = _firsts(paths, job.dataset, job.options.representation)
        joined = joined_of(job.dataset, job.options.annotations, job.options.camera_names)
        plan = _plan(firsts, job.options, _sensors(paths), joined)
        files, rows = (
            _Files(draft, plan, job.options),
            Provenance(draft.folder / PROVENANCE, draft),
        )
        with closing(rows), closing(files):
            items = [_item(index, path, draft, plan) for index, path in enumerate(paths)]
            kept = 0
            for index, path in enumerate(paths):
                if index >= kept:
                    kept = index + files.keep(items, index)
                with reading(path) as file:
                    facts = read_facts(file, job.dataset, representation=job.options.representation)
                    rows.append(facts)
                    if index >= kept:
                        files.write(
                            episode_table(index, facts, file, plan, job.dataset), items[index]
                        )
                job.advance()
        return {
            "episodes": len(paths),
            "frames": rows.frames,
            "files": files.count,
            "fps": plan.fps,
            "embodiments": sorted(firsts),
            "annotations": [one.directory for one in joined],
        }

    def sensors(self, options: ParquetOptions) -> Collection[str]:
        return SENSORS

    def configs(self, folder: Path) -> list[dict[str, Any]]:
        return [
            {"config_name": "frames", "data_files": "data-*.parquet", "default": True},
            {"config_name": "episodes", "data_files": PROVENANCE},
        ]


def _sensors(paths: Sequence[Path]) -> set[str]:
    """Sensors that any of the episodes stores."""
    found = set[str]()
    for path in paths:
        with reading(path) as file:
            found |= set(sensors_of(file, file.cameras))
    return found


def _plan(
    firsts: Mapping[str, Facts],
    options: ParquetOptions,
    sensors: Collection[str],
    joined: Sequence[Joined],
) -> Plan:
    reference = next(iter(firsts.values()))
    names = {name: list(f.log.vector_names) for name, f in firsts.items()}
    cameras = exported_cameras(reference, options.camera_names)
    actions = {
        name: facts.action_names for name, facts in firsts.items() if facts.representation != JOINTS
    }
    return Plan(
        *(reference.fps, cameras, names, sensors, joined),
        *(reference.corrected, reference.spins, actions, options.labels),
        *(reference.eventful, reference.paired),
    )


def _item(index: int, path: Path, draft: ExportDraft, plan: Plan) -> list[Any]:
    """All that the rows of an episode are made from."""
    source = source_of(path, draft.dataset)
    annotations = (draft.hash_if_there(one.file(draft.dataset, source)) for one in plan.joined)
    return [index, source, draft.hash_of(path), *annotations]


class _Files:
    """data-00000.parquet ...: a table is a row group."""

    def __init__(self, draft: ExportDraft, plan: Plan, options: ParquetOptions) -> None:
        self.draft, self.schema, self.options, self.count = draft, plan.schema(), options, 0
        coded = [field.name for field in self.schema if field.type == IMAGE]
        # JPEG and PNG bytes neither compress nor repeat
        codecs = {name: "ZSTD" for name in self.schema.names if name not in coded} | {
            f"{name}.bytes": "NONE" for name in coded
        }
        self.settings: dict[str, Any] = {"compression": codecs, "use_dictionary": [*CONSTANTS]}
        # pages end where the content says, so that a store that keeps equal pieces once keeps what
        # has not changed
        self.settings |= {"use_content_defined_chunking": True}
        self._writer: TableWriter | None = None
        self._items: list[list[Any]] = []

    def keep(self, items: Sequence[list[Any]], start: int) -> int:
        """Take over the next file if the older export has one of the episodes from `start`; returns
        of how many."""
        name = f"data-{self.count:05d}.parquet"
        older = self.draft.older.record.contents.get(name, {})
        count, full = older.get("episodes", 0), older.get("full", False)
        if self._writer is not None or not 0 < count <= len(items) - start:
            return 0
        # it ended for want of episodes, and there are more
        if not full and count < len(items) - start:
            return 0
        made_from = self._sources_of(items[start : start + count])
        if not self.draft.keep(self.draft.folder / name, made_from):
            return 0
        self.count += 1
        return count

    def _sources_of(self, items: Sequence[list[Any]]) -> list[Any]:
        return [self.schema.serialize().to_pybytes().hex(), *items]

    def write(self, table: pa.Table, item: list[Any]) -> None:
        """Write the rows of an episode that were made from `item`."""
        path = self.draft.folder / f"data-{self.count:05d}.parquet"
        if self._writer is None:
            self._writer = TableWriter(path, self.schema, **self.settings)
        self._items.append(item)
        groups = max(1, -(-table.nbytes // self.options.group_bytes))
        self._writer.write_table(table, row_group_size=max(1, -(-len(table) // groups)))
        if path.stat().st_size >= self.options.file_bytes:
            self.close(full=True)

    def close(self, full: bool = False) -> None:
        """Finish the file; `full` if it is complete whatever follows."""
        if self._writer is not None:
            self._writer.close()
            self._writer = None
            path = self.draft.folder / f"data-{self.count:05d}.parquet"
            self.draft.record(
                path, self._sources_of(self._items), episodes=len(self._items), full=full
            )
            self.count, self._items = self.count + 1, []


def _firsts(
    paths: Sequence[Path], dataset: Path, representation: Representation
) -> dict[str, Facts]:
    """Embodiment -> its first episode. Raises ExportError where two differ in what they hold."""
    firsts: dict[str, Facts] = {}
    for path in paths:
        with reading(path) as file:
            if file.spec.embodiment not in firsts:
                firsts[file.spec.embodiment] = read_facts(
                    file, dataset, representation=representation
                )
    reference, *others = firsts.values()
    for other in others:
        for name in ("fps", "cameras", "spins"):
            want, got = getattr(reference, name), getattr(other, name)
            if want != got:
                raise ExportError(
                    f"{other.source}: {name} {got} differs from {want} of {reference.source};"
                    " export them separately"
                )
    return firsts
