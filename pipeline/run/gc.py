"""`domino-data gc`: removes what belongs to nothing any more. Only files that the factory itself writes; strays are the user's."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pipeline.data.atomic import remove, sweep
from pipeline.data.dataset import Dataset, DatasetError
from pipeline.data.episode.file import EpisodeError, EpisodeFile
from pipeline.data.recipe.model import Recipe
from pipeline.data.store.lock import exclusive
from pipeline.data.store.mirror import delete_uploaded

HALF = "half-written"
_EPISODE = re.compile(r"episode_\d{7,8}(_v\d+)?")
_ASSET = re.compile(r"[0-9a-f]{32}")


@dataclass(frozen=True)
class Orphan:
    """A file that belongs to nothing, relative to the dataset, why, and its bytes."""

    path: str
    why: str
    size: int


def collect(dataset: Dataset, dry_run: bool = False) -> list[Orphan]:
    """Remove, or only list, the orphaned files of a dataset.

    Orphans are episodes of no slot of the recipe, annotations of no episode, assets that no episode names, and partial files of
    dead processes of this machine. An episode of the recipe without a ledger entry stays: a resumed build writes both again. Raises
    Busy if another command writes the dataset, DatasetError if a build of it was killed, OSError if a file cannot be removed.
    """
    recipe = dataset.recipe()
    with exclusive(dataset.root):
        if any((dataset.ledger.root / "running").glob("*.running")):
            raise DatasetError(f"{dataset.root}: a build of it was killed: run it to its end first")
        found = sorted(_orphans(dataset, recipe), key=lambda orphan: orphan.path)
        if dry_run:
            return found
        sweep(dataset.root)  # of what is half-written only that whose process is gone
        gone = [dataset.root / orphan.path for orphan in found if orphan.why != HALF]
        for path in gone:
            remove(path)
        delete_uploaded(*gone)
        for folder in ("episodes", "annotations", "assets/bodies"):
            _remove_empty(dataset.root / folder)
    return found


def _orphans(dataset: Dataset, recipe: Recipe) -> Iterator[Orphan]:
    def orphan(path: Path, why: str) -> Orphan:
        return Orphan(path.relative_to(dataset.root).as_posix(), why, path.lstat().st_size)

    wanted = {f"{slot.path}.hdf5" for slot in recipe.slots()}
    held = set[str]()
    for path in dataset.episodes.rglob("*.hdf5"):
        name = path.relative_to(dataset.episodes).as_posix()
        if name in wanted:
            held.add(name)
        elif _EPISODE.fullmatch(path.stem):
            yield orphan(path, "episode of no slot")
    for stage in (dataset.root / "annotations").glob("*@*"):
        for path in stage.rglob("*.h5"):
            if path.relative_to(stage).with_suffix(".hdf5").as_posix() not in held and _EPISODE.fullmatch(path.stem):
                yield orphan(path, "annotation of no episode")
    named = _list_named(dataset, recipe, held)
    for path in dataset.bodies.glob("[0-9a-f][0-9a-f]/*.npz"):
        if named is not None and path.stem not in named and _ASSET.fullmatch(path.stem):
            yield orphan(path, "asset of no episode")
    for path in dataset.root.glob("**/.*.tmp"):
        yield orphan(path, HALF)


def _list_named(dataset: Dataset, recipe: Recipe, held: set[str]) -> set[str] | None:
    """The assets that episodes and stored failures name; None if one cannot be read, since any asset may be in use then."""
    entries = dataset.entries(recipe, ("assets",))
    named = set(entries.table["assets"].combine_chunks().flatten().to_pylist())
    known = {f"{slot.path}.hdf5" for slot, assets in zip(entries.slots, entries.table["assets"].to_pylist(), strict=True) if assets}
    for path in (*(dataset.episodes / name for name in held - known), *dataset.failures.rglob("*.hdf5")):
        try:
            with EpisodeFile(path) as file:
                named |= set(file.meta.drawing.assets.values())
        except (EpisodeError, OSError, KeyError, ValueError):
            return None
    return named


def _remove_empty(folder: Path) -> None:
    for path in sorted((p for p in folder.rglob("*") if p.is_dir()), reverse=True):
        if not any(path.iterdir()):
            path.rmdir()
