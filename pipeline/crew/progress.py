"""The progress of a build: counted once, shown as a bar, as JSON lines or not at all, and among the metrics of a Ray cluster."""

import json
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import IO, Any, Literal

from tqdm import tqdm

from pipeline.crew.pool import Pool
from pipeline.data.ledger.records import SlotRecord
from pipeline.data.ledger.table import PLACE
from pipeline.data.recipe.model import Slot

Kind = Literal["bar", "json", "none"]

_PLACE = PLACE[:6]
CELL = PLACE[:5]


@dataclass
class Tally:
    """Counts of a run: slots wanted and done, and of this run slots accepted and given up, attempts, failures by reason, slots of
    stopped cells and workers lost."""

    wanted: int
    done: int
    accepted: int = 0
    given_up: int = 0
    attempts: int = 0
    failures: Counter[str] = field(default_factory=Counter)
    stopped: int = 0
    workers_lost: int = 0

    def add(self, attempts: Sequence[Mapping[str, Any]]) -> None:
        """Count a slot that is done, with these rows of attempts.parquet."""
        accepted = any(row["outcome"] == "accepted" for row in attempts)
        self.attempts += len(attempts)
        self.failures.update(row["reason"] for row in attempts if row["reason"])
        self.done += 1
        self.accepted += accepted
        self.given_up += not accepted

    def rate(self, seconds: float) -> float:
        """Accepted episodes an hour, of this run."""
        return 3600 * self.accepted / max(seconds, 1e-9)

    def left(self, seconds: float) -> float | None:
        """Seconds until the rest is done, at the pace of this run; None before the first slot ends."""
        made = self.accepted + self.given_up
        return (self.wanted - self.done - self.stopped) * seconds / made if made else None


class Progress:
    """The progress of one build: counts what is done, and shows nothing of it."""

    def __init__(self, wanted: int, done: int) -> None:
        self._tally = Tally(wanted, done)

    def write_line(self, text: str) -> None:
        """Write a line for a person."""

    def show_activity(self, text: str) -> None:
        """Show what happens until the next slot is done."""

    def close(self) -> None:
        """Nothing more will come."""

    def _show(self, event: str, place: Mapping[str, Any]) -> None:
        """Show a change: `event` is slot or cell_stopped, with its `place`, or worker_lost."""

    def add(self, attempts: Sequence[Mapping[str, Any]]) -> None:
        """Count a slot that is done, with these rows of attempts.parquet."""
        self._tally.add(attempts)
        self._show("slot", {key: attempts[-1][key] for key in _PLACE if key in attempts[-1]} if attempts else {})

    def count_stopped(self, cell: str, slots: int, because: str) -> None:
        """Count a stopped cell: this number of its slots is not tried."""
        self._tally.stopped += slots
        self._show("cell_stopped", {"cell": cell, "because": because})

    def count_lost(self) -> None:
        """Count a worker that was lost and is replaced."""
        self._tally.workers_lost += 1
        self._show("worker_lost", {})


class Bar(Progress):
    """One bar on standard error: slots done, episodes per hour, attempt success rate, ETA, failures by reason and workers lost."""

    def __init__(self, wanted: int, done: int) -> None:
        super().__init__(wanted, done)
        self._bar = tqdm(total=wanted, initial=done, unit="ep", dynamic_ncols=True, smoothing=0.1)

    def write_line(self, text: str) -> None:
        """Write a line above the bar."""
        self._bar.write(text, file=sys.stderr)

    def show_activity(self, text: str) -> None:
        """Show the text behind the bar."""
        self._bar.set_postfix_str(text)

    def close(self) -> None:
        """Leave the bar as it is."""
        self._bar.close()

    def _show(self, event: str, place: Mapping[str, Any]) -> None:
        self._bar.update(event == "slot")
        tally, elapsed = self._tally, self._bar.format_dict["elapsed"]
        parts = [f"{tally.rate(elapsed):.0f} ep/h, {100 * tally.accepted / max(1, tally.attempts):.0f} % of attempts"]
        parts += [" ".join(f"{reason}:{n}" for reason, n in tally.failures.most_common(3))] if tally.failures else []
        parts += [f"stopped: {tally.stopped}"] if tally.stopped else []
        parts += [f"workers lost: {tally.workers_lost}"] if tally.workers_lost else []
        self._bar.set_postfix_str(", ".join(parts))


class JsonLines(Progress):
    """One JSON object a change, on a line of its own (docs/cluster.md names the keys)."""

    def __init__(self, wanted: int, done: int, out: IO[str] | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__(wanted, done)
        self._out, self._clock, self._began = out or sys.stdout, clock, clock()
        self._show("start", {})

    def write_line(self, text: str) -> None:
        """Write an object of its own."""
        self._write({"event": "note", "text": text})

    def show_activity(self, text: str) -> None:
        """As `write_line`."""
        self.write_line(text)

    def _show(self, event: str, place: Mapping[str, Any]) -> None:
        elapsed = self._clock() - self._began
        left = self._tally.left(elapsed)
        pace = {
            "elapsed_seconds": round(elapsed, 3),
            "episodes_per_hour": round(self._tally.rate(elapsed), 1),
            "eta_seconds": None if left is None else round(left, 1),
        }
        self._write({"event": event, **place, **vars(self._tally), **pace})

    def _write(self, values: Mapping[str, Any]) -> None:
        print(json.dumps(values), file=self._out, flush=True)


SHOWN: dict[Kind, Callable[[int, int], Progress]] = {"bar": Bar, "json": JsonLines, "none": Progress}
"""Makes the progress of a build (slots wanted, slots done before it) that is shown so."""


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
