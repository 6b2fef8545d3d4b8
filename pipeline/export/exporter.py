"""Contract and registry of export formats."""

from abc import ABC, abstractmethod
from collections.abc import Collection
from pathlib import Path
from typing import Any, ClassVar

from pipeline.data.actions import JOINTS
from pipeline.data.slots.select import VALIDATION
from pipeline.registry import Registry

from .options import recorded, representation_of
from .shared.draft import ExportDraft, Job, stage_directory
from .shared.episodes import reading, sort_episodes
from .shared.images import sensors_of
from .shared.record import write_card

LEFT_OUT = "sensors_left_out"
"""Key of the summary: sensors that the dataset has and the export has not."""


class Exporter[O](ABC):
    """How a format is written. `name` is what `--format` calls it, `options` a frozen dataclass of
    fields made by `option`."""

    name: ClassVar[str]
    options: type[O]
    written: ClassVar[Collection[str]] = ()

    @abstractmethod
    def write(self, job: Job[O], draft: ExportDraft) -> dict[str, Any]:
        """Writes to `draft.folder`; returns a part of the summary. Raises ExportError."""

    def sensors(self, options: O) -> Collection[str]:
        """Which of `images.SENSORS` are written."""
        return self.written

    def configs(self, folder: Path) -> list[dict[str, Any]]:
        """The data files for `load_dataset`; [] if it cannot read the format."""
        return []

    def export(self, job: Job[O]) -> dict[str, Any]:
        representation = representation_of(job.options)
        options = recorded(job.options) | dict(job.given)
        with stage_directory(job.out, job.dataset, self.name) as folder:
            draft = ExportDraft(folder, job, self.name)
            summary = {"format": self.name, "options": options, "split": job.split}
            summary |= self.write(job, draft)
            for path in job.episodes:
                draft.hash_of(path)
            if representation != JOINTS:
                summary["action"] = representation.describe()
            if job.where:
                summary["where"] = job.where
            if job.validation != VALIDATION:
                summary["validation"] = job.validation
            written = self.sensors(job.options)
            with reading(sort_episodes(job.episodes)[0]) as file:
                stored = sensors_of(file, file.cameras)
            if left := [name for name in stored if name not in written]:
                summary[LEFT_OUT] = left
            text = job.describe(folder, summary) if job.describe else ""
            write_card(folder, summary, self.configs(folder), text)
            return draft.finish(summary)


_FORMATS, _BRIDGES = "pipeline.export.formats", "pipeline.export.bridges"
EXPORTERS = Registry[Exporter[Any]](
    "format",
    {
        "lerobot": f"{_FORMATS}.lerobot.version30",
        "lerobot-v2.1": f"{_FORMATS}.lerobot.version21",
        **{name: f"{_FORMATS}.{name}" for name in ("aloha", "parquet", "rlds", "zarr")},
        "robomimic": f"{_FORMATS}.robomimic",
        **{name: f"{_BRIDGES}.{name}" for name in ("robotwin", "xpolicylab", "dynamicwam")},
        "puma-gt": f"{_BRIDGES}.puma_gt",
    },
)
"""Formats by name. A module is imported, and registers its class, when its format is asked for."""


def register[E: Exporter[Any]](kind: type[E]) -> type[E]:
    """Class decorator that makes a format known. Raises ValueError for a name that is taken."""
    EXPORTERS.add(kind.name, kind())
    return kind
