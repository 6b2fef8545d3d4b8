"""A dataset directory: where its files are, and what its ledger says is there. Reading one needs no simulator."""

import os
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.data.atomic import atomic_path, remove, write_atomic
from pipeline.data.errors import DominoError
from pipeline.data.keys import file_hash
from pipeline.data.ledger.columns import single
from pipeline.data.ledger.entries import Entries, Files
from pipeline.data.ledger.files import Ledger
from pipeline.data.ledger.lookup import Lookup
from pipeline.data.ledger.records import SlotRecord
from pipeline.data.ledger.stamps import DAMAGED
from pipeline.data.ledger.table import ONE
from pipeline.data.names import MANIFEST, RETIRED
from pipeline.data.parsing import parse_json
from pipeline.data.reading import check_regular, read_regular
from pipeline.data.recipe.file import is_edited, read_recipe
from pipeline.data.recipe.growth import differences, left_out
from pipeline.data.recipe.model import Recipe, RecipeError, Slot, parse_recipe
from pipeline.data.sealed import seal_yaml
from pipeline.data.setup import Setup
from pipeline.data.store.files import StoreError
from pipeline.data.store.mirror import delete_uploaded, upload

CHANGED = "bytes differ from the ledger's sha256; remove it, and rerun the build command of this dataset"
"""What is said of an episode file that is not the one that was written. A build does not read a file again whose length and time of
change are as they were."""

REMAKE = "remove it, if it is there, and run the build again to make its slot"
"""What helps where a failed attempt that is kept is not the file that was written."""


EDITED = (
    "was edited after it was written; undo the edit. To change what a dataset holds, give `build` other options: "
    "a dataset only grows, anything else needs another --out"
)
"""What is said of a manifest whose values are not those that were frozen."""


class DatasetError(DominoError):
    """A dataset directory that cannot be used as asked: one line with the fix."""


FOLDERS = ("annotations", "assets", "episodes", "exports", "failures", "ledger", "logs", "orphans", "report")
"""Directories of a dataset."""


def missed(paths: Sequence[Path]) -> str:
    """One line on finished episodes that are missing."""
    many = "1 episode is" if len(paths) == 1 else f"{len(paths)} episodes are"
    return f"{many} missing that the ledger calls finished, first {paths[0]}; rerun the build command of this dataset"


class Dataset:
    """Paths and ledger of one dataset directory. Paths are made from the recipe's slots, whose names are plain names."""

    def __init__(self, root: Path) -> None:
        self.root = root = Path(root)
        self.manifest = root / MANIFEST
        """The frozen recipe."""
        self.attempts = root / "attempts.parquet"
        """The table of all attempts."""
        self.provenance = root / "provenance.json"
        """What made the dataset: code, packages, renderer, processor."""
        self.report = root / "report" / "index.html"
        """The report's first page."""
        self.assets = root / "assets"
        """Vendor meshes that the recipe names (robots/), and what the images were drawn from (bodies/)."""
        self.bodies = self.assets / "bodies"
        """Meshes and materials of every body in the images, each once, by hash."""
        self.episodes = root / "episodes"
        """Directory of the episode files."""
        self.failures = root / "failures"
        """Directory of the failed attempts that are kept: no episodes of the dataset."""
        self.orphans = root / "orphans"
        """Whole episodes that belong to no slot, which `gc` has moved here."""
        self.ledger = Ledger(root / "ledger")
        """Which slots are finished."""

    def episode(self, slot: Slot) -> Path:
        """Path of a slot's episode file."""
        return self.episodes / f"{slot.path}.hdf5"

    def failure(self, slot: Slot, attempt: int) -> Path:
        """Path of a failed attempt at a slot."""
        return self.failures / f"{slot.path}_attempt_{attempt:03d}.hdf5"

    def kept_failures(self, recipe: Recipe) -> Iterator[tuple[Path, dict[str, Any]]]:
        """Files of the failed attempts that the ledger says are kept, in the recipe's order, with the rows of these attempts."""
        kept = single(self.entries(recipe, (f"{ONE}kept",)).table["attempts"]).flatten().field("kept")
        if not any(kept.unique().to_pylist()):
            return  # most datasets keep none, and full entries take time
        for slot, record in self.records(recipe):
            for row in record.attempts:
                if row.get("kept"):
                    yield self.failure(slot, row["attempt"]), row

    def intact_failures(self, recipe: Recipe) -> list[Path]:
        """As `kept_failures`, after reading every file. Raises DatasetError for one that is missing or not the ledger's."""
        found = list(self.kept_failures(recipe))
        for path, row in found:
            try:
                same = file_hash(path) == row["kept"]
            except OSError as error:
                raise DatasetError(f"{path}: cannot be read ({error.strerror}); {REMAKE}") from error
            if not same:
                raise DatasetError(f"{path}: bytes differ from the ledger's sha256; {REMAKE}")
        return [path for path, _ in found]

    def log(self, slot: Slot) -> Path:
        """Where the log of a slot that failed is."""
        return self.root / "logs" / f"{slot.path}.log"

    def exports(self, name: str) -> Path:
        """Default place of an export."""
        return self.root / "exports" / name

    def create(self, recipe: Recipe) -> None:
        """Freeze the recipe, or check that the directory already holds this one or a part of it, which then grows.

        Raises DatasetError if it holds another, or more.
        """
        self.check_folders()
        if self.manifest.exists():
            self.check_seal()
            held = self.recipe()
            if held == recipe:
                return
            if changed := differences(held, recipe):
                raise DatasetError(f"{self.root} holds another recipe: {'; '.join(changed)}: choose another --out")
            if more := left_out(held, recipe):
                raise DatasetError(
                    f"{self.root} holds another recipe, with more: {'; '.join(more)}: name all of it and what is new "
                    "(a dataset only grows), or choose another --out"
                )
            self._freeze(recipe)
            return
        if self.root.exists() and any(self.root.iterdir()):
            raise DatasetError(f"{self.root} is not empty and is no dataset: choose another --out")
        self._freeze(recipe)

    def _freeze(self, recipe: Recipe) -> None:
        write_atomic(self.manifest, seal_yaml(recipe.to_yaml()))
        upload(self.manifest)

    def recipe(self) -> Recipe:
        """The frozen recipe, whose names were resolved when it was frozen. Raises DatasetError if there is none."""
        self.check_folders()
        if not self.manifest.exists():
            raise DatasetError(f"{self.root} is no dataset: it has no manifest.yaml")
        try:
            check_regular(self.manifest)
        except OSError as error:
            raise DatasetError(f"{self.manifest}: {error.strerror}") from error
        try:
            values = read_recipe(self.manifest)
            values.pop(RETIRED, None)  # its images are what they are
            recipe = parse_recipe(values, str(self.manifest))
        except RecipeError as error:
            raise DatasetError(str(error)) from error
        if not recipe.tasks:
            raise DatasetError(f"{self.manifest}: names no tasks, so it is not the manifest of a dataset; restore it")
        return recipe

    def is_edited(self) -> bool:
        """Whether the values of manifest.yaml are not those that were frozen. A dataset of version 0.1.0 has no seal: False.

        Raises DatasetError for a manifest that cannot be read.
        """
        self.recipe()
        return is_edited(self.manifest)

    def check_seal(self) -> None:
        """Raise DatasetError if manifest.yaml was edited, or cannot be read."""
        if self.is_edited():
            raise DatasetError(f"{self.manifest}: {EDITED}")

    def setup(self) -> Setup:
        """The setup of the frozen recipe. Raises DatasetError if there is none."""
        return self.recipe().setup

    def check_folders(self) -> None:
        """Raise DatasetError for a file where the dataset or one of its directories belongs."""
        if os.path.lexists(self.root) and not self.root.is_dir():
            raise DatasetError(f"{self.root} is a file, and a dataset is a directory: name another")
        for name in FOLDERS:
            path = self.root / name
            if os.path.lexists(path) and not path.is_dir():
                raise DatasetError(f"{path} is a file, not a directory; remove it")

    def record(self, slot: Slot) -> SlotRecord | None:
        """The ledger entry of a slot, or None if there is none or it is damaged; for many slots, `records`. Raises OSError."""
        return Lookup(self.ledger).record(slot.path)

    def entries(self, recipe: Recipe, columns: Sequence[str] | None = None) -> Entries:
        """The ledger of the recipe's slots as it is now, of all columns or some. Raises OSError."""
        return Entries.read(self.ledger, recipe, columns)

    def present(self, entries: Entries) -> Entries:
        """Those entries that were given up or whose episode is there."""
        return entries.where(Files(self.episodes).listed(entries) | ~np.array(entries.accepted, bool))

    def records(self, recipe: Recipe) -> Iterator[tuple[Slot, SlotRecord]]:
        """Every slot of the recipe that was filled or given up, in the recipe's order; those whose episode is missing are not."""
        for slot, record in self.present(self.entries(recipe)).records():
            if record is not None:
                yield slot, record

    def accepted(self, recipe: Recipe) -> list[Path]:
        """Episode files of the recipe's slots, in its order."""
        found = self.present(self.entries(recipe, ()))
        return [self.episode(slot) for slot, accepted in zip(found.slots, found.accepted, strict=True) if accepted]

    def missing(self, recipe: Recipe) -> list[Path]:
        """Files of the episodes that the ledger calls finished and that are not there, in the recipe's order."""
        entries = self.entries(recipe, ())
        gone = entries.where(np.array(entries.accepted, bool) & ~Files(self.episodes).listed(entries))
        return [self.episode(slot) for slot in gone.slots]

    def intact(self, slot: Slot, record: SlotRecord) -> bool:
        """Whether a slot's episode is there with the bytes that its ledger entry names. Raises PermissionError."""
        return self.hashed(slot, record.sha256)

    def hashed(self, slot: Slot, sha256: str) -> bool:
        """Whether a slot's episode is there with bytes of this hash. Raises PermissionError."""
        try:
            return file_hash(self.episode(slot)) == sha256
        except PermissionError:
            raise
        except OSError:
            return False

    def check_bytes(self, episode: Path) -> None:
        """Raise DatasetError for an episode file, relative to `episodes`, whose bytes are not those of its ledger entry.

        A directory without a ledger was not built: there is nothing to compare with.
        """
        if not (self.root / "ledger").is_dir():
            return
        record = Lookup(self.ledger).record(episode.with_suffix("").as_posix())
        if record is None:
            raise DatasetError(f"{self.episodes / episode}: has no ledger entry: it belongs to no finished slot")
        try:
            same = record.accepted and file_hash(self.episodes / episode) == record.sha256
        except OSError as error:
            raise DatasetError(f"{self.episodes / episode}: cannot be read ({error.strerror})") from error
        if not same:
            raise DatasetError(f"{self.episodes / episode}: {CHANGED}")

    def intact_episodes(self, recipe: Recipe) -> list[Path]:
        """As `accepted`, after reading every file. Raises DatasetError for those that are missing, cannot be read or are not the
        ledger's."""
        if missing := self.missing(recipe):
            raise DatasetError(missed(missing))
        entries = self.present(self.entries(recipe, ("stamp",)))
        pairs = zip(entries.slots, entries.table["sha256"].to_pylist(), strict=True)
        found = [(slot, sha256) for slot, sha256 in pairs if sha256]
        stamps = zip(entries.slots, entries.table["stamp"].to_pylist(), strict=True)
        if bad := next((slot for slot, stamp in stamps if stamp == DAMAGED), None):
            raise DatasetError(f"{self.episode(bad)}: verify found it damaged; rerun the build command of this dataset")
        with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as threads:
            try:
                hashes = list(threads.map(lambda pair: file_hash(self.episode(pair[0])), found))
            except OSError as error:
                raise DatasetError(f"{error.filename}: cannot be read ({error.strerror}); run the build again") from error
        damaged = [slot for (slot, sha256), found_hash in zip(found, hashes, strict=True) if found_hash != sha256]
        if damaged:
            others = f" and {len(damaged) - 1} others" if len(damaged) > 1 else ""
            raise DatasetError(f"{self.episode(damaged[0])}{others}: {CHANGED}")
        return [self.episode(slot) for slot, _ in found]

    def made_by(self) -> dict[str, Any]:
        """What provenance.json says; empty if there is none. Raises DatasetError for one that cannot be read."""
        try:
            values = parse_json(read_regular(self.provenance))
        except FileNotFoundError:
            return {}
        except (OSError, ValueError) as error:
            said = (error.strerror if isinstance(error, OSError) else None) or " ".join(str(error).split())
            raise DatasetError(f"{self.provenance}: cannot be read ({said}); run the build again") from error
        if not isinstance(values, dict):
            raise DatasetError(f"{self.provenance}: does not name what made the dataset; run the build again")
        return values

    def withdraw(self, slots: Iterable[Slot]) -> None:
        """Remove the episodes of slots without entries: a command was stopped after a worker wrote them.

        Where that was for a store that does not answer, they stay there, as after SIGKILL, and the next build makes them again.
        """
        found = [path for path in map(self.episode, slots) if path.exists()]
        for path in found:
            remove(path)
        with suppress(StoreError):
            delete_uploaded(*found)

    def write_attempts(self, recipe: Recipe) -> pa.Table:
        """Gather all attempts of the filled slots into attempts.parquet, in the recipe's order."""
        table = self.present(self.entries(recipe, ("attempts",))).attempts()
        with atomic_path(self.attempts) as temporary:
            pq.write_table(table, temporary, compression="zstd")
        return table
