"""Why an attempt was not accepted."""

from collections.abc import Iterator
from contextlib import contextmanager

from pipeline.data.episode.state_log import StateLog
from pipeline.expert.actor import Actor
from pipeline.motion.contract import Features, TargetMotion
from pipeline.planning.failure import PlanFailure


class Failure(Exception):
    """An attempt without an episode: its stage, a reason code in snake case, a `detail` for people,
    and the success `conditions` that did not hold. `drawn` are the features of the target's
    `motion`, `meeting` (s) is the planned one.

    Raise it without giving it a name first: a frame that refers to an exception which refers to the
    frame stays until garbage is collected, with 150 MB of images."""

    def __init__(
        self,
        stage: str,
        reason: str,
        detail: str = "",
        conditions: tuple[str, ...] = (),
        *,
        steps: int = 0,
        drawn: Features | None = None,
        log: StateLog | None = None,
    ) -> None:
        super().__init__(f"{stage}: {reason}" + (f" ({detail})" if detail else ""))
        self.stage, self.reason, self.detail, self.conditions = stage, reason, detail, conditions
        self.steps, self.drawn, self.log = steps, drawn, log
        self.motion: TargetMotion | None = None
        self.meeting = 0.0


def no_success(stage: str, conditions: tuple[str, ...]) -> Failure:
    """The Failure of an attempt at whose end these success conditions do not hold."""
    why = f"does not hold at the end: {', '.join(conditions)}"
    return Failure(stage, "no_success", why, conditions)


@contextmanager
def failing_as(stage: str, actor: Actor) -> Iterator[None]:
    """Turn a PlanFailure into a Failure of `stage`; note steps and log on any Failure."""
    try:
        yield
    except PlanFailure as plan:
        raise Failure(stage, plan.reason, str(plan), steps=actor.steps, log=actor.log()) from plan
    except Failure as failure:
        failure.steps, failure.log = actor.steps, actor.log()
        raise
