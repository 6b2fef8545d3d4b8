"""Frames of a cache that belong to a split, training or validation."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.data.slots.select import position_of
from training.puma.corpus.cache import Cache


@dataclass(eq=False)
class SplitFrames:
    """The frames (F,) of one cache that belong to a split, each with the first and last frame of
    its episode, and its episode."""

    cache: Cache
    frame: NDArray[np.int64]
    first: NDArray[np.int64]
    last: NDArray[np.int64]
    episode: NDArray[np.int64]

    @classmethod
    def of(cls, cache: Cache, episodes: Sequence[int]) -> "SplitFrames":
        """All frames of some episodes in which the expert acts."""
        chosen = np.asarray(episodes, np.int64)
        start, taught = cache.start[chosen], cache.taught[chosen]
        last = start + cache.length[chosen] - 1
        count = last + 1 - taught
        within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        return cls(
            cache,
            np.repeat(taught, count) + within,
            *(np.repeat(x, count) for x in (start, last, chosen)),
        )

    def __len__(self) -> int:
        return len(self.frame)


def split_episodes(cache: Cache, share: float) -> tuple[list[int], list[int]]:
    """Episodes for training and for validation: all looks of one physics episode on the same side,
    whatever else is there."""
    train, held = list[int](), list[int]()
    for number, row in enumerate(cache.rows):
        (held if position_of(row.physics_id) < share else train).append(number)
    if not train:
        train, held = held, []
    return train, held


def pooled(parts: Sequence[SplitFrames]) -> SplitFrames:
    """All frames of parts as one part, one part after another, without their images: batches of it
    take a fraction of the time."""
    caches = list({id(part.cache): part.cache for part in parts}.values())
    order = [id(cache) for cache in caches]
    frames = np.cumsum([0, *(cache.length.sum() for cache in caches)])
    episodes = np.cumsum([0, *(len(cache.rows) for cache in caches)])
    whole = replace(
        caches[0],
        rows=[row for cache in caches for row in cache.rows],
        arrays={
            name: np.concatenate([cache.arrays[name] for cache in caches])
            for name in caches[0].arrays
        },
    )
    places = [order.index(id(part.cache)) for part in parts]

    def moved(name: str, by: NDArray[np.int64]) -> NDArray[np.int64]:
        numbers = [getattr(part, name) + by[k] for part, k in zip(parts, places, strict=True)]
        return np.concatenate(numbers)

    return SplitFrames(
        whole,
        moved("frame", frames),
        moved("first", frames),
        moved("last", frames),
        moved("episode", episodes),
    )
