"""Bring one stage of some episodes up to date: what is valid stays, what is missing, stale or corrupt is computed.

The unit is one stage of one episode; it reads the episode and writes one file, so units share nothing and may run anywhere, in any
order, killed at any time. A prefetch thread reads, checks and decodes the next episodes while the current one is computed.
"""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.annotate.keys import AnnotateError, annotation_key
from pipeline.annotate.stage import NotReady, Result, Stage, directory_of
from pipeline.annotate.store import CorruptAnnotation, annotation_path, check_entry, write_entry
from pipeline.episode import EpisodeError, open_episode

AHEAD = 2
"""Episodes the prefetch thread may be ahead; bounds memory to three decoded episodes a worker."""


@dataclass(frozen=True)
class Outcome:
    """What became of one stage of one episode. `action` is computed, reused, failed or waiting; `state` is what was found
    (valid, missing, stale, corrupt, or unknown where the episode could not be read); `reason` is one line."""

    episode: str
    action: str
    state: str
    reason: str
    frames: int = 0


@dataclass(eq=False)
class _Work:
    key: str
    state: str
    inputs: dict[str, Any]
    data: Any
    frames: int


_REASONS = {
    "missing": "not annotated yet",
    "stale": "its frames, masks or prompt changed since",
    "corrupt": "its file is damaged",
    "valid": "key and content match",
}
_EPISODE_FAULTS = (EpisodeError, AnnotateError, CorruptAnnotation, OSError)


def process(stage: Stage, dataset: Path, episodes: Sequence[Path], dry_run: bool = False) -> Iterator[Outcome]:
    """Bring one stage of the given episodes up to date, in order; yields one outcome each. `dry_run` computes and writes nothing.

    Raises AnnotateError where a result cannot be written (a full disk stops the run; nothing is half-written).
    """
    directory = directory_of(stage)
    compute: Callable[[Any], Result] | None = None
    for episode, found in _prefetched(lambda e: _prepare(stage, dataset, directory, e, dry_run), episodes):
        if isinstance(found, Outcome):
            yield found
            continue
        if compute is None:
            compute = stage.start()
        try:
            result = compute(found.data)
        except _EPISODE_FAULTS as error:
            yield Outcome(str(episode), "failed", found.state, str(error))
            continue
        path = annotation_path(dataset, directory, episode)
        try:
            write_entry(path, found.key, result.arrays, {**result.attributes, "inputs": found.inputs}, result.compressed)
        except OSError as error:
            raise AnnotateError(f"cannot write {path}: {error.strerror or error}") from error
        yield Outcome(str(episode), "computed", found.state, _REASONS[found.state], found.frames)


def _prepare(stage: Stage, dataset: Path, directory: str, episode: Path, dry_run: bool) -> Outcome | _Work:
    name, state = str(episode), "unknown"
    try:
        with open_episode(Path(dataset) / "episodes" / episode) as e:
            reading = stage.read(e, dataset, episode)
            key = annotation_key(stage.name, stage.version, stage.parameters(), reading.inputs)
            state = check_entry(annotation_path(dataset, directory, episode), key)
            if state == "valid":
                return Outcome(name, "reused", state, _REASONS[state])
            if dry_run:
                return Outcome(name, "computed", state, _REASONS[state], len(e))
            return _Work(key, state, dict(reading.inputs), reading.decode(), len(e))
    except NotReady as error:
        return Outcome(name, "waiting", "missing", str(error))
    except _EPISODE_FAULTS as error:
        return Outcome(name, "failed", state, str(error))


def _prefetched[T](prepare: Callable[[Path], T], episodes: Sequence[Path]) -> Iterator[tuple[Path, T]]:
    """`(episode, prepare(episode))` in order, prepared on one thread at most AHEAD episodes before they are asked for."""
    pending: deque[tuple[Path, Future[T]]] = deque()
    rest = iter(episodes)
    with ThreadPoolExecutor(1) as pool:
        try:
            while True:
                while len(pending) <= AHEAD and (episode := next(rest, None)) is not None:
                    pending.append((episode, pool.submit(prepare, episode)))
                if not pending:
                    return
                episode, future = pending.popleft()
                yield episode, future.result()
        finally:
            for _, future in pending:
                future.cancel()
