"""What the lines of a benchmark hold, strictly read."""

import json
from typing import Annotated, Any

import numpy as np
from pydantic import Field, field_validator

from pipeline.data.clock import PHYSICS_HZ
from pipeline.data.recipe.model import Cell
from pipeline.data.setup import Setup
from pipeline.motion.models import motion_from_json
from pipeline.tasks import TASKS

from .case import Case
from .frozen import FrozenScene, StrictModel
from .manifests import SeedJob

_Name = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9._-]{0,63}$")]
_Hash = Annotated[str, Field(pattern=r"^[0-9a-f]{32}$")]


class FrozenCell(StrictModel):
    task: str
    embodiment: str
    level: int
    alpha: float
    domain: str

    def cell(self) -> Cell:
        return Cell(**self.model_dump())


class FrozenCase(StrictModel):
    seed: Annotated[int, Field(ge=0)]
    motion: dict[str, Any]
    meeting: Annotated[float, Field(ge=0, le=1e4)]
    frames: Annotated[int, Field(ge=0, le=1_000_000)]
    start: _Hash
    end: _Hash
    state: FrozenScene

    def case(self, cell: Cell, setup: Setup) -> Case:
        motion = motion_from_json(json.dumps(self.motion))
        target = TASKS[cell.task].target
        at = next((body.pose for body in self.state.bodies if body.name == target), (np.inf,) * 7)
        if np.abs(motion.pose(motion.duration) - at).max() > 1e-6:
            raise ValueError(f"the {target} is not where its motion ends")
        if abs(self.meeting - motion.duration) > 1e-6 or self.frames < self.meeting * setup.fps:
            raise ValueError("its meeting or frames contradict the duration of its motion")
        facts = (motion.to_json(), self.meeting, self.frames, self.start, self.end)
        return Case(SeedJob(cell, self.seed).spec, *facts, setup, self.state)


class BenchmarkHead(StrictModel):
    """The first line. Every cell has as many `scenes`; `parts` are tasks by the name of a part."""

    benchmark: _Name
    schema_version: Annotated[int, Field(ge=1, le=1)] = 1
    physics_hz: Annotated[int, Field(ge=PHYSICS_HZ, le=PHYSICS_HZ)]
    setup: dict[str, Any]
    parts: dict[_Name, tuple[str, ...]]
    made_by: dict[str, Any]
    scenes: Annotated[int, Field(ge=1, le=100_000)]
    cells: Annotated[tuple[FrozenCell, ...], Field(min_length=1)]

    @field_validator("cells")
    @classmethod
    def _each_once(cls, cells: tuple[FrozenCell, ...]) -> tuple[FrozenCell, ...]:
        if len({each.cell() for each in cells}) < len(cells):
            raise ValueError("a cell is there twice")
        for each in cells:
            SeedJob(each.cell(), 0).spec  # noqa: B018 (its names are checked)
        return cells


class RecordedBenchmark(StrictModel):
    """A result's benchmark: `scenes` of `of` were tried, all in cells of `part` ("" for none)."""

    name: str
    sha256: str
    part: str
    scenes: int
    of: int

    @property
    def label(self) -> str:
        return f"{self.name} {self.sha256[:12]}"

    def __str__(self) -> str:
        part = f", part {self.part}" if self.part else ""
        whole = f"benchmark {self.name} (sha256 {self.sha256[:12]}){part}"
        return f"{whole}: {self.scenes} of {self.of} scenes"
