"""The scenes of an evaluation: the first seeds from 100000 * (1 + s) that the expert solves, one
JSON file a cell. The size of batches does not depend on the workers."""

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

from pipeline.data.atomic import write_atomic
from pipeline.data.errors import DominoError
from pipeline.data.parsing import parse_json
from pipeline.data.reading import read_regular
from pipeline.data.recipe.model import Cell
from pipeline.data.setup import DEFAULT, Setup
from pipeline.data.spec import EpisodeSpec
from pipeline.evaluate.lines import line_of, line_of_text
from pipeline.stages.failure import Failure

from .case import Case, admit

SCHEMA = 4  # manifests of schema 3, without `sha256`, are read as well

MOST_SEEDS = 10_000_000

Runner = Callable[[Callable[[Any], Any], Sequence[Any]], Iterator[tuple[Any, Any]]]
"""Does the jobs and yields (job, result) in any order. Workers import the work by its name."""


class ProtocolError(DominoError): ...


def first_seed(s: int) -> int:
    """The first seed of the scenes of evaluation `s`, as in the original."""
    return 100_000 * (1 + s)


def most_tries(episodes: int) -> int:
    return 3 * episodes + 20


@dataclass
class Manifest:
    """The seeds of one cell: `cases` admitted, `refused` seeds with the reason, both in order;
    `tried` seeds from `first`."""

    cell: Cell
    first: int
    setup: Setup = DEFAULT
    tried: int = 0
    cases: list[Case] = field(default_factory=list)
    refused: dict[int, str] = field(default_factory=dict)

    def to_json(self) -> bytes:
        cases = [case.to_dict() for case in self.cases]
        head = {
            "schema": SCHEMA,
            "cell": asdict(self.cell),
            "first": self.first,
            "setup": self.setup.given(),
            "tried": self.tried,
            "refused": {str(seed): reason for seed, reason in self.refused.items()},
            "sha256": _hash_of(cases),
        }
        lines = ",\n".join(map(json.dumps, cases))
        return f'{json.dumps(head)[:-1]}, "cases": [\n{lines}\n]}}\n'.encode()

    def next_batch(self, episodes: int) -> range:
        count = min(episodes - len(self.cases), most_tries(episodes) - self.tried)
        if count <= 0:
            solved = f"{len(self.cases)} of {self.tried} seeds, fewer than the {episodes} wanted"
            raise ProtocolError(f"{self.cell.path}: the expert solves {solved}: lower --episodes")
        return range(self.first + self.tried, self.first + self.tried + count)

    def extend(self, results: dict[int, Case | str]) -> None:
        for seed, result in sorted(results.items()):
            if isinstance(result, Case):
                self.cases.append(result)
            else:
                self.refused[seed] = result
        self.tried += len(results)

    @classmethod
    def from_json(cls, text: bytes) -> "Manifest":
        values = parse_json(text)
        schema = values.pop("schema", None) if isinstance(values, dict) else None
        if schema not in (3, SCHEMA):
            raise ValueError(f"its schema is not {SCHEMA}")
        if schema == SCHEMA and values.pop("sha256", None) != _hash_of(values.get("cases")):
            raise ValueError("its cases are not those that were written")
        try:
            cases = [Case.from_dict(case) for case in values.pop("cases")]
            refused = {int(seed): str(reason) for seed, reason in values.pop("refused").items()}
            setup, cell = Setup.model_validate(values.pop("setup")), Cell(**values.pop("cell"))
            manifest = cls(cell, setup=setup, cases=cases, refused=refused, **values)
        except (TypeError, KeyError, AttributeError, OverflowError) as error:
            raise ValueError(line_of(error)) from error
        manifest.check()
        return manifest

    def check(self) -> None:
        """Raise ValueError unless each seed was tried once, in order."""
        if not all(type(n) is int and n >= 0 for n in (self.first, self.tried)):
            raise ValueError("first and tried are no whole numbers")
        seeds = [case.spec.seed for case in self.cases]
        tried = range(self.first, self.first + min(self.tried, MOST_SEEDS))
        if sorted([*seeds, *self.refused]) != list(tried):
            raise ValueError("the seeds are not those that were tried")
        expected = [(SeedJob(self.cell, seed).spec, self.setup) for seed in sorted(seeds)]
        if [(case.spec, case.setup) for case in self.cases] != expected:
            raise ValueError("a case is not of this cell")


def _hash_of(cases: object) -> str:
    return hashlib.sha256(json.dumps(cases, sort_keys=True).encode()).hexdigest()


@dataclass(frozen=True)
class Manifests:
    """Manifests by cell, a directory for each physics. With `apart` every alpha has its own
    scenes."""

    root: Path
    seed: int = 0
    setup: Setup = DEFAULT
    apart: bool = False

    def path(self, cell: Cell) -> Path:
        scenes = f"seed{self.seed}{'-apart' if self.apart else ''}"
        return self.root / scenes / self.setup.label / f"{cell.path}.json"

    def first(self, cell: Cell) -> int:
        if not self.apart:
            return first_seed(self.seed)
        digest = hashlib.sha256(f"{self.seed}/{cell.alpha:g}".encode()).digest()
        return int.from_bytes(digest[:6], "little")

    def read(self, cell: Cell) -> Manifest:
        """An empty one if there is none yet. Raises ProtocolError."""
        path = self.path(cell)
        if not path.exists():
            return Manifest(cell, self.first(cell), self.setup.physics)
        try:
            manifest = Manifest.from_json(read_regular(path))
        except ValueError as error:
            what = f"{path}: is no manifest of seeds ({line_of_text(error)})"
            raise ProtocolError(f"{what}: delete it to draw them again") from error
        expected = (cell, self.first(cell), self.setup.physics)
        if (manifest.cell, manifest.first, manifest.setup) != expected:
            raise ProtocolError(f"{path}: is of another cell, seed or setup: delete it")
        return manifest

    def admitted(self, cells: Sequence[Cell], episodes: int, run: Runner) -> dict[Cell, list[Case]]:
        """The first cases of every cell; the expert finds missing ones. Raises ProtocolError."""
        manifests = {cell: self.read(cell) for cell in cells}
        while short := [m for m in manifests.values() if len(m.cases) < episodes]:
            batches = {m.cell: m.next_batch(episodes) for m in short}
            physics = self.setup.physics
            jobs = [SeedJob(cell, n, physics) for cell, batch in batches.items() for n in batch]
            results: dict[Cell, dict[int, Case | str]] = {cell: {} for cell in batches}
            for job, result in run(try_seed, jobs):
                results[job.cell][job.seed] = result
                if len(results[job.cell]) == len(batches[job.cell]):
                    manifests[job.cell].extend(results[job.cell])
                    write_atomic(self.path(job.cell), manifests[job.cell].to_json())
        return {cell: manifest.cases[:episodes] for cell, manifest in manifests.items()}


@dataclass(frozen=True)
class SeedJob:
    cell: Cell
    seed: int
    setup: Setup = DEFAULT

    @property
    def spec(self) -> EpisodeSpec:
        c = self.cell
        return EpisodeSpec(**vars(c), slot=0, seed=self.seed)


def try_seed(job: SeedJob) -> Case | str:
    try:
        return admit(job.spec, job.setup)
    except Failure as failure:
        return f"{failure.stage}: {failure.reason}"


def inline(work: Callable[[Any], Any], jobs: Sequence[Any]) -> Iterator[tuple[Any, Any]]:
    return ((job, work(job)) for job in jobs)


TRAINING = 10_000  # the `--seed` of the scenes that environments train on: evaluate on another one

TRIES = 30


class NoCase(DominoError): ...


class OtherCase(DominoError, ValueError): ...


remembered = lru_cache(maxsize=1024)(try_seed)


def case_of_seed(cell: Cell, seed: int, setup: Setup) -> Case:
    """The seed, else the next derived one. Raises NoCase after TRIES seeds."""
    case: Case | str = ""
    for number in range(TRIES):
        # 63 bits that no neighbour leads to
        later = hashlib.sha256(f"{seed}/{number}".encode()).digest()[:8]
        drawn = int.from_bytes(later, "little") >> 1 if number else seed
        case = remembered(SeedJob(cell, drawn, setup.calm))
        if isinstance(case, Case):
            return case
    what = f"{TRIES} scenes of {cell.task} drawn from seed {seed}"
    raise NoCase(f"the expert solves none of {what}; the last: {case}")


def check_case(case: object, cell: Cell, setup: Setup) -> None:
    """Raise OtherCase for a case of another cell or physics, or for no Case."""
    if not isinstance(case, Case):
        raise OtherCase(f"{type(case).__name__} is no case of an environment or a manifest")
    differ = [n for n, needed in asdict(cell).items() if getattr(case.spec, n) != needed]
    differ += ["setup"] if case.setup != setup.calm else []
    if differ:
        raise OtherCase(f"the case is not of the environment: they differ in {', '.join(differ)}")
