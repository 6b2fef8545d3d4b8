"""The contract of an export format, and the registry of formats."""

from abc import ABC, abstractmethod
from collections.abc import Collection
from pathlib import Path
from typing import Any, ClassVar

from pipeline.data.actions import JOINTS
from pipeline.data.slots.select import VALIDATION
from pipeline.export.options import NoOptions, recorded, representation_of
from pipeline.export.shared.card import write_card
from pipeline.export.shared.draft import ExportDraft, Job, stage_directory
from pipeline.export.shared.episodes import reading, sort_episodes
from pipeline.export.shared.sensors import sensors_of
from pipeline.registry import Registry

LEFT_OUT = "sensors_left_out"
"""Key of the summary: sensors that the dataset has and the export has not."""

ACTION = "action"
"""Key of the summary: what an action is, if not joint targets."""


class Exporter[O](ABC):
    """How a format is written. `name` is what `--format` calls it, `options` a frozen dataclass of
    fields made by `option`."""

    name: ClassVar[str]
    options: type[O]

    @abstractmethod
    def write(self, job: Job[O], draft: ExportDraft) -> dict[str, Any]:
        """Write the episodes, in the order of their paths, to `draft.folder`; returns their part of
        the summary. Raises ExportError for episodes that the format cannot hold."""

    def sensors(self, options: O) -> Collection[str]:
        """Which of `sensors.SENSORS` the format writes with these options."""
        return ()

    def configs(self, folder: Path) -> list[dict[str, Any]]:
        """The data files for the card's front matter, so that `load_dataset` finds them; [] if it
        cannot read the format."""
        return []

    def export(self, job: Job[O]) -> dict[str, Any]:
        """Write `job.out` and return its summary; it appears by rename. Raises ExportError as
        `write` and `stage_directory`."""
        representation = representation_of(job.options)
        options = recorded(job.options) | dict(job.given)
        with stage_directory(job.out, job.dataset) as folder:
            draft = ExportDraft(folder, job, self.name, options)
            summary = {
                "format": self.name,
                "options": options,
                "split": job.split,
                **self.write(job, draft),
            }
            for path in job.episodes:
                draft.hash_of(path)
            if representation != JOINTS:
                summary[ACTION] = representation.describe()
            if job.where:
                summary["where"] = job.where
            if job.validation != VALIDATION:
                summary["validation"] = job.validation
            if left := self._left_out(job):
                summary[LEFT_OUT] = left
            write_card(
                folder,
                summary,
                self.configs(folder),
                job.describe(folder, summary) if job.describe else "",
            )
            return draft.finish(summary)

    def _left_out(self, job: Job[O]) -> list[str]:
        """Sensors that the first episode stores and the format does not write."""
        with reading(sort_episodes(job.episodes)[0]) as file:
            return [
                name
                for name in sensors_of(file, file.cameras)
                if name not in self.sensors(job.options)
            ]


_HERE = "pipeline.export"
EXPORTERS = Registry[Exporter[Any]](
    "format",
    {
        "lerobot": f"{_HERE}.formats.lerobot.version30",
        "lerobot-v2.1": f"{_HERE}.formats.lerobot.version21",
        "aloha": f"{_HERE}.formats.aloha",
        "parquet": f"{_HERE}.formats.parquet",
        "rlds": f"{_HERE}.formats.rlds",
        "zarr": f"{_HERE}.formats.zarr",
        "robomimic": f"{_HERE}.formats.robomimic",
        "robotwin": f"{_HERE}.bridges.robotwin",
        "xpolicylab": f"{_HERE}.bridges.xpolicylab",
        "dynamicwam": f"{_HERE}.bridges.dynamicwam",
        "puma-gt": f"{_HERE}.bridges.puma_gt",
    },
)
"""Formats by name. A module of ours is imported, and registers its class, when its format is asked
for."""


def register[E: Exporter[Any]](kind: type[E]) -> type[E]:
    """Class decorator that makes a format known. Raises ValueError for a name that is taken."""
    EXPORTERS.add(kind.name, kind())
    return kind


__all__ = ["EXPORTERS", "Exporter", "Job", "NoOptions", "register"]
