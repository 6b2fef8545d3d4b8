"""`domino-data gc`: removes orphaned files."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pipeline.data.atomic import exclusive, remove, sweep
from pipeline.data.dataset import Dataset, DatasetError
from pipeline.data.episode.file import EpisodeError, EpisodeFile
from pipeline.data.recipe.model import Recipe
from pipeline.data.store.place import delete, put

HALF = "half-written"
WHOLE = "whole episode of no slot, goes to orphans/"
LARGE = 0.25
"""Share of whole episodes of no slot above which nothing is touched: then the recipe is wrong."""
_EPISODE = re.compile(r"episode_\d{7,8}(_v\d+)?")
_ASSET = re.compile(r"[0-9a-f]{32}")


@dataclass(frozen=True)
class Orphan:
    """A file that belongs to nothing, relative to the dataset, why, and its bytes."""

    path: str
    why: str
    size: int


def collect(dataset: Dataset, dry_run: bool = False) -> list[Orphan]:
    """Remove, or only list, orphaned files. Accepted episodes go to orphans/. Raises Busy,
    OSError, and DatasetError if more than LARGE of its episodes are orphans.
    """
    dataset.check_seal()
    recipe = dataset.recipe()
    with exclusive(dataset.root):
        found = sorted(_orphans(dataset, recipe), key=lambda orphan: orphan.path)
        if dry_run:
            return found
        whole = [dataset.root / orphan.path for orphan in found if orphan.why == WHOLE]
        held = len(whole) + sum(dataset.episode(slot).exists() for slot in recipe.slots())
        if len(whole) > LARGE * held:
            raise DatasetError(
                f"{dataset.root}: {len(whole)} of {held} whole episodes belong to no slot of"
                f" {dataset.manifest.name}, more than {100 * LARGE:g} %: restore the manifest that"
                " they were built with, or move them away"
            )
        sweep(dataset.root)  # of what is half-written only that whose process is gone
        for path in whole:
            _set_aside(dataset, path)
        gone = [dataset.root / orphan.path for orphan in found if orphan.why not in (HALF, WHOLE)]
        for path in gone:
            remove(path)
        delete(*gone)
    return found


def _orphans(dataset: Dataset, recipe: Recipe) -> Iterator[Orphan]:
    def orphan(path: Path, why: str) -> Orphan:
        return Orphan(path.relative_to(dataset.root).as_posix(), why, path.lstat().st_size)

    wanted = {f"{slot.path}.hdf5" for slot in recipe.slots()}
    held, whole = set[str](), set[str]()
    for path in dataset.episodes.rglob("*.hdf5"):
        name = path.relative_to(dataset.episodes).as_posix()
        if name in wanted:
            held.add(name)
        elif _EPISODE.fullmatch(path.stem):
            whole |= {name} if _is_whole(path) else set()
            yield orphan(path, WHOLE if name in whole else "episode of no slot")
    for stage in (dataset.root / "annotations").glob("*@*"):
        for path in stage.rglob("*.h5"):
            episode = path.relative_to(stage).with_suffix(".hdf5").as_posix()
            if episode not in held and _EPISODE.fullmatch(path.stem):
                yield orphan(path, "annotation of no episode")
    named = _list_named(dataset, recipe, held | whole)
    for path in dataset.bodies.glob("[0-9a-f][0-9a-f]/*.npz"):
        if named is not None and path.stem not in named and _ASSET.fullmatch(path.stem):
            yield orphan(path, "asset of no episode")
    for path in dataset.root.glob("**/.*.tmp"):
        yield orphan(path, HALF)


def _is_whole(path: Path) -> bool:
    try:
        with EpisodeFile(path) as file:
            return file.meta.failure is None and not file.damaged()
    except (EpisodeError, OSError):
        return False


def _set_aside(dataset: Dataset, path: Path) -> None:
    place = dataset.orphans / path.relative_to(dataset.root)
    place.parent.mkdir(parents=True, exist_ok=True)
    number = 1
    while place.exists():
        place, number = place.with_name(f"{path.stem}.{number}{path.suffix}"), number + 1
    path.rename(place)
    put(place)
    delete(path)


def _list_named(dataset: Dataset, recipe: Recipe, held: set[str]) -> set[str] | None:
    """The named assets; None if an episode is unreadable."""
    rows, names = dataset.rows(recipe, "assets"), dataset.ask(lambda index: index.assets())
    named = {names[int(number)] for text in rows.more["assets"] for number in text.split()}
    known = {f"{slot.path}.hdf5" for slot in rows.where(rows.accepted).slots}
    unknown = (dataset.episodes / name for name in held - known)
    for path in (*unknown, *dataset.failures.rglob("*.hdf5"), *dataset.orphans.rglob("*.hdf5")):
        try:
            with EpisodeFile(path) as file:
                named |= set(file.meta.drawing.assets.values())
        except (EpisodeError, OSError, KeyError, ValueError):
            return None
    return named
