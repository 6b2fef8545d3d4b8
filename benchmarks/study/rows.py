"""The rows of the study, and the rates that its tables and plots show."""

import json
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.evaluate.scoring.statistics import clustered
from pipeline.evaluate.scoring.summary import scene_of

Row = dict[str, Any]


@dataclass(frozen=True)
class Rate:
    """Successes of a number of episodes: (successes, episodes) of each scene."""

    scenes: tuple[tuple[int, int], ...]

    @classmethod
    def of(cls, rows: Sequence[Row]) -> "Rate":
        """The rate of rows, whose scenes several networks may have tried."""
        tried, solved = (
            Counter(map(scene_of, rows)),
            Counter(scene_of(row) for row in rows if row["success"]),
        )
        return cls(tuple((solved[scene], count) for scene, count in tried.items()))

    @property
    def solved(self) -> int:
        """Successes."""
        return sum(solved for solved, _ in self.scenes)

    @property
    def episodes(self) -> int:
        """Episodes."""
        return sum(count for _, count in self.scenes)

    @property
    def percent(self) -> float:
        """Success rate; NaN without episodes."""
        return 100 * self.solved / self.episodes if self.episodes else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval clustered by scene, per cent."""
        low, high = clustered(self.scenes)
        return 100 * low, 100 * high

    def __str__(self) -> str:
        if not self.episodes:
            return "-"
        low, high = self.interval
        return f"{self.percent:.0f} ({low:.0f}-{high:.0f})"


@dataclass(frozen=True)
class StudyRows:
    """Rows of one version of the code."""

    rows: tuple[Row, ...]

    @classmethod
    def read(cls, where: Path) -> "StudyRows":
        """Those of the version that wrote last. Raises ValueError for a file without rows."""
        rows = [json.loads(line) for line in (where / "rows.jsonl").read_text().splitlines()]
        if not rows:
            raise ValueError(f"{where / 'rows.jsonl'} has no rows: run the study first")
        return cls(tuple(row for row in rows if row["version"] == rows[-1]["version"]))

    def of(self, **wanted: Any) -> "StudyRows":
        """Rows whose columns have these values."""
        return StudyRows(
            tuple(
                row for row in self.rows if all(row[key] == value for key, value in wanted.items())
            )
        )

    def where(self, holds: Callable[[Row], bool]) -> "StudyRows":
        """Rows for which something holds."""
        return StudyRows(tuple(row for row in self.rows if holds(row)))

    def values(self, column: str) -> list[Any]:
        """The different values of a column, in order."""
        return sorted({row[column] for row in self.rows})

    @property
    def rate(self) -> Rate:
        """The success rate of all of them."""
        return Rate.of(self.rows)


def at(rows: StudyRows, level: int, alpha: float) -> StudyRows:
    """A level and an alpha; alpha 0 is level 0, at which no target moves."""
    return rows.of(level=0) if level == 0 or alpha == 0 else rows.of(level=level, alpha=alpha)


def markdown(head: Sequence[str], body: Sequence[Sequence[object]]) -> str:
    """A table whose first column is text and whose others are aligned right."""
    lines = [f"| {' | '.join(map(str, row))} |" for row in (head, *body)]
    return "\n".join([lines[0], "|---|" + "---:|" * (len(head) - 1), *lines[1:]])
