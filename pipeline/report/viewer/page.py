"""The viewer as files that open without a network: page, plotly's own script, a list of episodes,
and one file an episode."""

import base64
import gzip
import json
from collections import Counter
from collections.abc import Callable, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from pipeline.data.atomic import write_atomic
from pipeline.html import render_page
from pipeline.report.viewer.data import episode_data, failures, listing

PAGE, LIST, PLOTLY = "index.html", "list.js", "plotly.min.js"
TEMPLATES = files("pipeline.report.viewer") / "templates"
Progress = Callable[[int], object] | None


def page(name: str) -> bytes:
    """The page of a dataset of that name."""
    script = (TEMPLATES / "view.js").read_text()
    return render_page("pipeline.report.viewer", "view.html", name=name, script=script).encode(
        errors="replace"
    )


def plotly_script() -> bytes:
    """plotly.min.js: the script that plotly ships, packed to two fifths of its size."""
    from plotly.offline import get_plotlyjs

    packed = gzip.compress(get_plotlyjs().encode(), mtime=0)
    return _script("PLOTLY = ", base64.b64encode(packed).decode(), "")


def list_script(dataset: Path, episodes: Sequence[Path], total: int) -> bytes:
    """list.js: the episodes on the wall, and the attempts that failed; `total` is how many episodes
    the dataset has."""
    values = {
        "episodes": [listing(path, dataset) for path in episodes],
        "failures": failures(dataset),
        "total": total,
    }
    return _script("DOMINO = ", values, "")


def episode_script(number: int, path: Path, dataset: Path) -> bytes:
    """episode_<number>.js: one episode; loading it calls `episodeLoaded` of the page."""
    return _script(f"episodeLoaded({number}, ", episode_data(path, dataset), ")")


def _script(before: str, values: Any, after: str) -> bytes:
    text = json.dumps(values, separators=(",", ":"), allow_nan=False)
    return f"{before}{text}{after};\n".encode()


def choose(episodes: Sequence[Path], count: int) -> list[Path]:
    """At most `count` episodes, sorted: tasks take equal parts as far as they reach, within them
    levels do, and those are spread evenly over their episodes."""
    levels: dict[tuple[str, str], list[Path]] = {}
    for path in sorted(episodes):
        task, _, level = path.parts[-5:-2]
        levels.setdefault((task, level), []).append(path)
    parts = dict.fromkeys(levels, 0)
    of_task = Counter[str]()
    of_level = Counter[str]()
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
    dataset: Path, episodes: Sequence[Path], out: Path, total: int, progress: Progress = None
) -> Path:
    """Write the viewer of these episodes to the directory `out` and return its page. Raises
    EpisodeError, OSError."""
    out.mkdir(parents=True, exist_ok=True)
    for old in out.glob("episode_*.js"):
        old.unlink()
    for number, path in enumerate(episodes):
        write_atomic(out / f"episode_{number}.js", episode_script(number, path, dataset))
        if progress is not None:
            progress(1)
    write_atomic(out / LIST, list_script(dataset, episodes, total))
    write_atomic(out / PLOTLY, plotly_script())
    write_atomic(out / PAGE, page(dataset.resolve().name))
    return out / PAGE
