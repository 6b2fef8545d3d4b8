"""Whether the directory holds what the recipe names and nothing else: ledger entries, strays, attempts.parquet, provenance.json."""

import json
from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.data.dataset import Dataset
from pipeline.data.episode import EpisodeFile
from pipeline.data.keys import file_hash
from pipeline.data.ledger import ATTEMPTS, SlotRecord
from pipeline.data.reading import check_regular, parse_json, read_regular
from pipeline.data.recipe import Recipe, Slot
from pipeline.run.verify.tally import FAULTS, Finding, line, seen

AGAIN = "run the build again"
PASSING = (".tmp", ".running")
"""Files that come and go while a build runs."""


def check_ledger(dataset: Dataset, recipe: Recipe, slot: Slot) -> tuple[SlotRecord | None, list[Finding]]:
    """The ledger entry of a slot, where it is there and can be read, and what is wrong with it."""
    path = dataset.ledger(slot)
    name = path.relative_to(dataset.root).as_posix()
    if not path.exists():
        stray = dataset.episode(slot).exists()
        said = f"{dataset.episode(slot).relative_to(dataset.root)}: has no ledger entry; {AGAIN}"
        return None, [Finding("files", said)] if stray else []
    try:
        record = SlotRecord.from_json(read_regular(path))
    except FAULTS as error:
        return None, [Finding("ledger", f"{name}: cannot be read ({line(error)}); {AGAIN}")]
    cell = slot.cell
    wanted = [
        (cell.task, cell.embodiment, cell.level, cell.alpha, cell.domain, slot.index, number, recipe.spec(slot, number).seed)
        for number in range(len(record.attempts))
    ]
    columns = ("task", "embodiment", "level", "alpha", "domain", "slot", "attempt", "seed")
    rows = [tuple(row.get(column) for column in columns) for row in record.attempts]
    right = rows == wanted and bool(rows or slot.variant)
    findings = [seen("ledger", right, f"{name}: its attempts are not those of the recipe; delete it and {AGAIN}")]
    if not record.accepted:
        stray = dataset.episode(slot).exists()
        findings.append(seen("ledger", not stray, f"{name}: gave the slot up, and there is an episode; delete both and {AGAIN}"))
    return record, findings


def check_strays(dataset: Dataset, recipe: Recipe) -> Iterator[Finding]:
    """Files below episodes/, failures/ and ledger/ that belong to no slot of the recipe."""
    slots = list(recipe.slots())
    for folder, known in (
        (dataset.episodes, {dataset.episode(slot) for slot in slots}),
        (dataset.root / "ledger", {dataset.ledger(slot) for slot in slots}),
        (dataset.failures, {path for path, _ in dataset.kept_failures(recipe)}),
    ):
        for path in sorted(folder.rglob("*")):
            if path in known or path.suffix in PASSING or (path.is_dir() and not path.is_symlink()):
                continue
            yield Finding("strays", f"{path.relative_to(dataset.root)}: belongs to no slot of the recipe; remove it")
    yield Finding("strays")


def check_failures(dataset: Dataset, recipe: Recipe) -> Iterator[Finding]:
    """Failed attempts that are kept are the files that were written, say why they failed, and are in no place of an episode."""
    for path, row in dataset.kept_failures(recipe):
        name = path.relative_to(dataset.root).as_posix()
        try:
            if file_hash(path) != row["kept"]:
                raise ValueError("bytes differ from the ledger's sha256")
            with EpisodeFile(path) as file:
                spec, why = file.read().spec, file.meta.failure
        except FAULTS as error:
            yield Finding("failures", f"{name}: {line(error).removeprefix(f'{path}: ')}; delete its ledger entry and {AGAIN}")
            continue
        said = None if why is None else (spec.seed, why.attempt, why.stage, why.reason, list(why.conditions))
        wanted = (row["seed"], row["attempt"], row["stage"], row["reason"], row["conditions"])
        yield seen("failures", said == wanted, f"{name}: says that it failed as {said}, the ledger {wanted}")


def check_attempts(dataset: Dataset, recipe: Recipe, finished: bool) -> Iterator[Finding]:
    """attempts.parquet has the rows of the ledger; of a build that was killed, it may lack some."""
    name = dataset.attempts.name
    if not dataset.attempts.exists():
        yield seen("attempts", not finished, f"{name}: is missing; {AGAIN}")
        return
    try:
        check_regular(dataset.attempts)
        rows = pq.read_table(dataset.attempts, schema=ATTEMPTS).to_pylist()
        records = [record for slot in recipe.slots() if (record := dataset.record(slot)) is not None]
        ledger = [row for record in records for row in record.attempts]
        wanted = pa.Table.from_pylist(ledger, schema=ATTEMPTS).to_pylist()
    except (*FAULTS, pa.ArrowException) as error:
        yield Finding("attempts", f"{name}: cannot be read ({line(error)}); {AGAIN}")
        return
    texts = [json.dumps(row, sort_keys=True) for row in wanted]
    given = [json.dumps(row, sort_keys=True) for row in rows]
    right = given == texts if finished else set(given) <= set(texts)
    yield seen("attempts", right, f"{name}: has {len(rows)} rows that are not the {len(wanted)} of the ledger; {AGAIN}")


def check_provenance(dataset: Dataset, finished: bool) -> Iterator[Finding]:
    """provenance.json says what made the dataset."""
    path: Path = dataset.provenance
    if not path.exists():
        yield seen("provenance", not finished, f"{path.name}: is missing; {AGAIN}")
        return
    try:
        values = parse_json(read_regular(path))
        complete = {"code_version", "packages", "renderer"} <= set(values)
    except FAULTS as error:
        yield Finding("provenance", f"{path.name}: cannot be read ({line(error)}); {AGAIN}")
        return
    yield seen("provenance", complete, f"{path.name}: does not say what made the dataset; {AGAIN}")
