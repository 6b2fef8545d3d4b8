"""Evaluation on the crew: every job ends once."""

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

from tqdm import tqdm

from pipeline.crew.contract import Crew, CrewError, Died
from pipeline.crew.loop import run
from pipeline.data.atomic import write_atomic
from pipeline.data.keys import digest
from pipeline.data.recipe.model import Cell, Recipe
from pipeline.data.setup import Setup
from pipeline.evaluate.evaluate import Evaluation
from pipeline.evaluate.policies.policy import PolicyName
from pipeline.evaluate.scenes.benchmark import (
    SUFFIX,
    Benchmark,
    pack,
    read_benchmark,
    unpack_benchmark,
)
from pipeline.evaluate.scenes.case import BenchmarkError
from pipeline.evaluate.scenes.manifests import Manifests, Runner
from pipeline.evaluate.scoring.clock import parse_clock

from .identity.core import code_version, policy_version
from .provenance import machine

# what one episode, or one seed of the expert, may take before its worker counts as hung
EPISODE_SECONDS = 1800.0


def evaluation_version() -> str:
    """A hash of the code that makes scenes and of the code that evaluates."""
    return digest([code_version(), policy_version()])


def evaluation_of(
    recipe: Recipe, setup: Setup, policy: PolicyName, clock: str = "", **more: Any
) -> Evaluation:
    """The evaluation of a policy in the cells of a recipe; the clock is by default that of the
    rules.
    """
    return Evaluation(
        cells=tuple(recipe.cells()),
        policy=policy,
        clock=parse_clock(clock or ("step-locked" if setup.rules == "domino" else "sim")),
        setup=setup,
        code=evaluation_version(),
        made_by=machine(),
        **more,
    )


def runner(crew: Crew, seconds: float = EPISODE_SECONDS) -> Runner:
    """Yields (job, result) as jobs end. Raises CrewError for a job that costs two workers."""

    def each(work: Callable[[Any], Any], jobs: Sequence[Any]) -> Iterator[tuple[Any, Any]]:
        with closing(run(lambda: work, deque(jobs), crew, seconds)) as ends:
            for end in ends:
                if isinstance(end, Died):
                    why = end.reason.replace("_", " ")
                    raise CrewError(f"{str(end.job)[:200]}: {why} twice")
                yield end.job, end.result

    return each


def freeze_benchmark(
    out: Path,
    cells: Sequence[Cell],
    scenes: int,
    parts: Mapping[str, Sequence[str]],
    seeds: Manifests,
    run_jobs: Runner,
    progress: bool,
) -> Benchmark:
    """Admit scenes of cells and write them as one file. Raises BenchmarkError if another benchmark
    is there.
    """
    there = read_benchmark(str(out)) if out.exists() else None
    other = BenchmarkError(
        f"--out {out}: is another benchmark: give another name, or remove the file"
    )
    if there is not None:
        held = [each.cell() for each in there.head.cells]
        if (there.head.scenes, held) != (scenes, [*cells]):
            raise other
    made_by = {"packages": machine()["packages"]}
    with tqdm(disable=not progress, bar_format="{desc} [{elapsed}]") as bar:
        bar.set_description_str("admitting seeds")
        cases = seeds.admitted(cells, scenes, run_jobs)
        bar.set_description_str("freezing")
        data = pack(out.name.removesuffix(SUFFIX), cases, seeds.setup, parts, made_by)
        made = unpack_benchmark(data, str(out))
        if there is not None and there.sha256 != made.sha256:
            raise other
        write_atomic(out, data)
    return made
