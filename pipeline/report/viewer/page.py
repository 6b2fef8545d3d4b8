"""The viewer as files that open without a network: page, style, script, a list of episodes, and an
image and a script of every episode."""

import json
import re
from collections import Counter
from collections.abc import Callable, Sequence
from importlib.resources import files
from math import isfinite
from pathlib import Path
from typing import Any

from pipeline.data.atomic import exclusive, write_atomic
from pipeline.data.dataset import Dataset
from pipeline.data.recipe.cells import Cell, Slot
from pipeline.data.slots.files import Paths
from pipeline.html import render_page
from pipeline.report.viewer.data import episode_data, thumbnail

PACKAGE = "pipeline.report.viewer"
PAGE, LIST = "index.html", "list.js"
OURS = (PAGE, LIST, "view.css", "view.js", "thumb_", "episode_", ".")
"""How the names of the viewer's files begin."""

FAILURES = 2000
COLUMNS = ("task", "embodiment", "level", "alpha", "domain", "slot", "attempt", "seed", "outcome")
WHY = ("stage", "reason", "detail", "conditions")


def fixed(name: str, dataset: Path, episodes: Sequence[Path], total: int) -> bytes:
    """A file of the viewer that belongs to no single episode: PAGE, view.css, view.js or LIST."""
    if name == LIST:
        return list_script(dataset, episodes, total)
    if name == "view.js":
        return (files(PACKAGE) / "templates" / name).read_bytes()
    template = "view.html" if name == PAGE else name
    return render_page(PACKAGE, template, name=dataset.resolve().name).encode(errors="replace")


def list_script(dataset: Path, episodes: Sequence[Path], total: int) -> bytes:
    """list.js: the episodes on the wall, by file, with the speed (m/s) of each target, and the
    failed attempts, FAILURES of them at most.

    No episode is opened. `total` is how many episodes the dataset has."""
    attempts = Dataset(dataset).attempt_rows(*COLUMNS, *WHY, "average_speed")
    paths, known, failed = Paths(Path()), dict[str, tuple[float | None, str]](), list[Any]()
    for row in attempts:
        cell = Cell(*(row[name] for name in ("task", "embodiment", "level", "alpha", "domain")))
        slot, accepted = Slot(cell, row["slot"]), row["outcome"] == "accepted"
        file = paths.episode(slot) if accepted else paths.failure(slot, row["attempt"])
        conditions = f" ({', '.join(row['conditions'])})" if row["conditions"] else ""
        why = "" if accepted else f"{row['stage']}: {row['reason']}{conditions}"
        speed = row.pop("average_speed")
        known[file.as_posix()] = speed if speed and isfinite(speed) else None, why
        if not accepted and len(failed) < FAILURES:
            failed.append(row | {"seed": str(row["seed"]), "file": file.as_posix()})
    names = [path.relative_to(dataset).as_posix() for path in episodes]
    shown = [(name, *known.get(re.sub(r"_v\d+(?=\.)", "", name), (None, ""))) for name in names]
    return _call("listLoaded", {"episodes": shown, "failures": failed, "total": total})


def episode_script(number: int, path: Path, dataset: Path) -> bytes:
    """episode_<number>.js: one episode; loading it calls `episodeLoaded` of the page."""
    return _call("episodeLoaded", number, episode_data(path, dataset))


def _call(function: str, *values: Any) -> bytes:
    texts = [json.dumps(value, separators=(",", ":"), allow_nan=False) for value in values]
    return f"{function}({', '.join(texts)});\n".encode()


def choose(episodes: Sequence[Path], count: int) -> list[Path]:
    """At most `count` episodes, sorted: tasks take equal parts as far as they reach, within them
    levels do, and those are spread evenly over their episodes."""
    levels: dict[tuple[str, str], list[Path]] = {}
    for path in sorted(episodes):
        task, _, level = path.parts[-5:-2]
        levels.setdefault((task, level), []).append(path)
    parts = dict.fromkeys(levels, 0)
    of_task, of_level = Counter[str](), Counter[str]()
    for _ in range(min(count, len(episodes))):
        left = (name for name in levels if parts[name] < len(levels[name]))
        poorest = min(left, key=lambda name: (of_task[name[0]], parts[name], of_level[name[1]]))
        parts[poorest] += 1
        of_task[poorest[0]] += 1
        of_level[poorest[1]] += 1
    return sorted(
        mine[i * len(mine) // parts[name]]
        for name, mine in levels.items()
        for i in range(parts[name])
    )


def write_viewer(
    dataset: Path,
    episodes: Sequence[Path],
    out: Path,
    total: int,
    progress: Callable[[int], object] = lambda _: None,
) -> Path:
    """Write the viewer of these episodes to the directory `out` and return its page. Raises
    EpisodeError, Busy, OSError."""
    out.mkdir(parents=True, exist_ok=True)
    with exclusive(out):
        for old in (*out.glob("episode_*.js"), *out.glob("thumb_*.jpg")):
            old.unlink()
        for number, path in enumerate(episodes):
            write_atomic(out / f"episode_{number}.js", episode_script(number, path, dataset))
            write_atomic(out / f"thumb_{number}.jpg", thumbnail(path))
            progress(1)
        for name in (LIST, "view.css", "view.js", PAGE):
            write_atomic(out / name, fixed(name, dataset, episodes, total))
    return out / PAGE
