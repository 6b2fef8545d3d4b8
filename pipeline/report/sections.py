"""What the report's page shows, as data, and the page itself: the words and the order stand in
templates/report.html."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.html import render_page
from pipeline.report.speed_law import Law


@dataclass(frozen=True)
class OutcomeBar:
    """A labelled count, and whether it counts successes."""

    label: str
    count: int
    good: bool


@dataclass(frozen=True)
class Figure:
    """An image (JPEG bytes) with its caption, and whether it is the frame of the meeting."""

    jpeg: bytes
    caption: str
    meeting: bool = False


@dataclass(frozen=True)
class Strip:
    """Figures side by side, `columns` of them in a row."""

    figures: Sequence[Figure]
    columns: int


@dataclass(frozen=True)
class Section:
    """A titled part of the page made of strips."""

    title: str
    strips: Sequence[Strip]


@dataclass(frozen=True)
class Column:
    """One rectangle of a histogram, in SVG units."""

    x: float
    y: float
    width: float
    height: float


@dataclass(frozen=True)
class Histogram:
    """Where the parts of a speed histogram lie, in SVG units: the axis at height `base`, the line
    of alpha at `alpha_x`.

    `top` is the speed at the right end in m/s, `alpha` the dynamics coefficient in m/s.
    """

    width: int
    height: int
    left: int
    base: int
    top: float
    alpha: float
    alpha_x: float
    average: Sequence[Column]
    maximum: Sequence[Column]


@dataclass(frozen=True)
class SpeedPlot:
    """Speeds of the targets of one level in m/s: the mean of the episodes' averages, the largest
    maximum, and their histogram."""

    level: int
    episodes: int
    mean: float
    largest: float
    histogram: Histogram


@dataclass(frozen=True)
class Moves:
    """The motion law of a group's targets, as drawn and as accepted; None if there is no such
    motion."""

    title: str
    drawn: Law | None
    accepted: Law | None


@dataclass(frozen=True)
class CellCard:
    """The card of one cell: outcomes, motions of its targets, frames of some episodes, and the film
    (mp4) of the first, or b"".

    Episodes without frames have a reason instead; `failed` are the last frames of failed
    attempts."""

    subtitle: str
    outcomes: Sequence[OutcomeBar]
    moves: Moves
    strips: Sequence[Strip]
    unseen: Sequence[str]
    clip: bytes = b""
    failed: Sequence[Strip] = ()


@dataclass(frozen=True)
class TaskSection:
    """The cells of one task."""

    title: str
    cells: Sequence[CellCard]


@dataclass(frozen=True)
class TaskLink:
    """The page of a task: where it is, and how many cells, attempts and accepted episodes it
    has."""

    title: str
    page: str
    cells: int
    attempts: int
    accepted: int


@dataclass(frozen=True)
class Report:
    """The whole page; `extras` stand before the tasks, `links` in place of tasks that have pages of
    their own. `key` names what the page was made of."""

    name: str
    scope: str
    tiles: Mapping[str, str]
    outcomes: Sequence[OutcomeBar]
    speeds: Sequence[SpeedPlot]
    moves: Sequence[Moves]
    extras: Sequence[Section]
    tasks: Sequence[TaskSection]
    links: Sequence[TaskLink] = ()
    key: str = ""


def report_page(report: Report) -> str:
    """The report as one HTML document; every text in it is escaped."""
    return render_page("pipeline.report", "report.html", report=report)


def speed_histogram(
    average: Sequence[float], maximum: Sequence[float], alpha: float, bins: int = 24
) -> Histogram:
    """The histogram of average and maximum speeds in m/s over [0, 1.08 times the largest of them
    and alpha]."""
    width, height, left, base, tall = 360, 170, 8, 140, 112
    top = max([alpha, *average, *maximum, 1e-3]) * 1.08
    edges = np.linspace(0, top, bins + 1)
    counts = [np.histogram(speeds, edges)[0] for speeds in (average, maximum)]
    highest = max(1, *(int(c.max()) for c in counts))
    step = (width - 2 * left) / bins
    columns = [
        [
            Column(left + i * step + 0.7, base - tall * n / highest, step - 1.4, tall * n / highest)
            for i, n in enumerate(c.tolist())
            if n
        ]
        for c in counts
    ]
    return Histogram(
        width, height, left, base, top, alpha, left + (width - 2 * left) * alpha / top, *columns
    )
