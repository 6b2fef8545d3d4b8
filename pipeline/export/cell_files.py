"""The common part of formats with one directory a cell: an HDF5 file and a file of instructions for each of its episodes."""

import json
from abc import abstractmethod
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.data.episode.file import EpisodeFile
from pipeline.data.episode.hdf5 import new_hdf5, open_hdf5
from pipeline.data.episode.meta import EpisodeMeta
from pipeline.data.recipe.model import Cell
from pipeline.data.spec import EpisodeSpec
from pipeline.export.common import Facts, group_episodes, judging, make_groups, read_facts, reading, write_json
from pipeline.export.exporter import Exporter, Job
from pipeline.export.hdf5_files import find_misplaced, write_files
from pipeline.export.images import JpegOrder
from pipeline.export.provenance import PROVENANCE, check_provenance
from pipeline.export.robotwin_arrays import SENSORS_WRITTEN

LARGE = ("/depth", "/actor_segmentation")
"""Arrays that are compressed; depth is float64, as in the original."""


class CellExporter[O](Exporter[O]):
    """One directory a cell, one HDF5 file an episode."""

    @abstractmethod
    def place(self, spec: EpisodeSpec) -> str:
        """Directory of an episode."""

    @abstractmethod
    def arrays(self, file: EpisodeFile, facts: Facts, options: O) -> dict[str, NDArray[Any]]:
        """Every array of an exported file by key. Raises ExportError for an episode that the format cannot hold."""

    @abstractmethod
    def order(self, options: O) -> JpegOrder:
        """Order of the colors in the JPEG files."""

    def lists(self, episodes: Sequence[tuple[EpisodeSpec, EpisodeMeta]]) -> Mapping[str, str]:
        """Text by name of the files that describe a directory; most formats have none."""
        return {}

    def sensors(self, options: O) -> Collection[str]:
        return SENSORS_WRITTEN

    def export(self, job: Job[O]) -> dict[str, Any]:
        """Write `job.out`. Raises ExportError for unreadable episodes and for those of one cell that differ in fps, cameras, image
        size or joint names."""

        def write(made: Path, file: EpisodeFile, facts: Facts) -> None:
            write_arrays(made, self.arrays(file, facts, job.options), facts, self.order(job.options))

        with self.draft(job) as draft:
            frames, groups = 0, group_episodes(job.episodes, self.place)
            for name, paths in groups.items():
                root, told = draft.folder / name, list[tuple[EpisodeSpec, EpisodeMeta]]()
                (root / "instructions").mkdir(parents=True)
                places = {path: _file(root, index) for index, path in enumerate(paths)}
                for index, facts in enumerate(write_files(draft, job, root, places, write)):
                    write_json(_words(root, index), _instructions(facts))
                    told.append((facts.spec, facts.meta))
                    frames += len(facts)
                for file, text in self.lists(told).items():
                    (root / file).write_text(text)
            values = {"episodes": len(job.episodes), "frames": frames, "configurations": list(groups)}
            return self.summarize(draft.folder, job, values)

    def compare(self, dataset: Path, out: Path, episodes: Sequence[Path], options: O) -> list[str]:
        """Arrays and the bytes of images must be equal; for order bgr they are encoded again, which gives the same bytes."""
        problems: list[str] = []
        for name, paths in group_episodes(episodes, self.place).items():
            root, told = out / name, list[tuple[EpisodeSpec, EpisodeMeta]]()
            found = {*(root / "data").glob("episode*.hdf5")}
            problems += find_misplaced({_file(root, index) for index in range(len(paths))}, found)
            for index, path in enumerate(paths):
                with reading(path) as file:
                    facts = read_facts(file, dataset)
                    wanted = self.arrays(file, facts, options) if _file(root, index) in found else {}
                told.append((facts.spec, facts.meta))
                if wanted:
                    with judging(_file(root, index), problems):
                        differ = _differences(_file(root, index), wanted, facts, self.order(options))
                        problems += [f"{_file(root, index)}: {what} differs from {path}" for what in differ]
                    with judging(_words(root, index), problems):
                        if json.loads(_words(root, index).read_text()) != _instructions(facts):
                            problems.append(f"{_words(root, index)}: instructions differ from {path}")
            with judging(root, problems):
                for name, text in self.lists(told).items():
                    if (root / name).read_text() != text:
                        problems.append(f"{root / name}: is not that of the episodes")
            with judging(root / PROVENANCE, problems):
                problems += check_provenance(root / PROVENANCE, dataset, paths)
        return problems


def _file(root: Path, index: int) -> Path:
    return root / "data" / f"episode{index}.hdf5"


def _words(root: Path, index: int) -> Path:
    return root / "instructions" / f"episode{index}.json"


def _instructions(facts: Facts) -> dict[str, list[str]]:
    return {"seen": facts.seen, "unseen": facts.unseen}


def configuration(spec: EpisodeSpec) -> str:
    """Directory of an episode: task, then what the original calls the task configuration."""
    task, *rest = Cell(spec.task, spec.embodiment, spec.level, spec.alpha, spec.domain).path.split("/")
    return f"{task}/{'_'.join(rest)}"


def write_arrays(path: Path, arrays: Mapping[str, NDArray[Any]], facts: Facts, order: JpegOrder) -> None:
    """Write an exported file: its arrays by key, and attributes."""
    with new_hdf5(path) as f:
        f.attrs["jpeg_order"], f.attrs["fps"], f.attrs["spec"] = order, facts.fps, facts.spec.to_json()
        make_groups(f, arrays)
        if painted := [key for key in arrays if key.endswith("/actor_segmentation")]:
            f[painted[0].split("/")[0]].attrs["bodies"] = list(facts.log.bodies)
        for key, values in arrays.items():
            if key.endswith(LARGE):
                kind = np.float64 if key.endswith("/depth") else values.dtype
                f.create_dataset(key, data=values, dtype=kind, compression="gzip", compression_opts=1, shuffle=True)
            else:
                f[key] = values


def _differences(path: Path, wanted: Mapping[str, NDArray[Any]], facts: Facts, order: JpegOrder) -> list[str]:
    """What of a file is not that of its episode. Raises what h5py raises for a damaged file."""
    with open_hdf5(path) as opened:
        f: Any = opened
        differ = [key for key, want in wanted.items() if not np.array_equal(f[key][()], want)]
        if f.attrs["jpeg_order"] != order or f.attrs["spec"] != facts.spec.to_json():
            differ.append("JPEG order or spec")
        cameras = {key.split("/")[1] for key in wanted if key.startswith("observation/")}
        return differ + [f"{camera} beside the cameras" for camera in sorted({*f["observation"]} - cameras)]
