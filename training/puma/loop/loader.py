"""Batches as tensors, made by a thread while the network works on the one before."""

import queue
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from training.puma.config import Config
from training.puma.corpus.mixture import Corpus
from training.puma.corpus.sampler import Sampler
from training.puma.corpus.samples import Arrays, mixed_batch
from training.puma.corpus.split import pooled
from training.puma.finding.tools import Disturbance
from training.puma.model.inputs import Inputs, inputs_of
from training.puma.model.puma import IGNORED, Targets
from training.puma.model.text import Tokenizer

AHEAD = 2
"""Batches that are made before they are asked for."""

LOADING = "puma loader"
"""Name of the thread."""


@dataclass(eq=False)
class Batch:
    """A batch, and where the sampler stood after it."""

    inputs: Inputs
    targets: Targets
    sampler: dict[str, Any]


@dataclass(frozen=True)
class Share:
    """Which rows of every batch this process works on: `rank`, `rank + world`, ..."""

    rank: int = 0
    world: int = 1


class Loader:
    """Endless batches of a corpus. Close it to end its thread."""

    def __init__(self, corpus: Corpus, words: Tokenizer, share: Share | None = None) -> None:
        config = corpus.config
        self._corpus, self._words, self._share = corpus, words, share or Share()
        sizes = [len(part) for part in corpus.train]
        self._parts, self._starts = corpus.train, np.zeros(len(sizes), np.int64)
        if not config.model.looks and config.model.history == config.model.world == "none":
            self._parts, self._starts = [pooled(corpus.train)], np.cumsum([0, *sizes[:-1]])
        self.sampler = Sampler(sizes, corpus.weights, config.train.batch, config.train.seed)
        self._ready: queue.Queue[Batch | BaseException] = queue.Queue(AHEAD)
        self._closed = threading.Event()
        self._thread: threading.Thread | None = None

    def __iter__(self) -> Iterator[Batch]:
        """Begin. Raises what went wrong on the thread."""
        self._thread = threading.Thread(target=self._work, name=LOADING, daemon=True)
        self._thread.start()
        while True:
            found = self._ready.get()
            if isinstance(found, BaseException):
                raise found
            yield found

    def close(self) -> None:
        """End the thread, and wait for it: a process that ends while a thread is inside torch
        aborts."""
        self._closed.set()
        if self._thread is not None:
            self._thread.join()

    def _work(self) -> None:
        try:
            while not self._closed.is_set():
                self._put(self.make())
        except Exception as error:  # noqa: BLE001 (raised again where batches are taken)
            self._put(error)

    def _put(self, item: "Batch | BaseException") -> None:
        while not self._closed.is_set():
            try:
                return self._ready.put(item, timeout=0.2)
            except queue.Full:
                continue

    def make(self) -> Batch:
        """The next batch, here and now."""
        config, corpus = self._corpus.config, self._corpus
        step = self.sampler.state()["step"]
        sources, places = self.sampler.next()
        rows = slice(self._share.rank, None, self._share.world)
        draw = sources[rows], places[rows] + self._starts[sources[rows]]
        if len(self._parts) == 1:
            draw = np.zeros_like(draw[0]), draw[1]
        arrays, texts = mixed_batch(self._parts, draw, config, corpus.preprocessing)
        seed = [config.train.seed, step, self._share.rank]
        if config.train.shift:
            shift_images(arrays, config.train.shift, seed)
        if config.train.disturb:
            Disturbance(config.train.disturb, config, corpus.preprocessing).apply(
                arrays, generator(seed)
            )
        return Batch(
            inputs_of(arrays, texts, config, self._words),
            targets_of(arrays, config),
            self.sampler.state(),
        )


def targets_of(arrays: Arrays, config: Config) -> Targets:
    """Targets of a batch; those of `choice` after `model.choosing` are IGNORED, touches that are
    older than `model.touching` are not `judged`."""
    names = [field.name for field in fields(Targets) if field.name in arrays]
    found = {name: torch.from_numpy(arrays[name]) for name in names}
    if config.model.choosing is not None:
        late = torch.from_numpy(arrays["clock"] > config.model.choosing)
        found["choice"] = found["choice"].masked_fill(late, IGNORED)
    if config.model.touching is not None:
        found["judged"] = torch.from_numpy(arrays["held"] <= config.model.touching)
    return Targets(**found)


def generator(seed: Sequence[int]) -> np.random.Generator:
    """The random numbers of one batch."""
    return np.random.Generator(np.random.Philox(np.random.SeedSequence(list(seed))))


def shift_images(arrays: Arrays, most: int, seed: Sequence[int]) -> None:
    """Move the views of each sample by up to `most` px, edges repeated. Flow maps stay: motion does
    not change by it."""
    rng = generator(seed)
    names = [name for name in arrays if name.startswith("image_")]
    moves = rng.integers(-most, most + 1, (len(arrays[names[0]]), 2))
    for name in names:
        arrays[name] = np.stack(
            [_shift_image(image, *move) for image, move in zip(arrays[name], moves, strict=True)]
        )


def _shift_image(image: NDArray[np.uint8], down: int, right: int) -> NDArray[np.uint8]:
    rows = np.clip(np.arange(image.shape[0]) - down, 0, image.shape[0] - 1)
    columns = np.clip(np.arange(image.shape[1]) - right, 0, image.shape[1] - 1)
    return image[rows][:, columns]


def parts_of(batch: Batch, parts: int) -> list[Batch]:
    """A batch cut into equal parts."""
    if parts == 1:
        return [batch]
    size = len(batch.inputs) // parts
    cut = [slice(i * size, (i + 1) * size) for i in range(parts)]
    return [
        Batch(_slice(batch.inputs, rows), _slice(batch.targets, rows), batch.sampler)
        for rows in cut
    ]


def _slice[T](values: T, rows: slice) -> T:
    return type(values)(
        **{name: None if v is None else v[rows] for name, v in vars(values).items()}
    )
