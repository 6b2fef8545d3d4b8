"""Bring one stage of some episodes up to date. A thread prepares the next episodes meanwhile."""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.data.dataset import Dataset, DatasetError
from pipeline.data.episode.file import EpisodeError, open_episode
from pipeline.data.intact import check_bytes
from pipeline.data.slots.annotations import CorruptAnnotation, annotation_path

from .stage import AnnotateError, NotReady, Stage, StageResult, annotation_key, directory_of
from .store import check_entry, write_entry

AHEAD = 2
"""Episodes the prefetch thread may be ahead; bounds memory to three decoded episodes a worker."""

_REASONS = {
    "missing": "not annotated yet",
    "stale": "its frames, masks or prompt changed since",
    "corrupt": "its file is damaged",
    "valid": "key and content match",
}
_EPISODE_FAULTS = (DatasetError, EpisodeError, AnnotateError, CorruptAnnotation, OSError)


@dataclass(frozen=True)
class StageOutcome:
    """`action` is computed, reused, failed or waiting; `state` may be unknown besides
    `_REASONS`."""

    episode: str
    action: str
    state: str
    reason: str
    frames: int = 0


@dataclass(eq=False)
class _Work:
    key: str
    outcome: StageOutcome
    inputs: dict[str, Any]
    data: Any


class StageWorker:
    def __init__(self, stage: Stage, dataset: Path, dry_run: bool = False) -> None:
        self.stage, self.dataset, self.dry_run = stage, Path(dataset), dry_run
        self.directory = directory_of(stage)
        self._compute: Callable[[Any], StageResult] | None = None

    def run(self, episodes: Sequence[Path]) -> Iterator[StageOutcome]:
        for episode, prepared in _prefetch(self._prepare, episodes):
            if isinstance(prepared, _Work):
                self._finish(episode, prepared)
                prepared = prepared.outcome
            yield prepared

    def _prepare(self, episode: Path) -> StageOutcome | _Work:
        name, state, stage = str(episode), "unknown", self.stage
        try:
            check_bytes(Dataset(self.dataset), episode)
            with open_episode(self.dataset / "episodes" / episode) as e:
                reading = stage.read(e, self.dataset, episode)
                key = annotation_key(stage.name, stage.version, stage.parameters(), reading.inputs)
                state = check_entry(annotation_path(self.dataset, self.directory, episode), key)
                if state == "valid":
                    return StageOutcome(name, "reused", state, _REASONS[state])
                outcome = StageOutcome(name, "computed", state, _REASONS[state], len(e))
                if self.dry_run:
                    return outcome
                return _Work(key, outcome, dict(reading.inputs), reading.decode())
        except NotReady as error:
            return StageOutcome(name, "waiting", "missing", str(error))
        except _EPISODE_FAULTS as error:
            return StageOutcome(name, "failed", state, str(error))

    def start(self) -> Callable[[Any], StageResult]:
        if self._compute is None:
            self._compute = self.stage.start()
        return self._compute

    def _finish(self, episode: Path, work: _Work) -> None:
        result = self.start()(work.data)
        path = annotation_path(self.dataset, self.directory, episode)
        attributes = {**result.attributes, "inputs": work.inputs}
        write_entry(path, work.key, result.arrays, attributes, result.compressed)


def _prefetch[T](
    prepare: Callable[[Path], T], episodes: Sequence[Path]
) -> Iterator[tuple[Path, T]]:
    pending, rest = deque[tuple[Path, Future[T]]](), iter(episodes)
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
