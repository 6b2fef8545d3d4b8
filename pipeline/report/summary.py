"""The report of a dataset: OUT/report/index.html, one file that opens anywhere without a network.

Summary tiles, speeds seen against alpha, and for every cell its outcomes and a few frames with the target's path drawn in.
"""

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.data.atomic import write_atomic
from pipeline.data.episode import EpisodeError, open_episode
from pipeline.data.recipe import Cell as RecipeCell
from pipeline.data.spec import EpisodeSpec
from pipeline.report.clip import clip
from pipeline.report.contact_sheet import encode, subtitle
from pipeline.report.film_strip import film
from pipeline.report.html import (
    Bar,
    CellCard,
    Figure,
    Moves,
    Report,
    Section,
    SpeedPlot,
    Strip,
    TaskSection,
    report_page,
    speed_histogram,
)
from pipeline.report.speed_law import drawn_and_accepted, law

COLUMNS = 6
FILM_WIDTH = 256  # pixels; six of them fill a page
MANY_CELLS = 40  # from here on one film a cell, to keep the page small

type Cell = tuple[str, str, int, float, str]


def failed_folder(dataset: Path, cell: str) -> Path:
    """Where pictures of the failed attempts of a cell are kept, files STAGE-REASON-SLOT-ATTEMPT.jpg."""
    return dataset / "report" / "failed" / cell


@dataclass(frozen=True)
class Observation:
    """What one episode shows: its length in s, and the target's average and maximum speed in m/s before it was released
    (before the end where it never was)."""

    path: Path
    spec: EpisodeSpec
    seconds: float
    average_speed: float
    maximum_speed: float


def observe(path: Path) -> Observation:
    """Measure an episode file. Raises EpisodeError where it cannot be read."""
    with open_episode(path) as e:
        episode = e.read()
        log = episode.log
        release = log.time_of("release")
        before = log.times <= (log.times[-1] if release is None else release)
        speed = np.linalg.norm(log.target_velocity[before], axis=1)
        return Observation(path, episode.spec, len(e) / e.fps, float(speed.mean()), float(speed.max()))


def cell_of(row: Mapping[str, Any]) -> Cell:
    """The cell an attempt belongs to."""
    return row["task"], row["embodiment"], int(row["level"]), float(row["alpha"]), row["domain"]


def write_report(
    dataset: Path, episodes: Sequence[Path], attempts: Sequence[Mapping[str, Any]], extras: Sequence[Section] = ()
) -> Path:
    """Write the report of a dataset and return its path.

    `attempts` has the columns task, embodiment, level, alpha, domain, slot, attempt, seed, outcome ("accepted" or "failed"),
    stage, reason, sim_steps and seconds, and those of speed_law.py where a motion was drawn. `extras` are more parts, shown before
    the cells. Raises EpisodeError, naming the file, for an episode that cannot be read.
    """
    seen = [observe(path) for path in episodes]
    by_cell: dict[Cell, list[Observation]] = defaultdict(list)
    for o in seen:
        by_cell[cell_of(vars(o.spec))].append(o)
    tried: dict[Cell, list[Mapping[str, Any]]] = defaultdict(list)
    for row in attempts:
        tried[cell_of(row)].append(row)
    cells = sorted({*by_cell, *tried})
    films = 2 if len(cells) < MANY_CELLS else 1
    tasks: dict[str, list[CellCard]] = defaultdict(list)
    for cell in cells:
        card = _cell_card(cell, tried[cell], by_cell[cell][:films])
        tasks[cell[0].replace("_", " ")].append(replace(card, failed=_failed(dataset, cell, films)))
    report = Report(
        name=dataset.resolve().name,
        scope=_scope(cells),
        tiles=_summary(seen, attempts),
        outcomes=_outcomes(attempts),
        speeds=_speeds(seen),
        moves=_moves(attempts),
        extras=extras,
        tasks=[TaskSection(title, cards) for title, cards in tasks.items()],
    )
    page = dataset / "report" / "index.html"
    write_atomic(page, report_page(report).encode(errors="replace"))  # a file name may hold bytes that are no UTF-8
    return page


def _scope(cells: Sequence[Cell]) -> str:
    names = ("task", "embodiment", "level", "alpha", "domain")
    counts = [len({c[i] for c in cells}) for i in range(len(names))]
    words = [f"{n} {name}{'' if n == 1 else 's'}" for n, name in zip(counts, names, strict=True)]
    return ", ".join(words) + f": {len(cells)} cell{'' if len(cells) == 1 else 's'}"


def _summary(seen: Sequence[Observation], rows: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    won = sum(r["outcome"] == "accepted" for r in rows)
    hours = sum(o.seconds for o in seen) / 3600
    spent = sum(float(r["seconds"]) for r in rows)
    values = {
        "episodes": f"{len(seen):,}",
        "attempts": f"{len(rows):,}",
        "attempts accepted": f"{100 * won / len(rows):.1f} %" if rows else "none",
        "of data": f"{hours:.2f} h" if hours >= 0.1 else f"{hours * 60:.1f} min",
        "physics steps": f"{sum(int(r['sim_steps']) for r in rows):,}",
        "spent on attempts": f"{spent / 3600:.2f} h" if spent >= 3600 else f"{spent:.1f} s",
    }
    if seen and spent:
        values["spent an episode"] = f"{spent / len(seen):.2f} s"
    return values


def _outcomes(rows: Sequence[Mapping[str, Any]]) -> list[Bar]:
    if not rows:
        return []
    won = sum(r["outcome"] == "accepted" for r in rows)
    lost = Counter(f"{r['stage']}: {r['reason']}".replace("_", " ") for r in rows if r["outcome"] != "accepted")
    return [Bar("accepted", won, True), *(Bar(label, n, False) for label, n in sorted(lost.items(), key=lambda x: (-x[1], x[0])))]


def _speeds(seen: Sequence[Observation]) -> list[SpeedPlot]:
    groups: dict[tuple[int, float], list[Observation]] = defaultdict(list)
    for o in seen:
        if o.spec.moving:
            groups[o.spec.level, o.spec.alpha].append(o)
    plots = []
    for (level, alpha), members in sorted(groups.items()):
        average, maximum = [o.average_speed for o in members], [o.maximum_speed for o in members]
        histogram = speed_histogram(average, maximum, alpha)
        plots.append(SpeedPlot(level, len(members), float(np.mean(average)), max(maximum), histogram))
    return plots


def _moves(rows: Sequence[Mapping[str, Any]]) -> list[Moves]:
    groups: dict[tuple[int, float], list[Mapping[str, Any]]] = defaultdict(list)
    for row in rows:
        groups[int(row["level"]), float(row["alpha"])].append(row)
    found = [_moved(f"level {level}, alpha {alpha:g}", members) for (level, alpha), members in sorted(groups.items())]
    return [moves for moves in found if moves.drawn]


def _moved(title: str, rows: Sequence[Mapping[str, Any]]) -> Moves:
    drawn, accepted = drawn_and_accepted(rows)
    return Moves(title, law(drawn), law(accepted))


def _failed(dataset: Path, cell: Cell, most: int) -> list[Strip]:
    """The last frames of attempts that failed in the cell, `most` pictures at most."""
    strips = []
    for path in sorted(failed_folder(dataset, RecipeCell(*cell).path).glob("*-*-*-*.jpg"))[:most]:
        stage, reason, slot, attempt = path.stem.split("-")
        words = f"{stage}: {reason}".replace("_", " ")
        strips.append(Strip([Figure(path.read_bytes(), f"failed: {words} (slot {slot}, attempt {attempt})")], 1))
    return strips


def _cell_card(cell: Cell, rows: Sequence[Mapping[str, Any]], shown: Sequence[Observation]) -> CellCard:
    task, embodiment, level, alpha, domain = cell
    strips, unseen = [], []
    for o in shown:
        try:
            shots = film(o.path, COLUMNS, FILM_WIDTH).shots
        except EpisodeError as error:  # an episode without a head camera still counts
            unseen.append(str(error))
            continue
        figures = [Figure(encode(s.rgb, quality=80), f"{'meeting, ' if s.meeting else ''}{s.time:.2f} s", s.meeting) for s in shots]
        strips.append(Strip(figures, COLUMNS))
    words = subtitle(EpisodeSpec(task, embodiment, level, alpha, domain, 0, 0)).replace("  |  ", " · ")
    moving = clip(shown[0].path) if strips else b""
    return CellCard(words, _outcomes(rows), _moved(words, rows), strips, unseen, moving)
