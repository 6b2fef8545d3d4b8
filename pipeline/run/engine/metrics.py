"""Counters of a build on a Ray cluster, among Ray's own metrics: what watches the cluster (Prometheus, Grafana) has them too."""

from typing import Any

from pipeline.data.ledger.records import SlotRecord
from pipeline.data.ledger.table import PLACE
from pipeline.data.recipe.model import Slot
from pipeline.run.engine.pool import Pool

CELL = PLACE[:5]

COUNTERS = {
    "domino_slots": ("Slots that ended; outcome is accepted or given_up.", (*CELL, "outcome")),
    "domino_attempts": ("Attempts that ended; reason is that of a failure, accepted otherwise.", (*CELL, "reason")),
    "domino_phase_seconds": ("Seconds that workers spent on accepted episodes, by phase.", ("phase",)),
    "domino_workers_lost": ("Workers that died, hung, or went with their node.", ()),
}
"""Name (Ray puts `ray_` before it and `_total` behind), what it counts, labels."""


class Metrics:
    """The counters of one build; they count nothing without a cluster, whose operator has `--progress json` instead.

    Ray must run in this process when something is counted. A node shows its metrics where it has Ray's exporter (the extra
    `metrics`); without it, counting does no harm.
    """

    def __init__(self, pool: Pool) -> None:
        self._watched = pool.address is not None
        self._counters: dict[str, Any] = {}

    def count_slot(self, slot: Slot, record: SlotRecord) -> None:
        """Count a slot that ended."""
        cell = {name: str(getattr(slot.cell, name)) for name in CELL}
        self._count("domino_slots", 1, cell | {"outcome": "accepted" if record.accepted else "given_up"})
        for row in record.attempts:
            self._count("domino_attempts", 1, cell | {"reason": row["reason"] or "accepted"})
        for phase, seconds in record.phases.items():
            if not phase.endswith(".cpu") and seconds > 0:
                self._count("domino_phase_seconds", seconds, {"phase": phase})

    def count_lost(self) -> None:
        """Count a worker that was lost."""
        self._count("domino_workers_lost", 1, {})

    def _count(self, name: str, value: float, labels: dict[str, str]) -> None:
        if not self._watched:
            return
        if name not in self._counters:
            from ray.util.metrics import Counter

            said, keys = COUNTERS[name]
            self._counters[name] = Counter(name, description=said, tag_keys=keys)
        self._counters[name].inc(value, tags=labels)
