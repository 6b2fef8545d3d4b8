"""The progress of a build: a bar, JSON lines or nothing."""

import json
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal

from tqdm import tqdm

Kind = Literal["bar", "json", "none"]

CELL = ("task", "embodiment", "level", "alpha", "domain")


class Progress:
    """Counts of a build, not shown: slots `wanted` and `done`; the others are of this run."""

    def __init__(self, wanted: int, done: int) -> None:
        self.wanted, self.done = wanted, done
        self.accepted = self.given_up = self.attempts = self.lost = 0
        self.failures = Counter[str]()

    def write_line(self, text: str) -> None:
        """Write a line for a person."""

    def show_activity(self, text: str) -> None:
        """Show what happens until the next slot is done."""

    def close(self) -> None:
        """Nothing more will come."""

    def _show(self, event: str, place: Mapping[str, Any]) -> None:
        """Show a change: slot, with its `place`, or worker_lost."""

    def add(self, attempts: Sequence[Mapping[str, Any]]) -> None:
        """Count a slot that is done."""
        accepted = any(row["outcome"] == "accepted" for row in attempts)
        self.attempts += len(attempts)
        self.failures.update(row["reason"] for row in attempts if row["reason"])
        self.done += 1
        self.accepted += accepted
        self.given_up += not accepted
        last = attempts[-1] if attempts else {}
        self._show("slot", {key: last[key] for key in (*CELL, "slot") if key in last})

    def count_lost(self) -> None:
        """Count a worker that was lost and is replaced."""
        self.lost += 1
        self._show("worker_lost", {})

    def rate(self, seconds: float) -> float:
        """Accepted episodes an hour, after so many seconds of this run."""
        return 3600 * self.accepted / max(seconds, 1e-9)


class Bar(Progress):
    """A bar on standard error: slots, episodes per hour, attempts, ETA, failures, lost workers."""

    def __init__(self, wanted: int, done: int) -> None:
        super().__init__(wanted, done)
        self._bar = tqdm(total=wanted, initial=done, unit="ep", dynamic_ncols=True, smoothing=0.1)

    def write_line(self, text: str) -> None:
        self._bar.write(text, file=sys.stderr)

    def show_activity(self, text: str) -> None:
        self._bar.set_postfix_str(text)

    def close(self) -> None:
        self._bar.close()

    def _show(self, event: str, place: Mapping[str, Any]) -> None:
        self._bar.update(event == "slot")
        rate = self.rate(self._bar.format_dict["elapsed"])
        share = 100 * self.accepted / max(1, self.attempts)
        parts = [f"{rate:.0f} ep/h, {share:.0f} % of attempts"]
        if self.failures:
            parts.append(" ".join(f"{reason}:{n}" for reason, n in self.failures.most_common(3)))
        parts += [f"workers lost: {self.lost}"] if self.lost else []
        self._bar.set_postfix_str(", ".join(parts))


class JsonLines(Progress):
    """One JSON object a change, on a line of its own (docs/cluster.md names the keys)."""

    def __init__(self, wanted: int, done: int) -> None:
        super().__init__(wanted, done)
        self._began = time.monotonic()
        self._show("start", {})

    def write_line(self, text: str) -> None:
        self._write({"event": "note", "text": text})

    show_activity = write_line

    def _show(self, event: str, place: Mapping[str, Any]) -> None:
        seconds, ended = time.monotonic() - self._began, self.accepted + self.given_up
        left = self.wanted - self.done
        names = ("wanted", "done", "accepted", "given_up", "attempts", "failures")
        counts = {name: getattr(self, name) for name in names} | {"workers_lost": self.lost}
        pace = {
            "elapsed_seconds": round(seconds, 3),
            "episodes_per_hour": round(self.rate(seconds), 1),
            "eta_seconds": round(left * seconds / ended, 1) if ended else None,
        }
        self._write({"event": event, **place, **counts, **pace})

    def _write(self, values: Mapping[str, Any]) -> None:
        print(json.dumps(values), flush=True)


SHOWN: dict[Kind, Callable[[int, int], Progress]] = {
    "bar": Bar,
    "json": JsonLines,
    "none": Progress,
}
"""Makes the progress of a build: of slots wanted, and slots done before it."""
