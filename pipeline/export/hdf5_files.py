"""The common part of formats with one HDF5 file an episode: each format defines the directory, the names and the content."""

from abc import abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from pipeline.data.episode.file import EpisodeFile
from pipeline.data.episode.hdf5 import new_hdf5, open_hdf5
from pipeline.export.common import Facts, judging, make_groups, read_facts, reading, same
from pipeline.export.exporter import Exporter, Job
from pipeline.export.provenance import PROVENANCE, Provenance, check_provenance
from pipeline.export.reuse import Draft

FRAMES_A_CHUNK = 1
"""Training reads single frames: each image is a chunk of its own."""


@dataclass(frozen=True)
class Contents:
    """One file: arrays and texts by key, attributes of its root, and arrays that are those of other keys one frame later.

    The last frame of such an array is that of the other key once more; only a reference is stored (an HDF5 virtual dataset).
    """

    values: Mapping[str, NDArray[Any] | str]
    attributes: Mapping[str, Any]
    later: Mapping[str, str] = field(default_factory=dict[str, str])

    def write(self, path: Path) -> None:
        """Write the file. Raises OSError."""
        with new_hdf5(path, rdcc_nbytes=2 * 1024**2) as f:
            f.attrs.update(self.attributes)
            make_groups(f, [*self.values, *self.later])
            for key, value in self.values.items():
                if isinstance(value, str):
                    f.create_dataset(key, data=value, dtype=h5py.string_dtype())
                else:
                    images = value.ndim >= 3 and value.size > 0
                    f.create_dataset(key, data=value, chunks=(FRAMES_A_CHUNK, *value.shape[1:]) if images else None)
            for key, source in self.later.items():
                values: Any = self.values[source]
                layout = h5py.VirtualLayout(values.shape, values.dtype)
                layout.dcpl.set_obj_track_times(False)  # h5py leaves the clock out of all but these
                frames: Any = h5py.VirtualSource(".", source, values.shape)
                layout[:-1], layout[-1:] = frames[1:], frames[-1:]
                f.create_virtual_dataset(key, layout)

    def differences(self, path: Path) -> list[str]:
        """Keys and attributes that are other ones in a file. Raises what h5py raises for a damaged file."""
        with open_hdf5(path) as opened:
            f: Any = opened
            found: list[str] = []
            f.visititems(lambda key, item: found.append(key) if isinstance(item, h5py.Dataset) else None)
            differ = sorted({*found} ^ {*self.values, *self.later})
            for key, want in self.values.items():
                if key in found:
                    got = f[key].asstr()[()] if isinstance(want, str) else f[key][()]
                    differ += [key] * (not np.array_equal(got, want))
            for key, source in self.later.items():
                if key in found and source in found:
                    want = np.asarray(self.values[source])
                    differ += [key] * (not np.array_equal(f[key][()], want[np.minimum(np.arange(len(want)) + 1, len(want) - 1)]))
            return differ + [name for name, want in self.attributes.items() if not np.array_equal(f.attrs.get(name), want)]


def write_files(
    draft: Draft,
    job: Job[Any],
    directory: Path,
    places: Mapping[Path, Path],
    write: Callable[[Path, EpisodeFile, Facts], None],
    also: Sequence[Any] = (),
) -> Iterator[Facts]:
    """Give each episode its file at `places`, written or taken over from the older export, and `directory` its episodes.parquet.

    `also` is what a file is made from beside its episode, plain data. Yields the facts of each episode. Raises ExportError for
    unreadable episodes and for those that do not fit together."""
    first = None
    with closing(Provenance(directory / PROVENANCE)) as rows:
        for episode, made in places.items():
            made_from = ["episode", draft.hash_of(episode), *also]
            kept = draft.keep(made, made_from)
            with reading(episode) as file:
                facts = read_facts(file, job.dataset)
                first = first or facts
                same(first, facts)
                if not kept:
                    made.parent.mkdir(parents=True, exist_ok=True)
                    write(made, file, facts)
                    draft.record(made, made_from)
            rows.append(facts)
            job.advance()
            yield facts


def find_misplaced(wanted: Collection[Path], found: Collection[Path]) -> list[str]:
    """Files that an export lacks or should not have."""
    missing = [f"{path}: is missing" for path in sorted({*wanted} - {*found})]
    return missing + [f"{path}: belongs to no episode" for path in sorted({*found} - {*wanted})]


class Hdf5Exporter[O](Exporter[O]):
    """Directories of files that are numbered in the order of the episodes."""

    @abstractmethod
    def directories(self, episodes: Sequence[Path], out: Path) -> dict[Path, list[Path]]:
        """Directory -> its episodes in order. Episodes of one directory must have the same cameras, joints and fps."""

    @abstractmethod
    def file(self, directory: Path, index: int) -> Path:
        """The file of an episode."""

    @abstractmethod
    def cameras(self, facts: Facts, options: O) -> dict[str, str]:
        """Name in the file of each camera that the format takes. Raises ExportError if that fails."""

    @abstractmethod
    def contents(self, file: EpisodeFile, facts: Facts, options: O) -> Contents:
        """What the file of an episode holds. Raises ExportError for an episode that the format cannot hold."""

    def finish(self, directory: Path) -> None:
        """Write what describes a whole directory, from its episodes.parquet; most formats have nothing more to write."""

    def unfinished(self, directory: Path) -> list[str]:
        """What is wrong with what `finish` wrote; [] when all is well. Raises what h5py and Arrow raise for damaged files."""
        return []

    def export(self, job: Job[O]) -> dict[str, Any]:
        """Write `job.out`. Raises ExportError for unreadable episodes and for those of one directory that do not fit together."""

        def write(made: Path, file: EpisodeFile, facts: Facts) -> None:
            self.contents(file, facts, job.options).write(made)

        with self.draft(job) as draft:
            frames, cameras, directories = 0, dict[str, str](), self.directories(job.episodes, draft.folder)
            for directory, paths in directories.items():
                places = {path: self.file(directory, index) for index, path in enumerate(paths)}
                for facts in write_files(draft, job, directory, places, write):
                    frames += len(facts)
                    cameras |= self.cameras(facts, job.options)
                self.finish(directory)
            values = {"episodes": len(job.episodes), "frames": frames, "cameras": cameras}
            names = sorted(path.relative_to(draft.folder).as_posix() for path in directories)
            return self.summarize(draft.folder, job, values | {"directories": names})

    def compare(self, dataset: Path, out: Path, episodes: Sequence[Path], options: O) -> list[str]:
        """Every array, text and attribute must be that of the episode."""
        problems: list[str] = []
        for directory, paths in self.directories(episodes, out).items():
            wanted = {self.file(directory, index) for index in range(len(paths))}
            found = {path for path in self.file(directory, 0).parent.glob("*.hdf5") if path.is_file()}
            problems += find_misplaced(wanted, found)
            for index, path in enumerate(paths):
                exported = self.file(directory, index)
                if exported in found:
                    with reading(path) as file:
                        contents = self.contents(file, read_facts(file, dataset), options)
                    with judging(exported, problems):
                        problems += [f"{exported}: {what} differs from {path}" for what in contents.differences(exported)]
            with judging(directory, problems):
                problems += check_provenance(directory / PROVENANCE, dataset, paths)
                problems += self.unfinished(directory)
        return problems
