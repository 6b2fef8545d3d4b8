"""Failed attempts by reason: how many, what exactly, which conditions did not hold, and what to change first."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa

from pipeline.data.ledger.columns import codes, mask_of
from pipeline.data.ledger.records import ATTEMPTS
from pipeline.stages.hints import hint_of, refusals

if TYPE_CHECKING:  # it imports the simulator
    from pipeline.stages.failure import Failure

EXAMPLES = 6  # conditions named at most
_READ = pa.struct([ATTEMPTS.field(name) for name in ("stage", "reason", "detail", "conditions")])


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

    def describe(self) -> str:
        """One line."""
        conditions = ", ".join(f"{name} {n}" for name, n in list(self.conditions.items())[:EXAMPLES])
        exactly = f" (not fulfilled: {conditions})" if conditions else f" ({self.detail})" if self.detail else ""
        return f"{self.attempts} x {self.stage}: {self.reason}{exactly}" + (f"; {self.hint}" if self.hint else "")


def reasons_of(failures: Iterable["Failure"]) -> list[Reason]:
    """As `reasons_in`, of some failures."""
    rows = [{name: getattr(failure, name) for name in _READ.names} for failure in failures]
    return reasons_in(pa.array(rows, _READ))


def reasons_in(attempts: pa.StructArray) -> list[Reason]:
    """The failed among some attempts, rows with stage, reason, detail and conditions; the most frequent reason first."""
    (of_stage, stages), (of_reason, names) = codes(attempts.field("stage")), codes(attempts.field("reason"))
    failed = np.array([bool(name) for name in (*names, "")])[of_reason]
    found = list[Reason]()
    for reason, stage in np.unique(np.stack([of_reason, of_stage])[:, failed], axis=1).T.tolist():
        rows = attempts.filter(mask_of((of_reason == reason) & (of_stage == stage)))
        details = [detail or "" for detail in rows.field("detail").to_pylist()]
        conditions = _count(rows.field("conditions").flatten())
        found.append(_reason(stages[stage] if stage >= 0 else "", names[reason], details, conditions))
    return sorted(found, key=lambda r: (-r.attempts, r.stage, r.reason))


def _count(values: pa.Array) -> Counter[str]:
    numbered, different = codes(values)
    return Counter(dict(zip(different, np.bincount(numbered, minlength=len(different)).tolist(), strict=True)))


def _reason(stage: str, reason: str, details: Sequence[str], conditions: Counter[str]) -> Reason:
    """`details` has one text for every attempt."""
    plain = [detail.removeprefix(f"{reason}: ") for detail in details]
    usual = Counter(filter(None, plain)).most_common(1)
    detail, refused = usual[0][0] if usual else "", refusals(plain) if reason == "no_motion" else Counter[str]()
    if refused:
        detail = "motions refused: " + ", ".join(f"{name} {n}" for name, n in refused.most_common())
    return Reason(stage, reason, len(details), detail, dict(conditions.most_common()), hint_of(reason, refused))
