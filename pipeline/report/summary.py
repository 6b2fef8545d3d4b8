"""The report of a dataset: OUT/report/index.html, which opens anywhere without a network; of
many cells, a page a task."""

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.data.atomic import remove, write_atomic
from pipeline.data.episode.file import EpisodeError, open_episode
from pipeline.data.recipe.model import Cell as RecipeCell
from pipeline.data.spec import EpisodeSpec
from pipeline.report.clip import clip
from pipeline.report.contact_sheet import encode, subtitle
from pipeline.report.film_strip import film
from pipeline.report.sections import (
    CellCard,
    Figure,
    Moves,
    OutcomeBar,
    Report,
    Section,
    SpeedPlot,
    Strip,
    TaskLink,
    TaskSection,
    report_page,
    speed_histogram,
)
from pipeline.report.speed_law import drawn_and_accepted, law

COLUMNS = 6
FILM_WIDTH = 256  # pixels; six of them fill a page
MANY_CELLS = 40  # from here on a page a task, with one film a cell

MOTION = ("alpha", "average_speed", "end_speed", "displacement")
"""What speed_law.py reads of a motion."""

type Cell = tuple[str, str, int, float, str]
type Row = Mapping[str, Any]
type Attempts = Mapping[Cell, Sequence[Row]]


def failed_folder(dataset: Path, cell: str) -> Path:
    """Where pictures of the failed attempts of a cell are kept, files
    STAGE-REASON-SLOT-ATTEMPT.jpg."""
    return dataset / "report" / "failed" / cell


@dataclass(frozen=True)
class EpisodeFacts:
    """One episode: its length in s, and the average and maximum speed of its target's motion in
    m/s."""

    path: Path
    spec: EpisodeSpec
    seconds: float
    average_speed: float
    maximum_speed: float


def observe(path: Path) -> EpisodeFacts:
    """Measure an episode file: speeds before the target was released. Raises EpisodeError if it
    cannot be read."""
    with open_episode(path) as e:
        episode = e.read()
        log = episode.log
        release = log.time_of("release")
        before = log.times <= (log.times[-1] if release is None else release)
        speed = np.linalg.norm(log.target_velocity[before], axis=1)
        return EpisodeFacts(
            path, episode.spec, len(e) / e.fps, float(speed.mean()), float(speed.max())
        )


def cell_of(row: Mapping[str, Any]) -> Cell:
    """The cell an attempt belongs to."""
    return row["task"], row["embodiment"], int(row["level"]), float(row["alpha"]), row["domain"]


@dataclass(frozen=True)
class ReportData:
    """What a report is made of: its episodes, and the attempts (columns of data.records.ATTEMPTS)
    of every cell that has some.

    `keys` names, by task, what its page is made of: a page of the same key is not drawn again.
    Tasks without a key always are.
    """

    seen: Sequence[EpisodeFacts]
    attempts: Mapping[Cell, Sequence[Mapping[str, Any]]]
    keys: Mapping[str, str] = field(default_factory=dict)


def write_report(dataset: Path, material: ReportData, extras: Sequence[Section] = ()) -> Path:
    """Write the report of a dataset and return its path; `extras` are shown before the cells.
    From MANY_CELLS cells on every task has a page of its own, tasks/TASK.html."""
    by_cell: dict[Cell, list[EpisodeFacts]] = defaultdict(list)
    for o in material.seen:
        by_cell[cell_of(vars(o.spec))].append(o)
    tried = material.attempts
    cells = sorted({*by_cell, *tried})
    paged = len(cells) >= MANY_CELLS
    tasks = list(dict.fromkeys(cell[0] for cell in cells))
    folder = dataset / "report" / "tasks"
    remove(folder) if not paged else _remove_others(folder, tasks)
    sections, links = list[TaskSection](), list[TaskLink]()
    for task in tasks:
        own = [cell for cell in cells if cell[0] == task]
        title = task.replace("_", " ")
        if not paged:
            sections.append(TaskSection(title, _cards(dataset, own, by_cell, tried, 2)))
            continue
        page = folder / f"{task}.html"
        counts = sum(
            (Counter(row["outcome"] for row in tried.get(cell, ())) for cell in own), Counter[str]()
        )
        links.append(
            TaskLink(title, f"tasks/{page.name}", len(own), counts.total(), counts["accepted"])
        )
        key = material.keys.get(task, "")
        if not key or not _is_of(page, key):
            report = _summarise(f"{dataset.resolve().name}: {title}", own, by_cell, tried)
            _write(
                page,
                replace(
                    report,
                    tasks=[TaskSection(title, _cards(dataset, own, by_cell, tried, 1))],
                    key=key,
                ),
            )
    page = dataset / "report" / "index.html"
    report = _summarise(dataset.resolve().name, cells, by_cell, tried)
    _write(page, replace(report, extras=extras, tasks=sections, links=links))
    return page


def _write(page: Path, report: Report) -> None:
    # a file name may hold bytes that are no UTF-8
    write_atomic(page, report_page(report).encode(errors="replace"))


def _is_of(page: Path, key: str) -> bool:
    """Whether a page was made of what the key names."""
    try:
        with page.open("rb") as file:
            return f"<!-- key: {key} -->".encode() in file.read(1000)
    except OSError:
        return False


def _remove_others(folder: Path, tasks: Sequence[str]) -> None:
    """Remove the pages of tasks that the dataset does not have."""
    for path in folder.glob("*.html"):
        if path.stem not in tasks:
            path.unlink()


def _cards(
    dataset: Path,
    cells: Sequence[Cell],
    by_cell: Mapping[Cell, list[EpisodeFacts]],
    tried: Attempts,
    films: int,
) -> list[CellCard]:
    cards = []
    for cell in cells:
        card = _cell_card(cell, tried.get(cell, ()), by_cell.get(cell, [])[:films])
        cards.append(replace(card, failed=_failure_strips(dataset, cell, films)))
    return cards


def _summarise(
    name: str, cells: Sequence[Cell], by_cell: Mapping[Cell, list[EpisodeFacts]], tried: Attempts
) -> Report:
    """The report of some cells without their cards. Attempts are read cell by cell: there may be
    too many to hold at once."""
    seen = [o for cell in cells for o in by_cell.get(cell, ())]
    total = Totals()
    for cell in cells:
        total.add(tried.get(cell, ()))
    return Report(
        name=name,
        scope=_scope(cells),
        tiles=_summary(seen, total),
        outcomes=_bars(total.won, total.lost),
        speeds=_speeds(seen),
        moves=_moves(total),
        extras=(),
        tasks=(),
    )


@dataclass
class Totals:
    """Sums over attempts: how many, accepted, failed by reason, physics steps, seconds; of the
    motions, by level and alpha, what speed_law.py needs, as drawn and as accepted."""

    count: int = 0
    won: int = 0
    steps: int = 0
    seconds: float = 0.0
    lost: Counter[str] = field(default_factory=Counter)
    moves: dict[tuple[int, float], tuple[list[Row], list[Row]]] = field(
        default_factory=lambda: defaultdict(lambda: ([], []))
    )

    def add(self, rows: Sequence[Row]) -> None:
        """Count the attempts of one cell."""
        self.count += len(rows)
        self.won += sum(r["outcome"] == "accepted" for r in rows)
        self.steps += sum(int(r["sim_steps"] or 0) for r in rows)
        self.seconds += sum(float(r["seconds"] or 0.0) for r in rows)
        self.lost.update(
            f"{r['stage']}: {r['reason']}".replace("_", " ")
            for r in rows
            if r["outcome"] != "accepted"
        )
        if rows:
            into = self.moves[int(rows[0]["level"]), float(rows[0]["alpha"])]
            for members, motions in zip(into, drawn_and_accepted(rows), strict=True):
                members += [{name: r[name] for name in MOTION} for r in motions]


def _scope(cells: Sequence[Cell]) -> str:
    names = ("task", "embodiment", "level", "alpha", "domain")
    counts = [len({c[i] for c in cells}) for i in range(len(names))]
    words = [f"{n} {name}{'' if n == 1 else 's'}" for n, name in zip(counts, names, strict=True)]
    return ", ".join(words) + f": {len(cells)} cell{'' if len(cells) == 1 else 's'}"


def _summary(seen: Sequence[EpisodeFacts], total: Totals) -> dict[str, str]:
    hours = sum(o.seconds for o in seen) / 3600
    spent = total.seconds
    values = {
        "episodes": f"{len(seen):,}",
        "attempts": f"{total.count:,}",
        "attempts accepted": f"{100 * total.won / total.count:.1f} %" if total.count else "none",
        "of data": f"{hours:.2f} h" if hours >= 0.1 else f"{hours * 60:.1f} min",
        "physics steps": f"{total.steps:,}",
        "spent on attempts": f"{spent / 3600:.2f} h" if spent >= 3600 else f"{spent:.1f} s",
    }
    if seen and spent:
        values["spent an episode"] = f"{spent / len(seen):.2f} s"
    return values


def _bars(won: int, lost: Counter[str]) -> list[OutcomeBar]:
    if not won and not lost:
        return []
    return [
        OutcomeBar("accepted", won, True),
        *(
            OutcomeBar(label, n, False)
            for label, n in sorted(lost.items(), key=lambda x: (-x[1], x[0]))
        ),
    ]


def _speeds(seen: Sequence[EpisodeFacts]) -> list[SpeedPlot]:
    groups: dict[tuple[int, float], list[EpisodeFacts]] = defaultdict(list)
    for o in seen:
        if o.spec.moving:
            groups[o.spec.level, o.spec.alpha].append(o)
    plots = []
    for (level, alpha), members in sorted(groups.items()):
        average, maximum = [o.average_speed for o in members], [o.maximum_speed for o in members]
        histogram = speed_histogram(average, maximum, alpha)
        plots.append(
            SpeedPlot(level, len(members), float(np.mean(average)), max(maximum), histogram)
        )
    return plots


def _moves(total: Totals) -> list[Moves]:
    return [
        Moves(f"level {level}, alpha {alpha:g}", law(drawn), law(accepted))
        for (level, alpha), (drawn, accepted) in sorted(total.moves.items())
        if drawn
    ]


def _failure_strips(dataset: Path, cell: Cell, most: int) -> list[Strip]:
    """The last frames of attempts that failed in the cell, `most` pictures at most."""
    strips = []
    for path in sorted(failed_folder(dataset, RecipeCell(*cell).path).glob("*-*-*-*.jpg"))[:most]:
        stage, reason, slot, attempt = path.stem.split("-")
        words = f"{stage}: {reason}".replace("_", " ")
        strips.append(
            Strip(
                [Figure(path.read_bytes(), f"failed: {words} (slot {slot}, attempt {attempt})")], 1
            )
        )
    return strips


def _cell_card(cell: Cell, rows: Sequence[Row], shown: Sequence[EpisodeFacts]) -> CellCard:
    task, embodiment, level, alpha, domain = cell
    strips, unseen = [], []
    for o in shown:
        try:
            shots = film(o.path, COLUMNS, FILM_WIDTH).shots
        # without a head camera, or damaged, it still counts
        except (EpisodeError, KeyError, OSError, ValueError) as error:
            unseen.append(str(error))
            continue
        figures = [Figure(encode(s.rgb, quality=80), s.caption, s.meeting) for s in shots]
        strips.append(Strip(figures, COLUMNS))
    words = subtitle(EpisodeSpec(task, embodiment, level, alpha, domain, 0, 0)).replace(
        "  |  ", " · "
    )
    moving = clip(shown[0].path) if strips else b""
    total = Totals()
    total.add(rows)
    drawn, accepted = drawn_and_accepted(rows)
    return CellCard(
        words,
        _bars(total.won, total.lost),
        Moves(words, law(drawn), law(accepted)),
        strips,
        unseen,
        moving,
    )
