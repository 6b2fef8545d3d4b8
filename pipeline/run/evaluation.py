"""Evaluation on the crew: every job ends once."""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from typing import Any

from pipeline.crew.contract import Crew, CrewError, Died
from pipeline.crew.loop import run
from pipeline.data.keys import digest
from pipeline.data.recipe.model import Recipe
from pipeline.data.setup import Setup
from pipeline.evaluate.evaluate import Evaluation
from pipeline.evaluate.policies.policy import PolicyName
from pipeline.evaluate.scenes.manifests import Runner
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
