"""Flat Parquet: one row a frame (docs/exports.md)."""

from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa

from pipeline.export.exporter import Exporter, Job, register
from pipeline.export.options import LabelOptions, camera_names_option, option, whole
from pipeline.export.shared.annotations import joined_of
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
from pipeline.export.shared.images import IMAGE, SENSORS, sensors_of
from pipeline.export.shared.tables import PROVENANCE, Provenance, TableWriter

from .parquet_table import CONSTANTS, Plan, episode_table

FILE_BYTES = 200 * 1024 * 1024
# the hub's viewer refuses row groups of some 300 MB, and reads smaller ones faster
GROUP_BYTES = 64 * 1024 * 1024


@dataclass(frozen=True)
class ParquetOptions(LabelOptions):
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
    name = "parquet"
    options = ParquetOptions
    written = SENSORS

    def write(self, job: Job[ParquetOptions], draft: ExportDraft) -> dict[str, Any]:
        paths, options = sort_episodes(job.episodes), job.options
        plan = _plan(paths, job.dataset, options)
        files, rows = _Files(draft, plan, options), Provenance(draft.folder / PROVENANCE, draft)
        with closing(rows), closing(files):
            for index, path in enumerate(paths):
                for one in plan.joined:
                    draft.note(one.file(job.dataset, source_of(path, job.dataset)))
                with rows.noting(job, path) as (file, facts):
                    files.write(episode_table(index, facts, file, plan, job.dataset))
        return {
            "episodes": len(paths),
            "frames": rows.frames,
            "files": files.count,
            "fps": plan.fps,
            "embodiments": sorted(plan.names),
            "annotations": [one.directory for one in plan.joined],
        }

    def configs(self, folder: Path) -> list[dict[str, Any]]:
        return [
            {"config_name": "frames", "data_files": "data-*.parquet", "default": True},
            {"config_name": "episodes", "data_files": PROVENANCE},
        ]


def _plan(paths: Sequence[Path], dataset: Path, options: ParquetOptions) -> Plan:
    firsts, sensors = dict[str, Facts](), set[str]()
    for path in paths:
        with reading(path) as file:
            sensors |= set(sensors_of(file, file.cameras))
            if file.spec.embodiment not in firsts:
                facts = read_facts(file, dataset, representation=options.representation)
                firsts[file.spec.embodiment] = facts
    first, *others = firsts.values()
    for other in others:
        for name in ("fps", "cameras", "spins"):
            want, got = getattr(first, name), getattr(other, name)
            if want != got:
                differs = f"{name} {got} differs from {want} of {first.source}"
                raise ExportError(f"{other.source}: {differs}; export them separately")
    return Plan(
        first,
        exported_cameras(first, options.camera_names),
        {robot: list(facts.log.vector_names) for robot, facts in firsts.items()},
        {robot: facts.action_names for robot, facts in firsts.items()},
        sensors,
        joined_of(dataset, options.annotations, options.camera_names),
        options.labels,
    )


class _Files:
    def __init__(self, draft: ExportDraft, plan: Plan, options: ParquetOptions) -> None:
        self.folder, self.schema, self.options, self.count = draft.folder, plan.schema(), options, 0
        # JPEG and PNG bytes neither compress nor repeat
        codecs = {
            f"{field.name}.bytes" if field.type == IMAGE else field.name: (
                "NONE" if field.type == IMAGE else "ZSTD"
            )
            for field in self.schema
        }
        self.settings: dict[str, Any] = {
            "compression": codecs,
            "use_dictionary": [*CONSTANTS],
            # pages end where the content says, so that a store that keeps equal pieces once keeps
            # what has not changed
            "use_content_defined_chunking": True,
        }
        self._writer: TableWriter | None = None

    @property
    def _path(self) -> Path:
        return self.folder / f"data-{self.count:05d}.parquet"

    def write(self, table: pa.Table) -> None:
        if self._writer is None:
            self._writer = TableWriter(self._path, self.schema, **self.settings)
        groups = max(1, -(-table.nbytes // self.options.group_bytes))
        self._writer.write_table(table, row_group_size=max(1, -(-len(table) // groups)))
        if self._path.stat().st_size >= self.options.file_bytes:
            self.close()

    def close(self) -> None:
        if self._writer is not None:
            self._writer.close()
            self._writer, self.count = None, self.count + 1
