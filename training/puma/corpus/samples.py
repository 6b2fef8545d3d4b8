"""Batches for the network: what happened until a frame, what was commanded after it, and which of
that exists."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.data.cameras import CAMERA_TYPES
from pipeline.data.dataset import Dataset
from pipeline.data.setup import Setup
from pipeline.data.setup.written import camera_name
from pipeline.data.slots.select import position_of
from training.puma.config import Config
from training.puma.corpus.cache import Cache, Tell, open_cache
from training.puma.errors import TrainError
from training.puma.model.oracle import oracle_numbers
from training.puma.preprocess import Preprocessing, Scale, colour_of, fit_scale
from training.puma.track import TargetView

type Arrays = dict[str, NDArray[Any]]

STILL = 1e-4
"""The most (m, and of a quaternion) by which the pose of a camera that stands still may differ
between frames."""


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


def split_episodes(cache: Cache, share: float) -> tuple[list[int], list[int]]:
    """Episodes for training and for validation: all looks of one physics episode on the same side,
    whatever else is there."""
    train, held = list[int](), list[int]()
    for number, row in enumerate(cache.rows):
        (held if position_of(row.physics_id) < share else train).append(number)
    if not train:
        train, held = held, []
    return train, held


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
            lambda part: _commands(part, np.arange(len(part)), config)[0].reshape(
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


def batch_of(
    part: SplitFrames, places: NDArray[np.int64], config: Config, preprocessing: Preprocessing
) -> Arrays:
    """The arrays of B frames of one part.

    `image_<camera>` (B,h,w,3) uint8, where the network looks at them; `past` (B,h,fh,fw,3) uint8,
    oldest first, and `past_time` (B,h) s, at most 0; `state` (B,A) and `action` (B,K,A) normalised;
    `clock` (B,) s; `world` (B,N,D) and `oracle` (B,F). `action_valid` (B,K) is False past the last
    frame of the episode, `world_valid` (B,N) also where the target was not seen. `row` (B,) numbers
    the episodes. Where the target is tracked: `track` (B,2K+2), `tools` (B,2,3) m, `free` (B,),
    whether the robot has not touched it yet, `held` (B,) s since it did, 0 before, and `choice`
    (B,), the number of the arms that act.

    History before the first frame is the first frame, whose flow map is black, as at the start of
    an episode that is played.
    """
    model, arrays = config.model, part.cache.arrays
    frame, first, last = part.frame[places, None], part.first[places, None], part.last[places, None]
    now = frame[:, 0]
    cameras = config.data.cameras if model.looks else ()
    out: Arrays = {f"image_{camera}": arrays[f"image_{camera}"][now] for camera in cameras}
    commands, out["action_valid"] = _commands(part, places, config)
    out["action"] = preprocessing.action.forward(commands)
    out["state"] = preprocessing.state.forward(arrays["state"][now])
    out["clock"] = np.asarray(arrays["time"][now], np.float32)
    if model.history != "none":
        ages = np.arange(model.history_length)[::-1] * model.stride + (
            model.stride if model.history == "frames" else 0
        )
        at = np.maximum(frame - ages, first)
        out["past"] = arrays["past"][at]
        out["past_time"] = np.asarray(arrays["time"][at] - arrays["time"][now][:, None], np.float32)
    if model.track:
        out |= {
            name: np.asarray(arrays[name][now])
            for name in ("track", "tools", "free", "choice", "held")
        }
    if model.oracle:
        at = np.minimum(frame + np.arange(model.chunk + 1), last)
        out["oracle"] = oracle_numbers(arrays["target"][at], part.cache.fps)
    if model.world != "none":
        later = frame + model.stride * np.arange(1, model.world_queries + 1)
        at = np.minimum(later, last)
        out["world"] = arrays["world"][at].astype(np.float32)
        out["world_valid"] = (later <= last) & arrays["valid"][at]
    out["row"] = part.episode[places]
    return out


def _commands(
    part: SplitFrames, places: NDArray[np.int64], config: Config
) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    """Actions (B,K,A) of the chunks that begin at B frames, and which of them exist (B,K)."""
    arrays, names = part.cache.arrays, part.cache.names
    frame, first, last = part.frame[places, None], part.first[places, None], part.last[places, None]
    ahead = frame + np.arange(config.model.chunk)
    # the last recorded action belongs to the interval after the last frame: nothing was measured
    # there
    exist = ahead < np.maximum(last, first + 1)
    commands = arrays["action"][np.minimum(ahead, last)]
    if config.data.grippers == "binary":
        commands = np.where(grippers_of(names), commands > 0.5, commands).astype(np.float32)
    if config.model.offsets:
        commands = commands - references(arrays["state"][part.frame[places]], names)[:, None]
    return commands, exist


def references(joints: NDArray[Any], names: Sequence[str]) -> NDArray[Any]:
    """The joints (...,A) that predicted offsets are added to: those measured, and zero for
    grippers."""
    return np.where(grippers_of(names), 0, joints)


def grippers_of(names: Sequence[str]) -> list[bool]:
    """Which joints are grippers."""
    return [name.endswith("gripper") for name in names]


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


def joined(batches: Sequence[Arrays], order: NDArray[np.int64]) -> Arrays:
    """Batches of several parts as one, row i of the result being row order[i] of all of them."""
    return {name: np.concatenate([batch[name] for batch in batches])[order] for name in batches[0]}


def mixed_batch(
    parts: Sequence[SplitFrames],
    draw: tuple[NDArray[np.int64], NDArray[np.int64]],
    config: Config,
    preprocessing: Preprocessing,
) -> tuple[Arrays, list[str]]:
    """The arrays of a draw of Sampler, and an instruction for each row."""
    sources, places = draw
    groups = [np.flatnonzero(sources == k) for k in range(len(parts))]
    used = [(part, group) for part, group in zip(parts, groups, strict=True) if len(group)]
    batches = [batch_of(part, places[group], config, preprocessing) for part, group in used]
    back = np.argsort(np.concatenate([group for _, group in used]))
    texts: list[str] = [""] * len(sources)
    for (part, group), batch in zip(used, batches, strict=True):
        for i, row in zip(group, batch["row"], strict=True):
            sentences = part.cache.rows[row].instructions
            # another sentence at every frame: which one follows from the frame alone
            texts[i] = sentences[int(part.frame[places[i]] * 7919) % len(sentences)]
    return joined(batches, back), texts
