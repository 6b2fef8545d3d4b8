"""The common part of formats with one HDF5 file an episode."""

from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
from numpy.typing import NDArray

from pipeline.data.episode.file import EpisodeFile
from pipeline.data.episode.hdf5 import new_hdf5
from pipeline.export.exporter import Exporter, Job
from pipeline.export.shared.draft import ExportDraft
from pipeline.export.shared.episodes import Facts, by_embodiment, exported_cameras
from pipeline.export.shared.tables import PROVENANCE, Provenance

type Storage = Callable[[str, NDArray[Any]], dict[str, Any] | None]
"""Options of h5py for an array by its key and values; None for an array that is assigned, which
h5py links after its values."""


def chunk_images(key: str, values: NDArray[Any]) -> dict[str, Any]:
    """One chunk each: training reads single frames."""
    return {"chunks": (1, *values.shape[1:])} if values.ndim >= 3 and values.size else {}


@dataclass(frozen=True)
class Contents:
    """One file. `later` names virtual datasets, which are others one frame later. The order in the
    file depends on `cache`, the bytes of chunks that h5py holds."""

    values: Mapping[str, NDArray[Any] | str]
    attributes: Mapping[str, Any]
    later: Mapping[str, str] = field(default_factory=dict[str, str])
    storage: Storage = chunk_images
    of_groups: Mapping[str, Mapping[str, Any]] = field(default_factory=dict[str, Mapping[str, Any]])
    cache: int | None = 2 * 1024**2

    def write(self, path: Path) -> None:
        with new_hdf5(path, rdcc_nbytes=self.cache) as f:
            f.attrs.update(self.attributes)
            _make_groups(f, [*self.values, *self.later])
            for group, attributes in self.of_groups.items():
                f[group].attrs.update(attributes)
            for key, value in self.values.items():
                is_text = isinstance(value, str)
                options = {"dtype": h5py.string_dtype()} if is_text else self.storage(key, value)
                if options is None:
                    f[key] = value
                else:
                    f.create_dataset(key, data=value, **options)
            for key, source in self.later.items():
                values: Any = self.values[source]
                layout = h5py.VirtualLayout(values.shape, values.dtype)
                layout.dcpl.set_obj_track_times(False)  # h5py leaves the clock out of all but these
                frames: Any = h5py.VirtualSource(".", source, values.shape)
                layout[:-1], layout[-1:] = frames[1:], frames[-1:]
                f.create_virtual_dataset(key, layout)


def _make_groups(file: h5py.File, keys: Iterable[str]) -> None:
    """Before arrays: groups that h5py makes carry the time of day."""
    for key in keys:
        parts = key.split("/")
        for depth in range(1, len(parts)):
            file.require_group("/".join(parts[:depth]))


class Hdf5Exporter[O](Exporter[O]):
    """Files are numbered in the order of the episodes."""

    def directories(self, episodes: Sequence[Path], out: Path) -> dict[Path, list[Path]]:
        return dict(by_embodiment(episodes, out).values())

    @abstractmethod
    def file(self, directory: Path, index: int) -> Path: ...

    def cameras(self, facts: Facts, options: O) -> dict[str, str]:
        return exported_cameras(facts, getattr(options, "camera_names", {}))

    @abstractmethod
    def contents(self, file: EpisodeFile, facts: Facts, options: O, shared: Any) -> Contents: ...

    def shared(self, paths: Sequence[Path], options: O) -> Any:
        """Plain data on which files depend beside their episodes."""
        return None

    def note(self, directory: Path, index: int, facts: Facts) -> Any:
        """Write what belongs to an episode beside its file; returns what `finish` needs of it."""

    def finish(self, directory: Path, validation: float, notes: Sequence[Any]) -> None: ...

    def sum_up(self, values: dict[str, Any], name: str, first: Facts, options: O) -> None:
        values.setdefault("cameras", {}).update(self.cameras(first, options))
        values.setdefault("directories", []).append(name)

    def write(self, job: Job[O], draft: ExportDraft) -> dict[str, Any]:
        values: dict[str, Any] = {"episodes": len(job.episodes), "frames": 0}
        options = job.options
        for directory, paths in self.directories(job.episodes, draft.folder).items():
            shared, notes = self.shared(paths, options), list[Any]()
            with closing(Provenance(directory / PROVENANCE, draft)) as rows:
                for index, path in enumerate(paths):
                    made = self.file(directory, index)
                    made.parent.mkdir(parents=True, exist_ok=True)
                    with rows.noting(job, path) as (file, facts):
                        self.contents(file, facts, options, shared).write(made)
                    if index == 0:
                        name = directory.relative_to(draft.folder).as_posix()
                        self.sum_up(values, name, facts, options)
                    notes.append(self.note(directory, index, facts))
            values["frames"] += rows.frames
            self.finish(directory, job.validation, notes)
        return values
