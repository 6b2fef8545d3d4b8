"""Failed attempts by reason (docs/add_a_task.md)."""

import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # it imports the simulator
    from .failure import Failure

EXAMPLES = 6  # conditions named at most


@dataclass(frozen=True)
class Reason:
    """Attempts that failed in one stage for one reason: `detail` of most of them (of no_motion: the
    motions that each check refused), and how many did not fulfil each condition."""

    stage: str
    reason: str
    attempts: int
    detail: str
    conditions: Mapping[str, int]

    def describe(self) -> str:
        named = [f"{name} {n}" for name, n in self.conditions.items()]
        exactly = f"not fulfilled: {', '.join(named[:EXAMPLES])}" if named else self.detail
        text = f"{self.attempts} x {self.stage}: {self.reason}"
        return f"{text} ({exactly})" if exactly else text


def reasons_of(failures: Iterable["Failure"]) -> list[Reason]:
    """As `reasons_in`, of some failures."""
    return reasons_in((each.stage, each.reason, each.detail, each.conditions) for each in failures)


def reasons_in(
    attempts: Iterable[tuple[str | None, str | None, str | None, Sequence[str]]],
) -> list[Reason]:
    """The failed among some attempts (stage, reason, detail, conditions that did not hold); the
    most frequent reason first."""
    details = defaultdict[tuple[str, str], list[str]](list)
    conditions = defaultdict[tuple[str, str], Counter[str]](Counter)
    for stage, reason, detail, failed in attempts:
        if reason:
            details[stage or "", reason].append((detail or "").removeprefix(f"{reason}: "))
            conditions[stage or "", reason].update(failed)
    reasons = [
        Reason(*kind, len(texts), _detail(kind[1], texts), dict(conditions[kind].most_common()))
        for kind, texts in details.items()
    ]
    return sorted(reasons, key=lambda r: (-r.attempts, r.stage, r.reason))


def _detail(reason: str, details: Sequence[str]) -> str:
    refused = Counter[str]()
    for detail in details if reason == "no_motion" else ():
        for check, number in re.findall(r"([a-z_]+) (\d+)", detail.rpartition(":")[2]):
            refused[check] += int(number)
    if refused:
        return "motions refused: " + ", ".join(f"{name} {n}" for name, n in refused.most_common())
    usual = Counter(filter(None, details)).most_common(1)
    return usual[0][0] if usual else ""
