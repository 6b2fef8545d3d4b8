"""Follows targets through all frames of a corpus with the finder; adds the tools, the time since
the touch, and the arms that act."""

from collections.abc import Callable, Container, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from pipeline.data.keys import digest
from pipeline.data.names import SIDES
from training.puma import checkpoint
from training.puma.corpus.cache import Cache
from training.puma.corpus.mixture import Corpus
from training.puma.finding.learning import in_order, train_finder
from training.puma.finding.tools import tools_of
from training.puma.model.puma import Puma
from training.puma.track import CHOICES, TargetView, Tracks, aims, track_numbers

MOVED = 0.1
"""Range (rad) of a joint above which its arm acts in an episode."""

FRAMES = 128
"""Frames that are searched at once."""


def follow(
    corpus: Corpus,
    network: Puma,
    trained: bool = False,
    quiet: bool = True,
    kept: Path | None = None,
) -> Corpus:
    """The corpus with arrays for every frame: `track` (N,M), those of all bodies, `tools` (N,2,3)
    m, `choice` (N,), which of CHOICES acts, and `held` (N,) s since the touch.

    Trains the finder of the network, and fits the scale of what is found, unless they are `trained`
    already. A trained finder is written to the file `kept`, and read from there if it is of the
    same corpus and configuration. The same for the same corpus, configuration, torch and processor.
    Raises TrainError if no image shows the target before it is touched.
    """
    finder, sight = network.finder, corpus.preprocessing.sight
    if finder is None or sight is None:
        return corpus
    if not trained:
        settings = corpus.config.model_dump(mode="json")
        settings["train"] = corpus.config.train.seed
        made_of = digest([settings, corpus.preprocessing.digest])
        if not checkpoint.load_finder(finder, kept, made_of):
            train_finder(network, sight, corpus, quiet)
            checkpoint.save_finder(finder, kept, made_of)
        # what comes after is the same, whether the finder was trained or read
        torch.manual_seed(corpus.config.train.seed)
    finder.requires_grad_(False).eval()
    parts = [*corpus.train, *corpus.validation]
    seen = {id(part.cache): set[int]() for part in parts}
    for part in parts:
        seen[id(part.cache)].update(part.episode.tolist())

    def tracks(cache: Cache) -> NDArray[np.float32]:
        return _find_tracks(network, sight, cache, seen[id(cache)])

    return with_tracks(corpus, network, tracks, trained)


def with_tracks(
    corpus: Corpus,
    network: Puma,
    tracks: Callable[[Cache], NDArray[np.float32]],
    trained: bool = False,
) -> Corpus:
    """The corpus with the arrays of `follow`, of which `tracks` gives the first for the frames of a
    cache."""
    parts, settings = [*corpus.train, *corpus.validation], corpus.config.model.track
    caches = {id(part.cache): part.cache for part in parts}
    followed = {key: _add_arrays(cache, tracks(cache)) for key, cache in caches.items()}
    train, validation = (
        [replace(part, cache=followed[id(part.cache)]) for part in some]
        for some in (corpus.train, corpus.validation)
    )
    corpus = replace(corpus, train=train, validation=validation)
    if not trained and network.aim_scale is not None and settings is not None:
        several, near = settings.bodies, settings.near
        seen = [
            aims(arrays["track"][part.frame], arrays["tools"][part.frame], several, near)
            for part in train
            for arrays in [part.cache.arrays]
        ]
        network.aim_scale.fit(torch.from_numpy(np.concatenate(seen)))
    return corpus


def _find_tracks(
    network: Puma, sight: TargetView, cache: Cache, episodes: Container[int]
) -> NDArray[np.float32]:
    """What the finder sees in all frames (N,M) of a cache, zeros in other episodes than these. Each
    is followed from its first frame, by its first sentence."""
    finder, images = network.finder, cache.images(network.config.data.cameras[0])
    assert finder is not None
    settings = finder.settings
    numbers = settings.bodies * track_numbers(settings.points)
    out = np.zeros((int(cache.length.sum()), numbers), np.float32)
    blocks = [
        (number, first, min(first + FRAMES, start + length))
        for number, (start, length) in enumerate(zip(cache.start, cache.length, strict=True))
        if number in episodes
        for first in range(start, start + length, FRAMES)
    ]
    tracks = Tracks(sight, settings.bodies, settings.memory)
    decoded = in_order(lambda block: images[blocks[block][1] : blocks[block][2]], len(blocks))
    for (number, first, last), shown in zip(blocks, decoded, strict=True):
        if first == cache.start[number]:
            tracks = Tracks(sight, settings.bodies, settings.memory)
        ids = network.words.ids(cache.rows[number].instructions[:1])
        points, errors = finder.find(shown, ids.repeat(last - first, 1))
        times = cache.arrays["time"][first:last]
        for place, time, *seen in zip(range(first, last), times, points, errors, strict=True):
            tracks.see(float(time), *seen)
            out[place] = tracks.numbers
    return out


def _add_arrays(cache: Cache, tracks: NDArray[np.float32]) -> Cache:
    """The cache with `track`, `tools`, `held` and `choice`."""
    arrays, choices, held = cache.arrays, list[NDArray[np.int64]](), list[NDArray[np.float32]]()
    for start, length, taught in zip(cache.start, cache.length, cache.taught, strict=True):
        choices.append(
            np.repeat(choice_of(cache.names, arrays["action"][taught : start + length]), length)
        )
        held.append(since_touch(*(arrays[n][start : start + length] for n in ("time", "free"))))
    tools = tools_of(cache.rows[0].embodiment, arrays["state"])
    added = {"track": tracks, "tools": tools, "held": np.concatenate(held)}
    return replace(cache, arrays={**arrays, **added, "choice": np.concatenate(choices)})


def since_touch(times: NDArray[Any], free: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Seconds (T,) since the target was first touched, 0 before, for times (T,) s of an episode."""
    touched = np.flatnonzero(~free)
    first = times[touched[0]] if len(touched) else np.inf
    return np.maximum(times - first, 0.0).astype(np.float32)


def choice_of(names: Sequence[str], actions: NDArray[Any]) -> int:
    """Which of CHOICES moves in the actions (T,A) of an episode; both if none does."""
    if len(actions) == 0:
        return len(CHOICES) - 1
    arms = [
        name
        for name, far in zip(names, np.ptp(actions, axis=0) > MOVED, strict=True)
        if far and not name.endswith("gripper")
    ]
    moved = [any(name.startswith(side) for name in arms) for side in SIDES]
    return moved.index(True) if sum(moved) == 1 else len(CHOICES) - 1
