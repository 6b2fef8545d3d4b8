"""The report of a dataset: OUT/report/index.html, which needs no network."""

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pipeline.data.atomic import remove, write_atomic
from pipeline.data.dataset import Dataset, attempts_table
from pipeline.data.episode.file import EpisodeError, open_episode
from pipeline.data.keys import digest
from pipeline.data.recipe.model import Cell
from pipeline.data.slots.files import Rows
from pipeline.html import render_page
from pipeline.poses import Pixels

from .film_strip import BETWEEN, clip, encode, film, subtitle
from .summary import EpisodeFacts, Group, summarise

type SheetOf = Callable[[Path, Path], Pixels | None]
"""(dataset directory, episode relative to episodes/) -> image (H,W,3) uint8 RGB of its annotations,
or None where it has none."""

SHEETS = 12
"""Annotation sheets shown at most; one episode of a cell."""

COLUMNS, FILM_WIDTH = 6, 256
"""Frames of a film, and their width in pixels; six of them fill a page."""

MANY_CELLS = 40
"""From here on a page a task, with one film a cell."""

BROKEN = (EpisodeError, KeyError, OSError, ValueError)
"""What an episode that cannot be read raises; it still counts."""


class Figure(NamedTuple):
    """A JPEG with its caption, and whether it shows the meeting."""

    jpeg: bytes
    caption: str
    meeting: bool = False


def failed_folder(dataset: Path, cell: str) -> Path:
    """Where pictures of a cell's failures are kept: STAGE-REASON-SLOT-ATTEMPT.jpg."""
    return dataset / "report" / "failed" / cell


def refresh(dataset: Dataset, sheet_of: SheetOf) -> Path:
    """Update the report and return its first page. An episode that cannot be read is left out.
    Raises DatasetError for a directory without a recipe.
    """
    recipe = dataset.recipe()
    rows = dataset.present(recipe, "frames", "sha256")
    attempts = dataset.ask(lambda index: attempts_table(index, rows))
    places = zip(*(attempts[name].to_pylist() for name in Cell.__match_args__), strict=True)
    tried = defaultdict[Cell, list[int]](list)
    for number, place in enumerate(places):
        tried[Cell(*place)].append(number)
    seen = _observe(dataset, rows, recipe.fps)
    groups = [Group(c, seen.get(c, ()), attempts.take(tried[c])) for c in sorted({*seen, *tried})]
    sheets = list[Figure]()
    if (dataset.root / "annotations").is_dir():
        for group in [group for group in groups if group.episodes][:SHEETS]:
            episode = group.episodes[0].path.relative_to(dataset.episodes)
            sheet = sheet_of(dataset.root, episode)
            if sheet is not None:
                sheets.append(Figure(encode(sheet, quality=85), str(episode.with_suffix(""))))
    keys = {task: _key(dataset, rows, task) for task in recipe.tasks}
    return write_report(dataset.root, groups, sheets, keys)


def _observe(dataset: Dataset, rows: Rows, fps: int) -> Mapping[Cell, list[EpisodeFacts]]:
    """The accepted episodes; variants are opened."""
    of, tried = dataset.ask(lambda index: index.attempts(rows, "average_speed", "maximum_speed"))
    speeds = dict(zip(of.tolist(), tried, strict=True))  # the last attempt is the accepted one
    seen = defaultdict[Cell, list[EpisodeFacts]](list)
    for number in np.flatnonzero(rows.accepted).tolist():
        slot, seconds = rows.slots[number], rows.more["frames"][number].item() / fps
        path, (average, maximum) = dataset.episode(slot), speeds.get(number, (None, None))
        with suppress(*BROKEN):
            if average is None or maximum is None:
                with open_episode(path) as e:
                    average, maximum = e.meta.average_speed, e.meta.maximum_speed
            seen[slot.cell].append(EpisodeFacts(path, seconds, average, maximum))
    return seen


def _key(dataset: Dataset, rows: Rows, task: str) -> str:
    """The key of a task's page: its episodes and failure pictures."""
    mine = rows.where(np.array([cell.task == task for cell in rows.cells], bool)[rows.ranks])
    failed = sorted(p.name for p in failed_folder(dataset.root, task).rglob("*.jpg"))
    hashes = [sha256.hex() for sha256 in mine.more["sha256"]]
    return digest([[slot.path for slot in mine.slots], hashes, failed])


def write_report(
    dataset: Path,
    groups: Sequence[Group],
    sheets: Sequence[Figure] = (),
    keys: Mapping[str, str] | None = None,
) -> Path:
    """Write the report of a dataset and return its path. From MANY_CELLS cells on, every task
    has a page. A page whose key in `keys` is unchanged is not drawn again.
    """
    index, folder = dataset / "report" / "index.html", dataset / "report" / "tasks"
    name, tasks = dataset.resolve().name, defaultdict[str, list[Group]](list)
    for group in groups:
        tasks[group.cell.task].append(group)
    if len(groups) < MANY_CELLS:
        remove(folder)
        return _write(index, name, dataset, tasks, 2, sheets=sheets)
    for page in folder.glob("*.html"):
        if page.stem not in tasks:
            page.unlink()
    for task, mine in tasks.items():
        page, key = folder / f"{task}.html", (keys or {}).get(task, "")
        begin = page.read_bytes()[:1000] if page.is_file() else b""
        if not key or f"<!-- key: {key} -->".encode() not in begin:
            _write(page, f"{name}: {task.replace('_', ' ')}", dataset, {task: mine}, 1, key=key)
    return _write(index, name, dataset, tasks, 0, sheets=sheets)


def _write(
    page: Path,
    name: str,
    dataset: Path,
    tasks: Mapping[str, Sequence[Group]],
    films: int,
    **more: Any,
) -> Path:
    """Write a page with `films` films a cell, or links to the tasks' pages."""
    values: dict[str, Any] = {"sheets": (), "key": "", "cards": {}, "links": [], "columns": COLUMNS}
    for task, mine in tasks.items():
        title = task.replace("_", " ")
        if films:
            values["cards"][title] = [_card(dataset, group, films) for group in mine]
            continue
        outcomes = [name for group in mine for name in group.attempts["outcome"].to_pylist()]
        counts = (len(mine), len(outcomes), outcomes.count("accepted"))
        values["links"].append((f"tasks/{task}.html", title, *counts))
    values |= summarise([group for mine in tasks.values() for group in mine]) | more
    text = render_page("pipeline.report", "report.html", name=name, **values)
    # a file name may hold bytes that are no UTF-8
    write_atomic(page, text.encode(errors="replace"))
    return page


def _card(dataset: Path, group: Group, films: int) -> dict[str, Any]:
    """A cell: numbers, frames, first film, failures."""
    strips, unseen, failed = list[list[Figure]](), list[str](), list[Figure]()
    for episode in group.episodes[:films]:
        try:
            shots = film(episode.path, COLUMNS, FILM_WIDTH).shots
        except BROKEN as error:
            unseen.append(str(error))
            continue
        strips.append([Figure(encode(s.rgb, quality=80), s.caption, s.meeting) for s in shots])
    for path in sorted(failed_folder(dataset, group.cell.path).glob("*-*-*-*.jpg"))[:films]:
        stage, reason, slot, attempt = path.stem.replace("_", " ").split("-")
        caption = f"failed: {stage}: {reason} (slot {slot}, attempt {attempt})"
        failed.append(Figure(path.read_bytes(), caption))
    return {
        **summarise([group]),
        "subtitle": subtitle(group.cell).replace(BETWEEN, " · "),
        "strips": strips,
        "unseen": unseen,
        "failed": failed,
        "clip": clip(group.episodes[0].path) if strips else b"",
    }
