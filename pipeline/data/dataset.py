"""A dataset directory and its finished slots."""

import json
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.poses import Bools

from .atomic import atomic_path, write_atomic
from .errors import DAMAGE, DominoError, one_line
from .keys import seal_yaml
from .names import RETIRED
from .parsing import parse_json
from .reading import check_regular, check_tree, read_regular
from .recipe.file import is_edited, read_recipe
from .recipe.growth import differences, left_out
from .recipe.model import Recipe, RecipeError, Slot, parse_recipe
from .setup import Setup
from .slots.files import Listing, Paths, Rows
from .slots.index import FULL, Index
from .slots.records import ATTEMPTS, MOST_ATTEMPTS, OF_ATTEMPT, PLACE, SlotRecord
from .slots.reread import ask_index
from .store.place import place_of

EDITED = (
    "was edited after it was written; undo the edit. To change what a dataset holds, give `build`"
    " other options: a dataset only grows, anything else needs another --out"
)


class DatasetError(DominoError):
    """A dataset that cannot be used as asked: one line with the fix."""


def check_apart(out: Path, dataset: Path) -> None:
    """Raise DatasetError if `out` is a dataset, within it or around it."""
    there, here = out.resolve(), dataset.resolve()
    if here.is_relative_to(there) or there.is_relative_to(here):
        raise DatasetError(f"--out {out}: is inside the dataset or holds it: name another")


FOLDERS = ("annotations", "assets", "episodes", "exports", "failures", "logs", "orphans", "report")


class Dataset(Paths):
    """A dataset directory. Methods raise DatasetError for one without a readable recipe,
    OSError."""

    _is_plain = False

    def create(self, recipe: Recipe) -> None:
        """Freeze the recipe; a smaller dataset of it grows. Raises DatasetError for any other."""
        self.check_folders()
        if self.manifest.exists():
            self.check_seal()
            held = self.recipe()
            if held == recipe:
                return
            if changed := differences(held, recipe):
                raise DatasetError(
                    f"{self.root} holds another recipe: {'; '.join(changed)}: choose another --out"
                )
            if more := left_out(held, recipe):
                raise DatasetError(
                    f"{self.root} holds another recipe, with more: {'; '.join(more)}: name all of"
                    " it and what is new (a dataset only grows), or choose another --out"
                )
        else:
            place, here = place_of(self.root), self.root.exists() and any(self.root.iterdir())
            if here or (place and place.files(".*")):
                raise DatasetError(
                    f"{self.root} is not empty and is no dataset: choose another --out"
                )
        write_atomic(self.manifest, seal_yaml(recipe.to_yaml()))
        if place := place_of(self.root):
            place.put([self.manifest])

    def recipe(self) -> Recipe:
        """The frozen recipe, its names resolved."""
        self.check_folders()
        if not self.manifest.exists():
            raise DatasetError(f"{self.root} is no dataset: it has no manifest.yaml")
        check_regular(self.manifest)
        try:
            values = read_recipe(self.manifest)
            values.pop(RETIRED, None)  # its images are what they are
            recipe = parse_recipe(values, str(self.manifest))
        except RecipeError as error:
            raise DatasetError(str(error)) from error
        if not recipe.tasks:
            raise DatasetError(f"{self.manifest}: names no tasks, as a dataset does; restore it")
        return recipe

    def is_edited(self) -> bool:
        """Whether manifest.yaml was edited; one of version 0.1.0 has no seal."""
        self.recipe()
        return is_edited(self.manifest)

    def check_seal(self) -> None:
        """Raise DatasetError if manifest.yaml was edited."""
        if self.is_edited():
            raise DatasetError(f"{self.manifest}: {EDITED}")

    def setup(self) -> Setup:
        """The setup of the frozen recipe."""
        return self.recipe().setup

    def check_folders(self) -> None:
        """Raise DatasetError for a file in place of a directory, or a link, pipe or device
        below.
        """
        if os.path.lexists(self.root) and not self.root.is_dir():
            raise DatasetError(f"{self.root} is a file, and a dataset is a directory: name another")
        for name in FOLDERS:
            path = self.root / name
            if os.path.lexists(path) and not path.is_dir():
                raise DatasetError(f"{path} is a file, not a directory; remove it")
        if not self._is_plain:
            check_tree(self.root)
            self._is_plain = True

    def ask[T](self, question: Callable[[Index], T]) -> T:
        """What the index answers; it is made again if it is lost."""
        return ask_index(self, self.recipe, question)

    def rows(self, recipe: Recipe, *more: str) -> Rows:
        """The finished slots of a recipe, with more columns; files are not checked."""
        return self.ask(lambda index: index.rows(recipe, *more))

    def present(self, recipe: Recipe, *more: str) -> Rows:
        """As `rows`, if the file is there."""
        rows = self.rows(recipe, *more)
        return rows.where(self.there(recipe, rows))

    def there(self, recipe: Recipe, rows: Rows) -> Bools:
        """Of which rows (N,) the file is there."""
        return Listing(self.episodes, recipe).there(rows)

    def record(self, recipe: Recipe, slot: Slot) -> SlotRecord | None:
        """What is known of a slot, None if it is not finished."""
        return self.ask(lambda index: index.record(recipe, slot))

    def records(self, recipe: Recipe) -> list[tuple[Slot, SlotRecord]]:
        """As `present`, in full."""
        rows = self.present(recipe, *FULL)
        return self.ask(lambda index: list(index.records(rows)))

    def accepted(self, recipe: Recipe) -> list[Path]:
        """Episode files of the recipe's slots, in its order."""
        rows = self.present(recipe)
        return [self.episode(slot) for slot in rows.where(rows.accepted).slots]

    def missing(self, recipe: Recipe) -> list[Path]:
        """Files of accepted episodes that are not there, in the recipe's order."""
        rows = self.rows(recipe)
        gone = ~self.there(recipe, rows)
        return [self.episode(slot) for slot in rows.where(rows.accepted & gone).slots]

    def made_by(self) -> dict[str, Any]:
        """Content of provenance.json, {} without it. Raises DatasetError."""
        try:
            values = parse_json(read_regular(self.provenance))
        except FileNotFoundError:
            return {}
        except (OSError, ValueError) as error:
            what = getattr(error, "strerror", None) or one_line(error)
            raise DatasetError(
                f"{self.provenance}: cannot be read ({what}); run the build again"
            ) from error
        if not isinstance(values, dict) or not isinstance(values.get("packages", {}), dict):
            raise DatasetError(f"{self.provenance}: names no packages; run the build again")
        return values

    def attempt_rows(self, *names: str) -> list[dict[str, Any]]:
        """Columns of attempts.parquet, none without that file. Raises DatasetError."""
        if not self.attempts.exists():
            return []
        try:
            check_regular(self.attempts)
            with pq.ParquetFile(self.attempts) as file:
                if file.metadata.num_rows > MOST_ATTEMPTS:
                    raise ValueError(f"it has more than {MOST_ATTEMPTS:,} rows")
                table = file.read(columns=list(names)).select(names)
            return table.cast(pa.schema([ATTEMPTS.field(name) for name in names])).to_pylist()
        except (*DAMAGE, pa.ArrowException) as error:
            raise DatasetError(
                f"{self.attempts}: cannot be read ({one_line(error)}); delete it"
                " and run the build again"
            ) from error

    def write_attempts(self, recipe: Recipe) -> pa.Table:
        """Gather all attempts in attempts.parquet, in the recipe's order."""
        rows = self.present(recipe)
        table = self.ask(lambda index: attempts_table(index, rows))
        with atomic_path(self.attempts) as temporary:
            pq.write_table(table, temporary, compression="zstd")
        return table


def attempts_table(index: Index, rows: Rows) -> pa.Table:
    """Attempts at the slots of some rows, with the columns ATTEMPTS."""
    of, found = index.attempts(rows, *OF_ATTEMPT)
    values = zip(*found, strict=True) if found else [()] * len(OF_ATTEMPT)
    columns: dict[str, Any] = dict(zip(OF_ATTEMPT, values, strict=True))
    columns["conditions"] = [text and json.loads(text) for text in columns["conditions"]]
    cells = [rows.cells[rank] for rank in rows.ranks[of].tolist()]
    columns |= {name: [getattr(cell, name) for cell in cells] for name in PLACE[:5]}
    columns["slot"] = rows.index[of].tolist()
    return pa.table({name: columns[name] for name in ATTEMPTS.names}, ATTEMPTS)


FORBIDDING = re.compile(
    r"no[ -]?redistribution|not redistributable|proprietary|all rights reserved|confidential"
    r"|internal|-nd\b",
    re.I,
)
"""A licence that forbids to pass on what was made of the files, images included."""


def licences_in(made_by: Any) -> dict[str, str]:
    """Licences by robot or object, sources included."""
    found = dict[str, str]()
    for value in made_by if isinstance(made_by, list) else ():
        found |= licences_in(value)
    for key, value in made_by.items() if isinstance(made_by, dict) else ():
        if key == "licences":
            own = value.items() if isinstance(value, dict) else ()
            found = {str(name): str(text) for name, text in own} | found
        else:
            found |= licences_in(value)
    return dict(sorted(found.items()))


def forbidden(licences: dict[str, str]) -> list[str]:
    """What may not be published."""
    return [f"{name} ({text})" for name, text in licences.items() if FORBIDDING.search(text)]
