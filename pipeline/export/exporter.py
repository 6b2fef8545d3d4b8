"""The contract of an export format: one class, its options, and the registry that `export` and `verify` look formats up in."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar

from pipeline.export.options import NoOptions
from pipeline.export.shared.card import write_card
from pipeline.export.shared.common import (
    EPISODES,
    SOURCES,
    SUMMARY,
    ExportError,
    Progress,
    read_summary,
    reading,
    sort_episodes,
    stage_directory,
    write_json,
)
from pipeline.export.shared.contents import contents_of
from pipeline.export.shared.hashes import Draft
from pipeline.export.shared.sensors import sensors_of
from pipeline.registry import Registry

LEFT_OUT = "sensors_left_out"
"""Key of the summary: sensors that the dataset has and the export has not."""


@dataclass(frozen=True)
class Job[O]:
    """One export: the dataset's root, where to write, the episode files, the options of the format.

    `progress(1)` is called after each episode. `workers` is how many processes may work; what is written never depends on it.
    `describe(folder, summary)` gives the text of the card, Markdown, and may write images into the folder; without it the card says
    only what the summary does. `split` says whether these are the episodes or the failed attempts that are kept, `where` which
    of them were selected (export/shared/selection.py), empty for all.
    """

    dataset: Path
    out: Path
    episodes: Sequence[Path]
    options: O
    progress: Progress = None
    workers: int = 1
    describe: Callable[[Path, Mapping[str, Any]], str] | None = None
    split: str = EPISODES
    where: str = ""

    def advance(self) -> None:
        """Count one more written episode."""
        if self.progress is not None:
            self.progress(1)


class Exporter[O](ABC):
    """How a format is written and how an export is compared with its episodes.

    `name` is what `--format` calls it; `options` is a frozen dataclass of fields made by `option`.
    """

    name: ClassVar[str]
    options: type[O]

    @abstractmethod
    def export(self, job: Job[O]) -> dict[str, Any]:
        """Write `job.out` and return its summary. It appears by rename when everything is written, and an older export is
        replaced only then (`draft`). Episodes are ordered by path. Raises ExportError in one line."""

    def check(self, dataset: Path, out: Path, episodes: Sequence[Path]) -> list[str]:
        """Compare an export with its episodes; returns the problems found, [] when all is well.

        Raises ExportError for episode files that cannot be read.
        """
        try:
            options = self.options_of(out)
        except ExportError as error:
            return [str(error)]
        return self.compare(dataset, out, episodes, options)

    @abstractmethod
    def compare(self, dataset: Path, out: Path, episodes: Sequence[Path], options: O) -> list[str]:
        """As `check`, with the options that the export was made with."""

    @contextmanager
    def draft(self, job: Job[O]) -> Iterator[Draft]:
        """A temporary directory, and what the export at `job.out` lends it; it becomes `job.out` when the block ends well and
        vanishes when it does not. Raises ExportError as `common.stage_directory`, and for an export of another format there."""
        found: object = self.name
        with suppress(ExportError):  # a damaged export is replaced
            found = read_summary(job.out).get("format", self.name)
        if found != self.name:
            raise ExportError(f"{job.out}: holds an export in the format {str(found)[:40]}: remove it or name another directory")
        with stage_directory(job.out, job.dataset) as folder:
            options = asdict(job.options)  # pyright: ignore[reportArgumentType]
            draft = Draft(folder, job.out, {"format": self.name, "options": options})
            yield draft
            draft.finish(job.dataset, job.episodes)

    def summarize(self, folder: Path, job: Job[O], values: dict[str, Any]) -> dict[str, Any]:
        """Write the card and export.json: format, options, `values`, bytes and names of all files. Returns the latter."""
        options = asdict(job.options)  # pyright: ignore[reportArgumentType]
        summary = {"format": self.name, "options": options, "split": job.split, **values}
        if job.where:
            summary["where"] = job.where
        if left := self.left_out(job):
            summary[LEFT_OUT] = left
        write_card(folder, summary, self.configs(folder), job.describe(folder, summary) if job.describe else "")
        summary["bytes"] = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
        summary["contents"] = sorted({SOURCES, SUMMARY, *contents_of(folder)})
        write_json(folder / SUMMARY, summary)
        return summary

    def sensors(self, options: O) -> Collection[str]:
        """Which sensors (`sensors.SENSORS`) the format writes with these options; the summary names those that it leaves out."""
        return ()

    def configs(self, folder: Path) -> list[dict[str, Any]]:
        """What the front matter of the card says about data files, so that `datasets.load_dataset` finds them; [] for a format that
        it cannot read. `folder` holds all but the card."""
        return []

    def left_out(self, job: Job[O]) -> list[str]:
        """Sensors that the first episode stores and the format does not write."""
        with reading(sort_episodes(job.episodes)[0]) as file:
            return [name for name in sensors_of(file, file.cameras) if name not in self.sensors(job.options)]

    def options_of(self, out: Path) -> O:
        """The options an export was made with. Raises ExportError if its export.json cannot be read."""
        try:
            return self.options(**read_summary(out)["options"])
        except (KeyError, TypeError) as error:
            raise ExportError(f"{out}: its {SUMMARY} is of another version; export again") from error


EXPORTERS = Registry[Exporter[Any]]("format")


def register[E: Exporter[Any]](kind: type[E]) -> type[E]:
    """Class decorator: make a format known under its `name`. Raises ValueError for a name that is taken."""
    EXPORTERS.add(kind.name, kind())
    return kind


__all__ = ["EXPORTERS", "Exporter", "Job", "NoOptions", "register"]
