"""The mixture of datasets that a configuration names, and the preprocessing and the view of targets
that follow from it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.data.cameras import CAMERA_TYPES
from pipeline.data.dataset import Dataset
from pipeline.data.setup import Setup
from pipeline.data.setup.written import camera_name
from training.puma.config import Config
from training.puma.corpus.cache import Cache, Tell, open_cache
from training.puma.corpus.samples import commands_of
from training.puma.corpus.split import SplitFrames, split_episodes
from training.puma.errors import TrainError
from training.puma.preprocess import Preprocessing, Scale, colour_of, fit_scale
from training.puma.track import TargetView

STILL = 1e-4
"""The most (m, and of a quaternion) by which the pose of a camera that stands still may differ
between frames."""


@dataclass(eq=False)
class Corpus:
    """A mixture, cut into training and validation by physics episode, and the preprocessing that
    follows from it."""

    config: Config
    train: list[SplitFrames]
    validation: list[SplitFrames]
    preprocessing: Preprocessing
    weights: list[float]
    """Share of the samples of each part of `train`."""


def open_corpus(config: Config, tell: Tell = lambda text: None) -> Corpus:
    """Open (or make) the caches of a configuration. Raises TrainError for what cannot be trained
    on."""
    if not config.data.sources:
        raise TrainError(
            "data.sources is empty: give --data DATASET, or name datasets in the configuration"
        )
    caches = [open_cache(source, config, tell) for source in config.data.sources]
    for cache in caches[1:]:
        for name in ("fps", "names", "source_sizes"):
            if getattr(cache, name) != getattr(caches[0], name):
                raise TrainError(
                    f"{cache.path}: {name} {getattr(cache, name)} differs from"
                    f" {getattr(caches[0], name)}"
                )
    splits = [split_episodes(cache, config.data.validation) for cache in caches]
    train, weights = list[SplitFrames](), list[float]()
    for source, cache, (training, _) in zip(config.data.sources, caches, splits, strict=True):
        groups = _by_task(cache, training) if config.data.balance == "tasks" else [training]
        train += [SplitFrames.of(cache, group) for group in groups]
        weights += [source.weight / len(groups)] * len(groups)
    validation = [
        SplitFrames.of(cache, held) for cache, (_, held) in zip(caches, splits, strict=True) if held
    ]
    return Corpus(config, train, validation, preprocessing_of(config, caches, train), weights)


def _by_task(cache: Cache, episodes: Sequence[int]) -> list[list[int]]:
    """Episodes of each task."""
    found: dict[str, list[int]] = {}
    for number in episodes:
        found.setdefault(cache.rows[number].path.parts[0], []).append(number)
    return list(found.values())


def preprocessing_of(
    config: Config, caches: Sequence[Cache], train: Sequence[SplitFrames]
) -> Preprocessing:
    """The preprocessing of a configuration, scaled to the training frames."""
    data, model, first = config.data, config.model, caches[0]

    def scale(of: Callable[[SplitFrames], NDArray[Any]]) -> Scale:
        return fit_scale(
            np.concatenate([of(part) for part in train]),
            first.names,
            data.normalisation,
            data.floor,
        )

    setup = setup_of(config)
    return Preprocessing(
        fps=first.fps,
        embodiments=tuple(sorted({row.embodiment for cache in caches for row in cache.rows})),
        names=first.names,
        cameras=data.cameras,
        source_sizes=first.source_sizes,
        image_size=data.image_size,
        flow_size=data.flow_size,
        history=model.history,
        history_length=model.history_length,
        stride=model.stride,
        state=scale(lambda part: part.cache.arrays["state"][part.frame]),
        action=scale(
            lambda part: commands_of(part, np.arange(len(part)), config)[0].reshape(
                -1, len(first.names)
            )
        ),
        colour=colour_of(config),
        setup=setup,
        sight=sight_of(config, caches, setup) if model.track else None,
    )


def sight_of(config: Config, caches: Sequence[Cache], setup: Mapping[str, Any]) -> TargetView:
    """How the first camera sees targets. Raises TrainError if it moves, and if images are not kept
    at their own size."""
    assert config.model.track is not None
    name = config.data.cameras[0]
    size = caches[0].source_sizes[name]
    if tuple(config.data.image_size) != size:
        raise TrainError(
            f"model.track: crops images at their own size: set data.image_size to [{size[0]},"
            f" {size[1]}]"
        )
    poses = np.concatenate([np.asarray(cache.arrays["camera"]) for cache in caches])
    if np.ptp(poses, axis=0).max() > STILL:
        raise TrainError(
            f"model.track: {name} moves; choose a camera that stands still, and the domain clean"
        )
    if len({row.embodiment for cache in caches for row in cache.rows}) > 1:
        raise TrainError(
            "model.track: datasets are of several robots; choose one (where: embodiment=...)"
        )
    made = Setup.parse(setup)
    found = next((camera for camera in made.cameras if camera_name(camera) == name), name)
    fovy = CAMERA_TYPES[made.camera].fovy if isinstance(found, str) else found.fovy
    heights = np.concatenate(
        [cache.arrays["target"][:, 2][cache.arrays["free"]] for cache in caches]
    )
    return TargetView(
        size,
        fovy,
        tuple(poses[0].astype(float).tolist()),
        float(np.median(heights)),
        config.model.track.reach,
    )


def setup_of(config: Config) -> dict[str, Any]:
    """The setup of the first dataset with the cameras that the network sees, as the keys that
    differ from the defaults.

    Empty for data without a recipe."""
    sources = [Dataset(source.dataset) for source in config.data.sources]
    if not sources or not sources[0].manifest.exists():
        return {}
    setup = sources[0].setup()
    seen = [camera for camera in setup.cameras if camera_name(camera) in config.data.cameras]
    return setup.override(
        {"cameras": seen, "depth": False, "segmentation": False, "pointcloud": False}
    ).given()
