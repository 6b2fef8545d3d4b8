"""Files with the bytes of the index, and paired scenes."""

from collections import defaultdict
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from .dataset import Dataset, DatasetError
from .keys import file_hash
from .process.machine import usable_cores
from .recipe.model import Recipe, Slot
from .slots.files import find_slot

REMAKE = "remove it, if it is there, and run the build again to make its slot"
CHANGED = f"bytes differ from the index's sha256; {REMAKE}"


def check_bytes(dataset: Dataset, episode: Path) -> None:
    """Raise DatasetError for an episode file whose bytes the index does not name."""
    if not dataset.manifest.exists():
        return
    recipe, path = dataset.recipe(), dataset.episodes / episode
    slot = find_slot(recipe, episode.with_suffix("").as_posix())
    record = slot and dataset.record(recipe, slot)
    if record is None or not record.accepted:
        raise DatasetError(f"{path}: belongs to no finished slot")
    _read_each({path: record.sha256})


def named_slot(dataset: Dataset, recipe: Recipe, episode: str) -> Slot:
    """The slot of an episode's path, relative to anything. Raises DatasetError."""
    path = Path(episode.removesuffix(".hdf5"))
    if path.is_absolute() and path.is_relative_to(dataset.episodes.resolve()):
        path = path.relative_to(dataset.episodes.resolve())
    if slot := find_slot(recipe, path.as_posix().rpartition("episodes/")[2]):
        return slot
    first = next(recipe.slots()).path
    raise DatasetError(f"--episode {episode}: {dataset.root} has no such slot; write it as {first}")


def intact_episodes(dataset: Dataset, recipe: Recipe) -> list[Path]:
    """The episode files of the recipe's slots, each read. Raises DatasetError for a missing or
    changed one.
    """
    if missing := dataset.missing(recipe):
        many = "1 episode is" if len(missing) == 1 else f"{len(missing)} episodes are"
        what = f"{many} missing that the index calls finished, first {missing[0]}"
        raise DatasetError(f"{what}; rerun the build command of this dataset")
    rows = dataset.present(recipe, "sha256")
    rows = rows.where(rows.accepted)
    paths = [dataset.episode(slot) for slot in rows.slots]
    hashes = [sha256.hex() for sha256 in rows.more["sha256"]]
    return _read_each(dict(zip(paths, hashes, strict=True)))


def _read_each(expected: Mapping[Path, str]) -> list[Path]:
    """The files whose hashes are expected. Raises DatasetError for a missing or changed one."""
    with ThreadPoolExecutor(usable_cores()) as threads:
        try:
            hashes = list(threads.map(file_hash, expected))
        except OSError as error:
            raise DatasetError(
                f"{error.filename}: cannot be read ({error.strerror}); {REMAKE}"
            ) from error
    pairs = zip(expected.items(), hashes, strict=True)
    if damaged := [path for (path, sha256), found in pairs if found != sha256]:
        others = f" and {len(damaged) - 1} others" if len(damaged) > 1 else ""
        raise DatasetError(f"{damaged[0]}{others}: {CHANGED}")
    return [*expected]


def kept_failures(dataset: Dataset, recipe: Recipe) -> Iterator[tuple[Slot, Path, str]]:
    """Kept failures in the recipe's order, with file and sha256."""
    rows = dataset.rows(recipe)
    of, found = dataset.ask(lambda index: index.attempts(rows, "attempt", "kept"))
    for row, (attempt, kept) in zip(of.tolist(), found, strict=True):
        if kept:
            yield rows.slots[row], dataset.failure(rows.slots[row], attempt), kept


def intact_failures(dataset: Dataset, recipe: Recipe) -> list[Path]:
    """The kept failures, each read. Raises DatasetError for a missing or changed one."""
    return _read_each({path: sha256 for _, path, sha256 in kept_failures(dataset, recipe)})


def pairs_in(dataset: Dataset, recipe: Recipe) -> dict[str, int] | None:
    """The pairs of a dataset by its index; None if its recipe pairs no cells."""
    if not recipe.paired:
        return None
    rows = dataset.present(recipe)
    rows = rows.where(rows.variants == 0)
    of, tried = dataset.ask(lambda index: index.attempts(rows, "seed"))
    seeds: dict[Slot, int | None] = dict.fromkeys(rows.slots)
    for row, (seed,) in zip(of.tolist(), tried, strict=True):
        # the last one is the accepted one
        seeds[rows.slots[row]] = seed if rows.accepted[row] else None
    return count_pairs(recipe, seeds)


def count_pairs(recipe: Recipe, seeds: Mapping[Slot, int | None]) -> dict[str, int]:
    """How many scenes paired cells share, how many are `finished` in every cell, and accepted
    with equal seeds (`complete`). A seed is None if given up.
    """
    groups, arms = defaultdict[tuple[str, int], list[Slot]](list), max(len(recipe.arms), 1)
    for slot in recipe.physical_slots():
        groups[slot.cell.scenes(recipe.paired), slot.index // arms].append(slot)
    shared = [slots for slots in groups.values() if len(slots) > 1]
    finished = [{seeds[s] for s in slots} for slots in shared if seeds.keys() >= {*slots}]
    complete = sum(len(found) == 1 and None not in found for found in finished)
    return {"scenes": len(shared), "finished": len(finished), "complete": complete}
