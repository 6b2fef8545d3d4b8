"""The progress bar of a build."""

import sys
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any

from tqdm import tqdm


class Progress:
    """One bar: slots done, episodes per hour, attempt success rate, ETA, failures by reason and workers lost."""

    def __init__(self, total: int, done: int, quiet: bool = False) -> None:
        self._bar = tqdm(total=total, initial=done, unit="ep", disable=quiet, dynamic_ncols=True, smoothing=0.1)
        self._attempts = self._accepted = self._lost = 0
        self._reasons: Counter[str] = Counter()

    def say(self, text: str) -> None:
        """A line above the bar."""
        if not self._bar.disable:
            self._bar.write(text, file=sys.stderr)

    def doing(self, text: str) -> None:
        """Say behind the bar what goes on until the next slot is done."""
        self._bar.set_postfix_str(text)

    def add(self, attempts: Iterable[Mapping[str, Any]]) -> None:
        """One slot is done."""
        for row in attempts:
            self._attempts += 1
            self._accepted += row["outcome"] == "accepted"
            if row["reason"]:
                self._reasons[row["reason"]] += 1
        self._bar.update(1)
        self._show()

    def lost(self) -> None:
        """One worker was lost and is replaced."""
        self._lost += 1
        self._show()

    def close(self) -> None:
        """Leave the bar as it is."""
        self._bar.close()

    def _show(self) -> None:
        elapsed = self._bar.format_dict["elapsed"] or 1e-9
        parts = [f"{3600 * self._accepted / elapsed:.0f} ep/h, {100 * self._accepted / max(1, self._attempts):.0f} % of attempts"]
        parts += [" ".join(f"{reason}:{n}" for reason, n in self._reasons.most_common(3))] if self._reasons else []
        parts += [f"workers lost: {self._lost}"] if self._lost else []
        self._bar.set_postfix_str(", ".join(parts))
