"""`domino-data merge A B --out C`: one dataset of the episodes of two."""

import os
import shutil
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.annotate.overlays import annotation_sheet
from pipeline.data.atomic import atomic_path, exclusive, write_atomic
from pipeline.data.dataset import Dataset, DatasetError
from pipeline.data.intact import CHANGED, is_intact
from pipeline.data.keys import seal
from pipeline.data.recipe.growth import differences, left_out
from pipeline.data.recipe.model import Recipe, Slot
from pipeline.data.slots.records import SlotRecord, pack_keys
from pipeline.data.slots.reread import IndexWriter
from pipeline.report.page import refresh

FEATURES = ("fps ", "camera ", "cameras ", "size ", "corrections ")
"""Keys of a recipe that decide which columns and images a LeRobot export has."""

EXPORTS = "; their LeRobot exports can be joined by `lerobot-edit-dataset` (docs/lerobot.md)"

SHARED = (("physics", "core"), ("render", "renderer"), ("render", "shaders"))
"""Parts of the keys that are the same for every slot of one version of the code."""


@dataclass(frozen=True)
class Merged:
    """Slots wanted, accepted and given up in the result, and how many came from each dataset."""

    slots: int
    accepted: int
    given_up: int
    taken: tuple[int, ...]


def merge(sources: Sequence[Dataset], out: Dataset) -> Merged:
    """Join datasets into `out`, or resume a merge. Files become hard links where possible; exports
    are not merged.

    The recipes may differ in what they choose; the result wants all of it. Raises DatasetError for
    other recipes, slots that differ, another version of the code, and changed bytes; Busy;
    OSError."""
    if len(sources) < 2:
        raise DatasetError("merge joins two datasets or more: name another one")
    for source in sources:
        here, there = source.root.resolve(), out.root.resolve()
        if here.is_relative_to(there) or there.is_relative_to(here):
            raise DatasetError(
                f"--out {out.root} is one of the datasets, within one or around it: name another"
                " directory"
            )
    for source in sources:
        source.check_seal()
    recipes = [source.recipe() for source in sources]
    recipe = _join_recipes(sources, recipes)
    held = [dict(source.records(own)) for source, own in zip(sources, recipes, strict=True)]
    _check_keys(sources, held)
    out.create(recipe)
    with exclusive(out.root):
        return _merge(sources, held, out, recipe)


def _merge(
    sources: Sequence[Dataset], held: Sequence[dict[Slot, SlotRecord]], out: Dataset, recipe: Recipe
) -> Merged:
    """As `merge`, of slots that fit together, into a directory that is the recipe's."""
    taken = [0] * len(sources)
    with IndexWriter(out, recipe) as writer:
        known = dict(out.records(recipe))
        for slot in recipe.slots():
            number = next((n for n, records in enumerate(held) if slot in records), None)
            if number is None:
                continue
            taken[number] += 1
            record = held[number][slot]
            if known.get(slot) != record:
                _take(sources[number], out, slot, record)
                writer.add(slot, record)
    for source in sources:
        for path in sorted(source.assets.rglob("*")):
            if path.is_file() and not path.name.endswith(".tmp"):
                _link(path, out.assets / path.relative_to(source.assets))
        _take_annotations(source, out)
    out.write_attempts(recipe)
    write_atomic(out.provenance, seal(_provenance(sources)))
    refresh(out, annotation_sheet)
    accepted, wanted = out.present(recipe).accepted, sum(recipe.counts().values()) * recipe.variants
    return Merged(wanted, int(accepted.sum()), int((~accepted).sum()), tuple(taken))


def _join_recipes(sources: Sequence[Dataset], recipes: Sequence[Recipe]) -> Recipe:
    """The recipe that wants the slots of all recipes."""
    first = recipes[0]
    for source, other in zip(sources[1:], recipes[1:], strict=True):
        if changed := differences(first, other):
            # of the same frames and cameras, LeRobot exports fit together nevertheless
            fit = not any(line.startswith(FEATURES) for line in changed)
            raise DatasetError(
                f"{sources[0].root} and {source.root} are of different recipes:"
                f" {'; '.join(changed)}{EXPORTS if fit else ''}"
            )
    if all(other == first for other in recipes):
        return first
    update: dict[str, Any] = {
        key: tuple(dict.fromkeys(value for recipe in recipes for value in getattr(recipe, key)))
        for key in ("tasks", "embodiments", "levels", "domains", "alpha")
    }
    update |= {
        "objects": {key: names for recipe in recipes for key, names in recipe.objects.items()}
    }
    update |= {"episodes": _most(recipes), "variants": max(recipe.variants for recipe in recipes)}
    joined = first.model_copy(update=update)
    for source, recipe in zip(sources, recipes, strict=True):
        if more := left_out(recipe, joined):
            raise DatasetError(f"{source.root} wants what no joined recipe can: {'; '.join(more)}")
    return joined


def _most(recipes: Sequence[Recipe]) -> Any:
    """The largest number of episodes; by domain if any recipe counts by domain."""
    values = [recipe.episodes for recipe in recipes]
    if all(isinstance(value, int) for value in values):
        return max(value for value in values if isinstance(value, int))
    counts: dict[str, int] = defaultdict(int)
    for recipe, value in zip(recipes, values, strict=True):
        for domain, count in (
            dict.fromkeys(recipe.domains, value) if isinstance(value, int) else value
        ).items():
            counts[domain] = max(counts[domain], count)
    return dict(counts)


def _check_keys(sources: Sequence[Dataset], held: Sequence[dict[Slot, SlotRecord]]) -> None:
    """Raise DatasetError for slots that the datasets have differently, or of another version of the
    code."""
    first: dict[tuple[str, str], tuple[str, Dataset]] = {}
    of_cell: dict[tuple[object, int], tuple[str, Dataset]] = {}
    for source, records in zip(sources, held, strict=True):
        for slot, record in records.items():
            for kind, part in SHARED:
                value = getattr(record.keys, kind).parts.get(part, "")
                seen, where = first.setdefault((kind, part), (value, source))
                if seen != value:
                    raise DatasetError(
                        f"{where.root} and {source.root} were made by different versions of the"
                        f" code ({kind}: {part}, at {slot.path}): build one of them again first"
                    )
            text = pack_keys(slot, record.keys)
            seen, where = of_cell.setdefault((slot.cell, slot.variant), (text, source))
            if seen != text:
                raise DatasetError(
                    f"{where.root} and {source.root} have other keys in {slot.cell.path}:"
                    " `domino-data diff` shows which; build one of them again first"
                )
    for slot, record in held[0].items():
        for source, records in zip(sources[1:], held[1:], strict=True):
            if slot in records and records[slot].sha256 != record.sha256:
                raise DatasetError(
                    f"{sources[0].root} and {source.root} both have {slot.path}, with other bytes:"
                    " verify both"
                )


def _take(source: Dataset, out: Dataset, slot: Slot, record: SlotRecord) -> None:
    """Link or copy the file of a slot, and the failed attempts that are kept of it."""
    for row in record.attempts:
        if row.get("kept"):
            _link(source.failure(slot, row["attempt"]), out.failure(slot, row["attempt"]))
    path = source.file(slot, record.accepted)
    if _state(path) != (record.file.size, record.file.changed) and not is_intact(
        path, record.sha256
    ):
        raise DatasetError(f"{path}: {CHANGED}")
    _link(path, out.file(slot, record.accepted))


def _take_annotations(source: Dataset, out: Dataset) -> None:
    """Take over annotations of episodes that the result has."""
    for stage in sorted((source.root / "annotations").glob("*@*")):
        there = out.root / "annotations" / stage.name
        for path in sorted(stage.rglob("*")):
            relative = path.relative_to(stage)
            episode = out.episodes / relative.with_suffix(".hdf5")
            if path.is_file() and (
                relative.name == "stage.json" or (path.suffix == ".h5" and episode.exists())
            ):
                _link(path, there / relative)


def _link(path: Path, to: Path) -> None:
    """Make `to` a hard link of `path`, or an atomic copy with its time; another file there is
    replaced."""
    if to.exists() and (os.path.samefile(path, to) or _state(path) == _state(to)):
        return
    with atomic_path(to) as temporary:
        temporary.unlink(missing_ok=True)
        try:
            os.link(path, temporary)
        except OSError:  # another file system, or one without hard links
            shutil.copy2(path, temporary)


def _state(path: Path) -> tuple[int, int]:
    """Size in bytes and time of change in ns of a file."""
    state = path.stat()
    return state.st_size, state.st_mtime_ns


def _provenance(sources: Sequence[Dataset]) -> dict[str, Any]:
    """What made the datasets: the same for all, or that of the first with all of them beside it."""
    made = [source.made_by() for source in sources]
    return made[0] if all(each == made[0] for each in made) else made[0] | {"merged_from": made}
