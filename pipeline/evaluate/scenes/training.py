"""The scenes of environments: those that the expert solves, remembered."""

import hashlib
from contextlib import ExitStack
from dataclasses import fields
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory

from pipeline.data.errors import DominoError
from pipeline.data.recipe.model import Cell
from pipeline.data.setup import Setup
from pipeline.evaluate.scenes.case import Case
from pipeline.evaluate.scenes.manifests import Manifests, SeedJob, inline, try_seed

TRAINING = 10_000
"""The `--seed` of the scenes that environments train on: evaluate on another one."""

TRIES = 30
"""Seeds tried for one wanted seed until the expert solves one."""


class NoCase(DominoError):
    """The expert solved none of the seeds tried."""


class OtherCase(DominoError, ValueError):
    """A case that an environment was not made for."""


remembered = lru_cache(maxsize=1024)(try_seed)


def case_of_seed(cell: Cell, seed: int, setup: Setup) -> Case:
    """The case of a seed if the expert solves it, else of the next seed derived from it. Raises
    NoCase after TRIES seeds."""
    reason = ""
    for number in range(TRIES):
        case = remembered(SeedJob(cell, derived_seed(seed, number), setup.calm))
        if isinstance(case, Case):
            return case
        reason = case
    raise NoCase(
        f"the expert solves none of {TRIES} scenes of {cell.task} drawn from seed {seed}; the last:"
        f" {reason}"
    )


@lru_cache(maxsize=16)
def training_scenes(
    cell: Cell, count: int, setup: Setup, manifests: Path | None
) -> tuple[Case, ...]:
    """The first `count` scenes of the seed TRAINING that the expert solves, kept in `manifests` if
    it is given. Raises ProtocolError."""
    with ExitStack() as stack:
        root = manifests or Path(stack.enter_context(TemporaryDirectory()))
        return tuple(Manifests(root, TRAINING, setup).admitted([cell], count, inline)[cell])


def check_case(case: object, cell: Cell, setup: Setup) -> None:
    """Raise OtherCase, naming both values, for a case of another cell or physics, or for no
    Case."""
    if not isinstance(case, Case):
        raise OtherCase(
            f"{type(case).__name__} is no case: give that of an environment or a manifest"
        )
    for name in (field.name for field in fields(Cell)):
        has, needed = getattr(case.spec, name), getattr(cell, name)
        if has != needed:
            raise OtherCase(f"the case is of the {name} {has}, the environment of {needed}")
    if case.setup != setup.calm:
        raise OtherCase(
            f"the case is of the setup {case.setup.label}, the environment of {setup.label}"
        )


def derived_seed(seed: int, number: int) -> int:
    """The seed itself for number 0, then seeds that no neighbouring one leads to (63 bits)."""
    if number == 0:
        return seed
    return int.from_bytes(hashlib.sha256(f"{seed}/{number}".encode()).digest()[:8], "little") >> 1
