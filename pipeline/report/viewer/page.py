"""The viewer as files that open without a network, or, for a dataset of any size, a local
server.
"""

import json
import re
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from functools import cache
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from math import isfinite
from pathlib import Path
from threading import BoundedSemaphore
from typing import Any
from urllib.parse import urlsplit

from pipeline.data.atomic import exclusive, write_atomic
from pipeline.data.dataset import Dataset
from pipeline.data.episode.file import EpisodeError
from pipeline.data.errors import one_line
from pipeline.data.recipe.cells import Cell, Slot
from pipeline.data.slots.files import Paths
from pipeline.html import render_page

from .data import episode_data, thumbnail

PACKAGE = "pipeline.report.viewer"
PAGE, LIST = "index.html", "list.js"
OURS = (PAGE, LIST, "view.css", "view.js", "thumb_", "episode_", ".")
"""How the names of the viewer's files begin."""

FAILURES = 2000
PLACE = Cell.__match_args__
COLUMNS = (*PLACE, "slot", "attempt", "seed", "outcome")
WHY = ("stage", "reason", "detail", "conditions")


def fixed(name: str, dataset: Path, episodes: Sequence[Path], total: int) -> bytes:
    """A viewer file of no single episode."""
    if name == LIST:
        return list_script(dataset, episodes, total)
    if name == "view.js":
        return (files(PACKAGE) / "templates" / name).read_bytes()
    template = "view.html" if name == PAGE else name
    return render_page(PACKAGE, template, name=dataset.resolve().name).encode(errors="replace")


def list_script(dataset: Path, episodes: Sequence[Path], total: int) -> bytes:
    """list.js: the episodes with their targets' speeds (m/s), and at most FAILURES failed
    attempts, without opening a file.
    """
    paths, known, failed = Paths(Path()), dict[str, tuple[float | None, str]](), list[Any]()
    for row in Dataset(dataset).attempt_rows(*COLUMNS, *WHY, "average_speed"):
        slot = Slot(Cell(*(row[name] for name in PLACE)), row["slot"])
        speed, accepted = row.pop("average_speed"), row["outcome"] == "accepted"
        path = paths.episode(slot) if accepted else paths.failure(slot, row["attempt"])
        conditions = f" ({', '.join(row['conditions'])})" if row["conditions"] else ""
        why = "" if accepted else f"{row['stage']}: {row['reason']}{conditions}"
        known[path.as_posix()] = speed if speed and isfinite(speed) else None, why
        if not accepted and len(failed) < FAILURES:
            failed.append(row | {"seed": str(row["seed"]), "file": path.as_posix()})
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
    """At most `count` episodes, sorted, spread evenly over tasks, then levels."""
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
    """Write the viewer to `out` and return its page. Raises EpisodeError, Busy, OSError."""
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


NAMES = ("127.0.0.1", "localhost")
"""Hosts that a browser on this machine may name. A page of another site can have its name resolved
to this machine, and then names that (DNS rebinding)."""

SCRIPT = "text/javascript; charset=utf-8"
FIXED = {
    PAGE: "text/html; charset=utf-8",
    "view.css": "text/css; charset=utf-8",
    "view.js": SCRIPT,
    LIST: SCRIPT,
}
HEADERS = {
    "Content-Security-Policy": "frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "X-Content-Type-Options": "nosniff",
}
"""No page of another site may show or load a file of this server; index.html has the rest of its
policy itself."""

CONNECTIONS = 32
"""Requests that are answered at the same time; a further one is closed."""

SILENCE = 10.0
"""Seconds after which a connection that sends nothing is closed."""


def viewer_server(dataset: Path, episodes: Sequence[Path], port: int) -> ThreadingHTTPServer:
    """A server on loopback only; port 0 takes a free one. It refuses requests from other sites.
    Raises OSError for a taken port.
    """

    @cache
    def once(name: str) -> bytes:
        return fixed(name, dataset, episodes, len(episodes))

    def answer(name: str) -> tuple[bytes, str] | None:
        """The bytes of a file and their kind; None if there is no such file."""
        if name in FIXED:
            return once(name), FIXED[name]
        asked = re.fullmatch(r"(?:episode_(\d{1,9})\.js|thumb_(\d{1,9})\.jpg)", name)
        if not asked or (number := int(asked[1] or asked[2])) >= len(episodes):
            return None
        if asked[2]:
            return thumbnail(episodes[number]), "image/jpeg"
        return episode_script(number, episodes[number], dataset), SCRIPT

    class Handler(BaseHTTPRequestHandler):
        timeout = SILENCE

        def do_GET(self) -> None:
            if not _is_local(self.headers.get("Host"), self.headers.get("Origin")):
                return self.send_error(403, "asked for by another site")
            try:
                answered = answer(self.path.split("?")[0].lstrip("/") or PAGE)
            except (EpisodeError, OSError) as error:
                return self.send_error(500, one_line(error))
            if answered is None:
                return self.send_error(404)
            body, kind = answered
            self.send_response(200)
            values = HEADERS | {"Content-Type": kind, "Content-Length": str(len(body))}
            for name, value in values.items():
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, format: str, *args: object) -> None:
            """Log nothing: the terminal belongs to the user."""

    return _Server((NAMES[0], port), Handler)


def _is_local(host: str | None, origin: str | None) -> bool:
    """Whether a request is to this machine and from no other site."""
    named = urlsplit(f"//{host or ''}").hostname
    return named in NAMES and (origin is None or urlsplit(origin).hostname in NAMES)


class _Server(ThreadingHTTPServer):
    """Bounded threads; clients may leave."""

    daemon_threads, request_queue_size = True, 128

    def __init__(self, *given: Any) -> None:
        self._free = BoundedSemaphore(CONNECTIONS)
        super().__init__(*given)

    def process_request(self, request: Any, client_address: Any) -> None:
        if self._free.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)
