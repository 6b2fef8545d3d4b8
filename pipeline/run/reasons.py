"""Failed attempts by reason: how many, what exactly, which conditions did not hold, and what to change first."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from pipeline.stages.hints import hint, refusals

if TYPE_CHECKING:  # it imports the simulator
    from pipeline.stages.failure import Failure

EXAMPLES = 6
"""Conditions named at most."""


@dataclass(frozen=True)
class Reason:
    """Attempts that failed in one stage for one reason: `detail` of most of them (of no_motion: how many motions each check
    refused, summed), how many of them did not fulfil each condition, and a hint."""

    stage: str
    reason: str
    attempts: int
    detail: str
    conditions: Mapping[str, int]
    hint: str

    def said(self) -> str:
        """One line."""
        conditions = ", ".join(f"{name} {n}" for name, n in list(self.conditions.items())[:EXAMPLES])
        exactly = f" (not fulfilled: {conditions})" if conditions else f" ({self.detail})" if self.detail else ""
        return f"{self.attempts} x {self.stage}: {self.reason}{exactly}" + (f"; {self.hint}" if self.hint else "")


def row_of(failure: "Failure") -> dict[str, Any]:
    """The columns of attempts.parquet that `reasons` reads."""
    return {name: getattr(failure, name) for name in ("stage", "reason", "detail", "conditions")}


def reasons(rows: Iterable[Mapping[str, Any]]) -> list[Reason]:
    """The failed among some rows of attempts.parquet, most frequent reason first."""
    groups: dict[tuple[str, str], list[Mapping[str, Any]]] = defaultdict(list)
    for row in rows:
        if row["reason"]:
            groups[row["stage"], row["reason"]].append(row)
    found = [_reason(stage, reason, members) for (stage, reason), members in groups.items()]
    return sorted(found, key=lambda r: (-r.attempts, r.stage, r.reason))


def _reason(stage: str, reason: str, rows: list[Mapping[str, Any]]) -> Reason:
    details = [(row.get("detail") or "").removeprefix(f"{reason}: ") for row in rows]
    usual = Counter(filter(None, details)).most_common(1)
    detail = usual[0][0] if usual else ""
    if reason == "no_motion" and (refused := sum((refusals(d) for d in details), Counter())):
        detail = "motions refused: " + ", ".join(f"{name} {n}" for name, n in refused.most_common())
    conditions = Counter(name for row in rows for name in row.get("conditions") or ())
    return Reason(stage, reason, len(rows), detail, dict(conditions.most_common()), hint(reason, details))
