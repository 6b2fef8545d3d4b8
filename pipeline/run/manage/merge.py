"""`domino-data merge A B --out C`."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.annotate.overlays import annotation_sheet
from pipeline.data.atomic import exclusive, file_state, link, write_atomic
from pipeline.data.dataset import Dataset, DatasetError, check_apart
from pipeline.data.intact import CHANGED
from pipeline.data.keys import is_intact, seal
from pipeline.data.recipe.growth import differences, left_out
from pipeline.data.recipe.model import Recipe, Slot
from pipeline.data.slots.records import SlotRecord, pack_keys
from pipeline.data.slots.reread import IndexWriter
from pipeline.report.page import refresh

SHARED = (("physics", "core"), ("render", "renderer"), ("render", "shaders"))
"""Parts of the keys that are the same for every slot of one version of the code."""


@dataclass(frozen=True)
class Merged:
    """Slots wanted, accepted and given up, and counts by dataset."""

    slots: int
    accepted: int
    given_up: int
    taken: tuple[int, ...]


def merge(sources: Sequence[Dataset], out: Dataset) -> Merged:
    """Join datasets into `out`, or resume a merge. Files become hard links where possible;
    exports are not merged. Raises DatasetError for recipes, slots, code or bytes that differ;
    Busy; OSError.
    """
    if len(sources) < 2:
        raise DatasetError("merge joins two datasets or more: name another one")
    seen = set[Path]()
    for source in sources:
        here = source.root.resolve()
        if here in seen:
            raise DatasetError(f"{source.root} is named twice: name each dataset once")
        seen.add(here)
        check_apart(out.root, source.root)
        source.check_seal()
    recipes = [source.recipe() for source in sources]
    recipe = _join_recipes(sources, recipes)
    held = [dict(source.records(own)) for source, own in zip(sources, recipes, strict=True)]
    _check_keys(sources, held)
    out.create(recipe)
    taken = Counter[int]()
    with exclusive(out.root):
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
                    link(path, out.assets / path.relative_to(source.assets))
            _take_annotations(source, out)
        out.write_attempts(recipe)
        made = [source.made_by() for source in sources]
        same = all(each == made[0] for each in made)
        write_atomic(out.provenance, seal(made[0] if same else made[0] | {"merged_from": made}))
        refresh(out, annotation_sheet)
        accepted = out.present(recipe).accepted
    wanted = sum(recipe.counts().values()) * recipe.variants
    each = tuple(taken[number] for number in range(len(sources)))
    return Merged(wanted, int(accepted.sum()), int((~accepted).sum()), each)


def _join_recipes(sources: Sequence[Dataset], recipes: Sequence[Recipe]) -> Recipe:
    first = recipes[0]
    for source, other in zip(sources[1:], recipes[1:], strict=True):
        if changed := differences(first, other, "{} is {} in the first, {} in the second"):
            raise DatasetError(
                f"{sources[0].root} and {source.root} are of different recipes:"
                f" {'; '.join(changed)}"
            )
    if all(other == first for other in recipes):
        return first
    update: dict[str, Any] = {
        key: tuple(dict.fromkeys(value for recipe in recipes for value in getattr(recipe, key)))
        for key in ("tasks", "embodiments", "levels", "domains", "alpha")
    }
    update["objects"] = {key: names for recipe in recipes for key, names in recipe.objects.items()}
    update["episodes"] = _most(recipes)
    update["variants"] = max(recipe.variants for recipe in recipes)
    joined = first.model_copy(update=update)
    for source, recipe in zip(sources, recipes, strict=True):
        if more := left_out(recipe, joined):
            raise DatasetError(f"{source.root} wants what no joined recipe can: {'; '.join(more)}")
    return joined


def _most(recipes: Sequence[Recipe]) -> Any:
    numbers, counts = list[int](), Counter[str]()
    for recipe in recipes:
        of = recipe.episodes
        numbers += [of] if isinstance(of, int) else []
        counts |= Counter(dict.fromkeys(recipe.domains, of) if isinstance(of, int) else dict(of))
    return max(numbers) if len(numbers) == len(recipes) else dict(counts)


def _check_keys(sources: Sequence[Dataset], held: Sequence[dict[Slot, SlotRecord]]) -> None:
    """Raise DatasetError for slots or code versions that differ."""
    first: dict[object, tuple[str, Dataset]] = {}
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
            seen, where = first.setdefault((slot.cell, slot.variant), (text, source))
            if seen != text:
                raise DatasetError(
                    f"{where.root} and {source.root} have other keys in {slot.cell.path}:"
                    " `domino-data diff` shows which; build one of them again first"
                )
            seen, where = first.setdefault(slot, (record.sha256, source))
            if seen != record.sha256:
                raise DatasetError(
                    f"{where.root} and {source.root} both have {slot.path}, with other bytes:"
                    " verify both"
                )


def _take(source: Dataset, out: Dataset, slot: Slot, record: SlotRecord) -> None:
    for row in record.attempts:
        if row.get("kept"):
            link(source.failure(slot, row["attempt"]), out.failure(slot, row["attempt"]))
    path, known = source.file(slot, record.accepted), (record.file.size, record.file.changed)
    if file_state(path) != known and not is_intact(path, record.sha256):
        raise DatasetError(f"{path}: {CHANGED}")
    link(path, out.file(slot, record.accepted))


def _take_annotations(source: Dataset, out: Dataset) -> None:
    for stage in sorted((source.root / "annotations").glob("*@*")):
        for path in sorted(stage.rglob("*")):
            name = path.relative_to(stage)
            episode = out.episodes / name.with_suffix(".hdf5")
            wanted = name.name == "stage.json" or (path.suffix == ".h5" and episode.exists())
            if path.is_file() and wanted:
                link(path, out.root / "annotations" / stage.name / name)
