"""Failed attempts by reason: how many, what exactly, which conditions did not hold, and what to
change first."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pipeline.stages.hints import hint_of, refusals

if TYPE_CHECKING:  # it imports the simulator
    from pipeline.stages.failure import Failure

EXAMPLES = 6  # conditions named at most


@dataclass(frozen=True)
class Reason:
    """Attempts that failed in one stage for one reason: `detail` of most of them (of no_motion: how
    many motions each check refused, summed), how many of them did not fulfil each condition, and a
    hint."""

    stage: str
    reason: str
    attempts: int
    detail: str
    conditions: Mapping[str, int]
    hint: str

    def describe(self) -> str:
        """One line."""
        conditions = ", ".join(
            f"{name} {n}" for name, n in list(self.conditions.items())[:EXAMPLES]
        )
        exactly = (
            f" (not fulfilled: {conditions})"
            if conditions
            else f" ({self.detail})"
            if self.detail
            else ""
        )
        return f"{self.attempts} x {self.stage}: {self.reason}{exactly}" + (
            f"; {self.hint}" if self.hint else ""
        )


def reasons_of(failures: Iterable["Failure"]) -> list[Reason]:
    """As `reasons_in`, of some failures."""
    return reasons_in((each.stage, each.reason, each.detail, each.conditions) for each in failures)


def reasons_in(
    attempts: Iterable[tuple[str | None, str | None, str | None, Sequence[str]]],
) -> list[Reason]:
    """The failed among some attempts (stage, reason, detail, conditions that did not hold); the
    most frequent reason first."""
    details, conditions = (
        defaultdict[tuple[str, str], list[str]](list),
        defaultdict[tuple[str, str], Counter[str]](Counter),
    )
    for stage, reason, detail, failed in attempts:
        if reason:
            details[stage or "", reason].append(detail or "")
            if failed:
                conditions[stage or "", reason].update(failed)
    found = [_reason(*kind, texts, conditions[kind]) for kind, texts in details.items()]
    return sorted(found, key=lambda r: (-r.attempts, r.stage, r.reason))


def _reason(stage: str, reason: str, details: Sequence[str], conditions: Counter[str]) -> Reason:
    """`details` has one text for every attempt."""
    plain = [detail.removeprefix(f"{reason}: ") for detail in details]
    usual = Counter(filter(None, plain)).most_common(1)
    detail, refused = (
        usual[0][0] if usual else "",
        refusals(plain) if reason == "no_motion" else Counter[str](),
    )
    if refused:
        detail = "motions refused: " + ", ".join(f"{name} {n}" for name, n in refused.most_common())
    return Reason(
        stage,
        reason,
        len(details),
        detail,
        dict(conditions.most_common()),
        hint_of(reason, refused),
    )
