"""Whether the directory holds what the recipe names and nothing else: ledger entries, strays, attempts.parquet, provenance.json."""

import json
from collections.abc import Iterator, Mapping
from itertools import product
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.data.dataset import REMAKE, Dataset
from pipeline.data.episode.file import EpisodeFile
from pipeline.data.keys import file_hash
from pipeline.data.ledger.columns import distinct
from pipeline.data.ledger.files import Group, group_of
from pipeline.data.ledger.lookup import Lookup
from pipeline.data.ledger.records import SlotRecord
from pipeline.data.ledger.table import PLACE, place_of
from pipeline.data.parsing import parse_json
from pipeline.data.reading import check_regular, read_regular
from pipeline.data.recipe.model import Recipe, Slot
from pipeline.data.sealed import is_unchanged
from pipeline.run.verify.tally import FAULTS, Finding, line, observe

AGAIN = "run the build again"
PASSING = (".tmp", ".running")  # files that come and go while a build runs


def damaged_groups(dataset: Dataset, recipe: Recipe) -> dict[Group, str]:
    """Tasks and robots whose file of the ledger cannot be read, and why."""
    found = dict[Group, str]()
    for group in product(recipe.tasks, recipe.embodiments):
        try:
            dataset.ledger.read_rows(group)
        except FAULTS as error:
            found[group] = line(error)
    return found


def check_ledger(dataset: Dataset, recipe: Recipe, damaged: Mapping[Group, str]) -> Iterator[Finding]:
    """The files of the ledger can be read and name each slot once, and every line of its journal can be read.

    `damaged` is what `damaged_groups` found.
    """
    ledger = dataset.ledger
    for group in product(recipe.tasks, recipe.embodiments):
        name = ledger.file(group).relative_to(dataset.root).as_posix()
        if group in damaged:
            said = f"{name}: cannot be read ({damaged[group]}); {AGAIN}, which restores it from the episodes"
            yield Finding("ledger", said)
            continue
        rows = ledger.read_rows(group, PLACE)
        twice = len(rows) - len(distinct(rows))
        yield observe("ledger", not twice, f"{name}: names {twice} slots twice; {AGAIN}")
    for problem in ledger.journal().problems:
        yield Finding("ledger", f"ledger/{problem}; {AGAIN}")


def check_entry(dataset: Dataset, recipe: Recipe, slot: Slot, ledger: Lookup) -> tuple[SlotRecord | None, list[Finding]]:
    """The ledger entry of a slot, where it can be read, and what is wrong with it."""
    file, episode = (p.relative_to(dataset.root) for p in (dataset.ledger.file(group_of(slot)), dataset.episode(slot)))
    name = f"{file.as_posix()}: {slot.path}"
    try:
        record = ledger.find(slot.path)
        if record is None:
            raise ValueError("it is gone")
    except FAULTS as error:
        return None, [Finding("ledger", f"{name}: cannot be read ({line(error)}); {AGAIN}")]
    place = place_of(slot)[:-1]
    wanted = [(*place, number, recipe.spec(slot, number).seed) for number in range(len(record.attempts))]
    rows = [tuple(row.get(column) for column in (*PLACE[:-1], "attempt", "seed")) for row in record.attempts]
    right = rows == wanted and bool(rows or slot.variant)
    remove = episode if record.accepted else file
    said = f"{name}: its attempts are not those of the recipe; undo any edit of manifest.yaml, else remove {remove} and {AGAIN}"
    findings = [observe("ledger", right, said)]
    if not record.accepted:
        stray = dataset.episode(slot).exists()
        findings.append(observe("ledger", not stray, f"{name}: gave the slot up, and there is an episode; remove {episode}"))
    return record, findings


def check_strays(dataset: Dataset, recipe: Recipe) -> Iterator[Finding]:
    """Files below episodes/, failures/ and ledger/ that belong to no slot of the recipe."""
    slots, ledger = list(recipe.slots()), dataset.ledger
    entries = {ledger.file(group) for group in product(recipe.tasks, recipe.embodiments)} | set(ledger.journal().segments)
    for folder, known in (
        (dataset.episodes, {dataset.episode(slot) for slot in slots}),
        (ledger.root, entries),
        (dataset.failures, {path for path, _ in dataset.kept_failures(recipe)}),
    ):
        for path in sorted(folder.rglob("*")):
            if path in known or path.suffix in PASSING or (path.is_dir() and not path.is_symlink()):
                continue
            yield Finding("strays", f"{path.relative_to(dataset.root)}: belongs to no slot of the recipe; remove it")
    yield Finding("strays")


def check_failures(dataset: Dataset, recipe: Recipe) -> Iterator[Finding]:
    """Check that stored failed attempts have the bytes that were written, name their failure, and are in no episode's place."""
    for path, row in dataset.kept_failures(recipe):
        name = path.relative_to(dataset.root).as_posix()
        try:
            if file_hash(path) != row["kept"]:
                raise ValueError("bytes differ from the ledger's sha256")
            with EpisodeFile(path) as file:
                spec, why = file.read().spec, file.meta.failure
        except FAULTS as error:
            yield Finding("failures", f"{name}: {line(error).removeprefix(f'{path}: ')}; {REMAKE}")
            continue
        said = None if why is None else (spec.seed, why.attempt, why.stage, why.reason, list(why.conditions))
        wanted = (row["seed"], row["attempt"], row["stage"], row["reason"], row["conditions"])
        yield observe("failures", said == wanted, f"{name}: names the failure {said}, the ledger {wanted}")


def check_attempts(dataset: Dataset, recipe: Recipe, finished: bool) -> Iterator[Finding]:
    """attempts.parquet has the rows of the ledger; of a build that was killed, it may lack some."""
    name = dataset.attempts.name
    if not dataset.attempts.exists():
        yield observe("attempts", not finished, f"{name}: is missing; {AGAIN}")
        return
    wanted = dataset.entries(recipe, ("attempts",)).attempts()
    try:
        check_regular(dataset.attempts)
        with pq.ParquetFile(dataset.attempts) as file:
            rows = file.read()
    except (*FAULTS, pa.ArrowException) as error:
        yield Finding("attempts", f"{name}: cannot be read ({line(error)}); {AGAIN}")
        return
    right = rows.equals(wanted) or (not finished and _texts(rows) <= _texts(wanted))
    yield observe("attempts", right, f"{name}: has {len(rows)} rows that are not the {len(wanted)} of the ledger; {AGAIN}")


def _texts(table: pa.Table) -> set[str]:
    return {json.dumps(row, sort_keys=True) for row in table.to_pylist()}


def check_provenance(dataset: Dataset, finished: bool) -> Iterator[Finding]:
    """Check that provenance.json names the code and packages that made the dataset."""
    path: Path = dataset.provenance
    if not path.exists():
        yield observe("provenance", not finished, f"{path.name}: is missing; {AGAIN}")
        return
    try:
        values = parse_json(read_regular(path))
        complete = {"code_version", "packages", "renderer"} <= set(values)
    except FAULTS as error:
        yield Finding("provenance", f"{path.name}: cannot be read ({line(error)}); {AGAIN}")
        return
    yield observe("provenance", complete, f"{path.name}: does not name what made the dataset; {AGAIN}")
    yield observe("provenance", is_unchanged(values), f"{path.name}: is not what was written; {AGAIN}")
