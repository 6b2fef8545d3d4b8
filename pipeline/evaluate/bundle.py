"""A result that others can check: rows, scenes, commands, and OUT/bundle.json."""

import gzip
import hashlib
import json
from collections.abc import Iterable, Sequence
from io import BytesIO
from pathlib import Path, PurePath
from typing import Any

import numpy as np
from pydantic import Field, ValidationError, model_validator

from pipeline.data.atomic import write_atomic
from pipeline.data.errors import DominoError
from pipeline.data.reading import read_regular
from pipeline.data.recipe.model import Cell
from pipeline.data.setup import Setup
from pipeline.poses import Floats

from .episode import CONDITIONS, EpisodeJob, play
from .lines import line_of
from .scenes.benchmark_rows import RecordedBenchmark
from .scenes.case import Case
from .scenes.frozen import StrictModel
from .scoring.results import TIMES
from .scoring.summary import Row

BUNDLE, ACTIONS = "bundle.json", "actions"

LONGEST = 1 << 26  # bytes of an episode's commands, and physics steps that one of them may wait


class BundleError(DominoError): ...


class RecordedResult(StrictModel):
    """One evaluation of a bundle. `options` are those of the keys of its rows, `rows` and `scenes`
    hashes of its rows and of its cases. `made_by` names packages, Python and processor."""

    code: str
    policy: str
    probe: str
    clock: str
    options: list[Any]
    seed: int = Field(ge=0)
    apart: bool
    episodes: int = Field(ge=1, le=100_000)
    cells: tuple[dict[str, Any], ...]
    scenes: str
    rows: str
    made_by: dict[str, Any]
    benchmark: RecordedBenchmark | None = None

    @model_validator(mode="after")
    def _readable(self) -> "RecordedResult":
        if len(self.options) < 3:
            raise ValueError("options are missing")
        self.read_setup()
        for cell in self.read_cells():
            for name in (cell.task, cell.embodiment, cell.domain):
                if PurePath(name).name != name:  # it becomes part of a path
                    raise ValueError(f"{name!r} is no name")
        return self

    @property
    def identity(self) -> tuple[Any, ...]:
        return self.code, self.policy, self.clock, self.options, self.seed, self.cells

    def owns(self, key: Sequence[Any]) -> bool:
        """Whether a row of this key is of this policy, clock and options."""
        code, policy, clock, _, _, options = key
        return (code, policy, clock, options) == self.identity[:4]

    @property
    def conditions(self) -> bool:
        return CONDITIONS in self.options

    def read_cells(self) -> list[Cell]:
        return [Cell(**cell) for cell in self.cells]

    def read_setup(self) -> Setup:
        return Setup.model_validate(self.options[0])


def run_recorded(job: EpisodeJob) -> tuple[Row, bytes]:
    trial, row = play(job)
    commands = pack(trial.commanded)
    return row | {"actions": hashlib.sha256(commands).hexdigest()}, commands


def pack(commands: Floats) -> bytes:
    """Commands (T,1+A) as a compressed .npy: equal arrays are equal bytes."""
    file = BytesIO()
    np.save(file, commands, allow_pickle=False)
    return gzip.compress(file.getvalue(), mtime=0)


def unpack(data: bytes) -> Floats:
    """Return the commands (T,1+A) that `pack` wrote. Raises ValueError."""
    try:
        with gzip.open(BytesIO(data)) as file:
            plain = file.read(LONGEST + 1)
        if len(plain) > LONGEST:
            raise ValueError(f"has more than {LONGEST} bytes")
        commands = np.load(BytesIO(plain), allow_pickle=False)
    except (OSError, EOFError) as error:
        raise ValueError("is cut off or damaged") from error
    if commands.dtype != np.float64 or commands.ndim != 2 or commands.shape[1] < 2:
        raise ValueError("holds no commands")
    if not ((commands[:, 0] >= 0) & (commands[:, 0] <= LONGEST)).all():
        raise ValueError("holds the robot for no number of steps")
    return commands


def actions_file(out: Path, key: str) -> Path:
    return out / ACTIONS / f"{hashlib.sha256(key.encode()).hexdigest()[:24]}.npy.gz"


def hash_rows(rows: Iterable[Row]) -> str:
    """Hash rows whatever their order, without their wall times."""
    lines = sorted(json.dumps({**row, TIMES: None}, sort_keys=True) for row in rows)
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


def hash_scenes(cases: Iterable[Case]) -> str:
    lines = sorted(f"{case.spec.to_json()} {case.digest} {case.setup.label}" for case in cases)
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


def read_bundle(out: Path) -> list[RecordedResult]:
    """Results of OUT/bundle.json, [] without one. Raises BundleError, OSError."""
    path = out / BUNDLE
    if not path.exists():
        return []
    try:
        values = json.loads(read_regular(path))
        results = [RecordedResult.model_validate_json(json.dumps(value)) for value in values]
    except (ValueError, TypeError, ValidationError) as error:
        raise BundleError(f"{path}: is no bundle of results ({line_of(error)})") from error
    return results


def note_result(out: Path, result: RecordedResult) -> None:
    others = [known for known in read_bundle(out) if known.identity != result.identity]
    entries = [each.model_dump(mode="json") for each in (*others, result)]
    write_atomic(out / BUNDLE, (json.dumps(entries, indent=1) + "\n").encode())
