"""The frames of each step: a function of the seed and of the steps before, so that a run resumes
exactly where it stopped."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray


class Sampler:
    """Batches of (source, frame) from a mixture.

    Every source is gone through in a new random order each time, without repeats; which source a
    sample comes from is drawn by weight. `sizes` are the numbers of frames to choose from.
    """

    def __init__(
        self, sizes: Sequence[int], weights: Sequence[float], batch: int, seed: int
    ) -> None:
        self._sizes, self._batch, self._seed = tuple(sizes), batch, seed
        self._shares = np.asarray(weights, float) / sum(weights)
        self._step, self._drawn = 0, [0] * len(sizes)
        self._orders: dict[int, tuple[int, NDArray[np.int64]]] = {}

    def next(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Source (B,) and number within its frames (B,) of the next batch."""
        sources = self._rng(0, self._step).choice(len(self._sizes), self._batch, p=self._shares)
        places = np.empty(self._batch, np.int64)
        for i, source in enumerate(sources):
            lap, place = divmod(self._drawn[source], self._sizes[source])
            places[i] = self._order(int(source), lap)[place]
            self._drawn[source] += 1
        self._step += 1
        return sources, places

    def _order(self, source: int, lap: int) -> NDArray[np.int64]:
        held = self._orders.get(source)
        if held is None or held[0] != lap:
            held = lap, self._rng(1 + source, lap).permutation(self._sizes[source])
            self._orders[source] = held
        return held[1]

    def _rng(self, stream: int, number: int) -> np.random.Generator:
        return np.random.Generator(
            np.random.Philox(np.random.SeedSequence([self._seed, stream, number]))
        )

    def state(self) -> dict[str, Any]:
        """Where it stands, as JSON values."""
        return {"step": self._step, "drawn": list(self._drawn), "sizes": list(self._sizes)}

    def load(self, state: Mapping[str, Any]) -> None:
        """Resume from a state. Raises ValueError for one of other sources."""
        if list(state["sizes"]) != list(self._sizes):
            raise ValueError("the data is not that of the checkpoint")
        self._step, self._drawn = int(state["step"]), [int(n) for n in state["drawn"]]
