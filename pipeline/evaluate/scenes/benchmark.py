"""A benchmark: one file with the scenes of an evaluation as data, neither drawn nor admitted
again.

Text compressed with xz: a line of JSON about the whole, then a line for each scene, cell after
cell. Its hash is that of the text."""

import hashlib
import json
import lzma
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from pipeline.data.clock import PHYSICS_HZ
from pipeline.data.parsing import first_fault
from pipeline.data.reading import read_regular
from pipeline.data.recipe.file import shipped_folder
from pipeline.data.recipe.model import Cell, Recipe
from pipeline.data.setup import IMAGES, Setup
from pipeline.evaluate.lines import line_of_text
from pipeline.tasks import TASKS

from .benchmark_rows import BenchmarkHead, FrozenCase, FrozenCell, RecordedBenchmark
from .case import BenchmarkError, Case
from .frozen import freeze

FOLDER, SUFFIX = "benchmarks", ".jsonl.xz"

XZ = b"\xfd7zXZ\0"

LARGEST = 1 << 28


@dataclass(frozen=True)
class Benchmark:
    """What a file holds; `lines` of scenes are read when they are asked for."""

    head: BenchmarkHead
    sha256: str
    lines: Sequence[bytes]
    part: str = ""

    @property
    def label(self) -> str:
        return self.record(0).label

    @property
    def setup(self) -> Setup:
        return Setup.model_validate(self.head.setup)

    def choose(
        self, recipe: Recipe, keys: Collection[str], named: Sequence[str] = ()
    ) -> list[Cell]:
        """Cells whose `keys` are a recipe's. Raises BenchmarkError for none, or a missing task."""
        held, name = {cell.task for cell in self.head.cells}, self.head.benchmark
        if missing := [task for task in named if task in TASKS and task not in held]:
            whole = f"part {self.part} of {name}" if self.part else f"benchmark {name}"
            raise BenchmarkError(f"{missing[0]} is not in {whole}: {', '.join(sorted(held))}")
        found = [
            cell
            for cell in map(FrozenCell.cell, self.head.cells)
            if all(
                getattr(cell, key.removesuffix("s")) in getattr(recipe, key)
                for key in ("tasks", "embodiments", "levels", "alpha", "domains")
                if key in keys and (key != "alpha" or cell.level)
            )
        ]
        if not found:
            raise BenchmarkError(f"benchmark {name} has no scene of these options")
        return found

    def under(self, setup: Setup, keys: Collection[str]) -> Setup:
        """A setup with the benchmark's physics. Raises BenchmarkError if one of `keys` differs."""
        own = self.setup
        for key in ("fps", "rules", "contact", "layout", "camera", "drive"):
            if key in keys and getattr(setup, key) != getattr(own, key):
                differs = f"has {key} {getattr(own, key)}, not {getattr(setup, key)}"
                raise BenchmarkError(f"benchmark {self.head.benchmark} {differs}")
        others = (*IMAGES, "events")
        kept = {key: getattr(own, key) for key in Setup.model_fields if key not in others}
        return setup.override(kept)

    def record(self, scenes: int) -> RecordedBenchmark:
        head, whole = self.head, self.head.scenes * len(self.head.cells)
        return RecordedBenchmark(
            name=head.benchmark, sha256=self.sha256, part=self.part, scenes=scenes, of=whole
        )

    def only(self, part: str) -> "Benchmark":
        """The cells of a part. Raises BenchmarkError for another name."""
        head, scenes = self.head, self.head.scenes
        if part not in head.parts:
            there = f"no part {part!r}, but {', '.join(head.parts) or 'none'}"
            raise BenchmarkError(f"benchmark {head.benchmark} has {there}")
        kept = [n for n, cell in enumerate(head.cells) if cell.task in head.parts[part]]
        lines = [line for n in kept for line in self.lines[n * scenes : (n + 1) * scenes]]
        cells = tuple(head.cells[n] for n in kept)
        return Benchmark(head.model_copy(update={"cells": cells}), self.sha256, lines, part)

    def count_scenes(self, wanted: int | None) -> int:
        """Scenes of each cell, all by default. Raises BenchmarkError for more than there are."""
        name, held = self.head.benchmark, self.head.scenes
        if wanted is not None and wanted > held:
            raise BenchmarkError(f"benchmark {name} has {held} scenes of each cell, not {wanted}")
        return wanted or held

    def cases(self, cells: Sequence[Cell], scenes: int) -> dict[Cell, list[Case]]:
        """The first scenes of these cells. Raises BenchmarkError."""
        self.count_scenes(scenes)
        places = {each.cell(): number for number, each in enumerate(self.head.cells)}
        if missing := [cell.path for cell in cells if cell not in places]:
            raise BenchmarkError(f"benchmark {self.head.benchmark} has no cell {missing[0]}")
        return {cell: self._cases(cell, places[cell] * self.head.scenes, scenes) for cell in cells}

    def _cases(self, cell: Cell, first: int, scenes: int) -> list[Case]:
        out, setup = list[Case](), self.setup.calm
        for number, line in enumerate(self.lines[first : first + scenes], first + 2):
            try:
                out.append(FrozenCase.model_validate_json(line).case(cell, setup))
            except (ValueError, TypeError, KeyError, AttributeError) as error:
                wrong = f"line {number} is no scene of {cell.path} ({_reason(error)})"
                raise BenchmarkError(f"benchmark {self.head.benchmark}: {wrong}") from error
        if len({case.spec.seed for case in out}) < len(out):
            raise BenchmarkError(f"benchmark {self.head.benchmark} has a scene twice: {cell.path}")
        return out


def _reason(error: Exception) -> str:
    return line_of_text(first_fault(error) if isinstance(error, ValidationError) else error)


def pack(
    name: str,
    cases: Mapping[Cell, Sequence[Case]],
    setup: Setup,
    parts: Mapping[str, Sequence[str]],
    made_by: Mapping[str, Any],
) -> bytes:
    """The file of a benchmark. Raises BenchmarkError."""
    scenes = max(map(len, cases.values()))
    head = {
        "benchmark": name,
        "schema_version": 1,
        "physics_hz": PHYSICS_HZ,
        "setup": setup.calm.given(),
        "parts": {part: [*tasks] for part, tasks in parts.items()},
        "made_by": dict(made_by),
        "scenes": scenes,
        "cells": [asdict(cell) for cell in cases],
    }
    lines = [_line(head), *(_line(_frozen(case)) for each in cases.values() for case in each)]
    packed = lzma.compress(b"\n".join(lines) + b"\n", preset=9)
    unpack_benchmark(packed, name).cases([*cases], scenes)
    return packed


def _line(values: Mapping[str, Any]) -> bytes:
    return json.dumps(values, separators=(",", ":"), allow_nan=False).encode()


def _frozen(case: Case) -> dict[str, Any]:
    values = case.to_dict()
    try:
        state = case.state or freeze(case.scene())
    except ValueError as error:
        raise BenchmarkError(f"{case.spec.task}, seed {case.spec.seed}: {error}") from error
    kept = {name: values[name] for name in ("motion", "meeting", "frames", "start", "end")}
    frozen = state.model_dump(mode="json", exclude_defaults=True)
    return {"seed": case.spec.seed, **kept, "state": frozen}


def unpack_benchmark(data: bytes, source: str) -> Benchmark:
    try:
        text = _decompress(data)
        first, *lines = text.removesuffix(b"\n").split(b"\n")
        head = BenchmarkHead.model_validate_json(first)
        Setup.model_validate(head.setup)
        for each in head.cells:
            if each.task not in TASKS:
                raise ValueError(f"the task {each.task} is not installed")
        if head.scenes * len(head.cells) != len(lines):
            raise ValueError(f"it has {len(lines)} scenes, not as many as it says")
    except (ValueError, TypeError, lzma.LZMAError, EOFError, MemoryError) as error:
        raise BenchmarkError(f"{source}: is no benchmark ({_reason(error)})") from error
    return Benchmark(head, hashlib.sha256(text).hexdigest(), lines)


def _decompress(data: bytes) -> bytes:
    if not data.startswith(XZ):
        raise ValueError("it is not compressed with xz")
    reader = lzma.LZMADecompressor(lzma.FORMAT_XZ, memlimit=LARGEST)
    text = reader.decompress(data, LARGEST + 1)
    if len(text) > LARGEST:
        raise ValueError(f"it has more than {LARGEST} bytes")
    if not reader.eof or reader.unused_data:
        raise ValueError("it is cut off, or has more after its end")
    return text


def shipped_benchmarks() -> dict[str, Path]:
    files = sorted((shipped_folder() / FOLDER).glob(f"*{SUFFIX}"))
    return {path.name.removesuffix(SUFFIX): path for path in files}


def read_benchmark(given: str) -> Benchmark:
    """A benchmark by file or name, NAME:PART for a part. Raises BenchmarkError, OSError."""
    path, part = Path(given), ""
    if not path.exists():
        name, _, part = given.partition(":")
        path = shipped_benchmarks().get(name, Path(name))
        if not path.exists():
            known = ", ".join(shipped_benchmarks()) or "none"
            raise BenchmarkError(f"no benchmark {name!r}: there are {known}, or name a file")
    found = unpack_benchmark(read_regular(path, LARGEST), str(path))
    return found.only(part) if part else found


@lru_cache(maxsize=16)
def frozen_scenes(given: str, cell: Cell) -> tuple[Case, ...]:
    benchmark = read_benchmark(given)
    return tuple(benchmark.cases([cell], benchmark.head.scenes)[cell])
