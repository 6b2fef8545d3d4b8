"""Finds targets in all frames of a corpus: trains the finder, follows every episode with it, and
places the tools beside."""

from collections import deque
from collections.abc import Callable, Container, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from tqdm import tqdm

from pipeline.data.keys import digest
from pipeline.data.names import SIDES
from pipeline.data.process.machine import usable_cores
from pipeline.planning.kinematics import fk_batch
from pipeline.planning.planner import planner_for
from pipeline.poses import inverse, transform
from training.puma import checkpoint
from training.puma.config import Config
from training.puma.corpus.cache import Cache, CodedImages
from training.puma.corpus.samples import Arrays, Corpus
from training.puma.corpus.shards import Row
from training.puma.errors import TrainError
from training.puma.model.finder import finding_loss, learn_tasks
from training.puma.model.puma import Puma
from training.puma.model_keys import Finder
from training.puma.preprocess import Preprocessing
from training.puma.track import CHOICES, TargetView, Tracks, aims, track_numbers

ASTRAY = 0.1
"""Share of the crops in training that lie anywhere: from them the finder learns to doubt."""

CLEAN = 1 / 3
"""Share of the samples whose joints stay as they were measured."""

MOVED = 0.1
"""Range (rad) of a joint above which its arm acts in an episode."""

NEAR = 0.12
"""Distance (m) on the table from the second body within which a hand may hold it."""

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
            _train(network, sight, corpus, quiet)
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


def tools_of(embodiment: str, joints: NDArray[Any]) -> NDArray[np.float32]:
    """World positions (N,2,3) m of the tools for joints (N,A); zeros for an arm that is not
    there."""
    out, first = np.zeros((len(joints), len(SIDES), 3), np.float32), 0
    for side, chain in planner_for(embodiment).chains.items():
        out[:, SIDES.index(side)] = fk_batch(
            chain, np.asarray(joints[:, first : first + len(chain.home)], float)
        )[:, :3]
        first += len(chain.home) + 1
    return out


def touch_points(cache: Cache) -> NDArray[np.float64]:
    """Positions (N,2,3) m of the tools in the target's frame at the first touch of its episode, at
    the end without one."""
    arrays, out = cache.arrays, list[NDArray[np.float64]]()
    for start, length in zip(cache.start, cache.length, strict=True):
        free = arrays["free"][start : start + length]
        at = start + min(int(np.count_nonzero(free)), length - 1)
        [tools] = tools_of(cache.rows[0].embodiment, arrays["state"][at : at + 1])
        target = np.asarray(arrays["target"][at], float)
        out.append(np.repeat(transform(inverse(target), tools)[None], length, 0))
    return np.concatenate(out)


@dataclass(frozen=True)
class Disturbance:
    """Moves measured arm joints off their path by up to about `spread` rad, and the tools with
    them; shuffles the grippers.

    Those of a hand near the second body stay: it may hold it.

    A gripper that closes in the first frames tells which arm the expert has chosen. A network that
    may read this follows its own first guess, made before the target's velocity is known.
    """

    spread: float
    config: Config
    preprocessing: Preprocessing

    def apply(self, arrays: Arrays, rng: np.random.Generator) -> None:
        """Change samples of a target that has not been touched: `state`, `tools`, and `action`
        where it counts from the joints.

        Each has a size drawn evenly and a normal direction.
        """
        prep, count = self.preprocessing, len(arrays["state"])
        arms = np.array([not name.endswith("gripper") for name in prep.names])
        size = (
            rng.uniform(0, self.spread, (count, 1))
            * (rng.random((count, 1)) > CLEAN)
            * arrays["free"][:, None]
        )
        offsets = size * rng.normal(size=(count, len(arms))) * arms
        arrays["state"] = (arrays["state"] + offsets / prep.state.spread).astype(np.float32)
        free = np.flatnonzero(arrays["free"] & ~self._at_second(arrays))
        for gripper in np.flatnonzero(~arms):
            arrays["state"][free, gripper] = arrays["state"][rng.permutation(free), gripper]
        arrays["tools"] = tools_of(prep.embodiments[0], prep.state.backward(arrays["state"]))
        if self.config.model.offsets:
            arrays["action"] = (arrays["action"] - (offsets / prep.action.spread)[:, None]).astype(
                np.float32
            )

    def _at_second(self, arrays: Arrays) -> NDArray[np.bool_]:
        """Whether a hand is near the second body (B,): what it does there, its gripper tells."""
        track = self.config.model.track
        if track is None or track.bodies == 1:
            return np.zeros(len(arrays["track"]), bool)
        second = arrays["track"].reshape(len(arrays["track"]), track.bodies, -1)[:, 1, :2]
        ways = np.linalg.norm(arrays["tools"][:, :, :2] - second[:, None], axis=-1)
        return ways.min(1) < NEAR


def _train(network: Puma, sight: TargetView, corpus: Corpus, quiet: bool) -> None:
    """Train both locators on the true points of every frame that has the target's origin in the
    image. What reads sentences learns to tell tasks apart as well."""
    finder = network.finder
    assert finder is not None
    settings, seed = finder.settings, corpus.config.train.seed
    views, wanted, shares = _views(settings, sight, corpus)
    size, device = np.array(sight.size[::-1]), next(finder.parameters()).device
    tasks = sorted({view.task for view in views})
    naming = nn.Linear(settings.words, len(tasks)).to(device) if settings.words else None
    learned = [*finder.requires_grad_(True).train().parameters()]
    learned += [] if naming is None else [*naming.parameters()]
    optimizer = torch.optim.AdamW(learned, settings.rate, weight_decay=1e-4)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimizer, settings.rate, total_steps=settings.steps
    )
    shrinking, reached = size / settings.size[::-1], np.cumsum(shares)[:-1]

    def make(step: int) -> dict[str, Tensor]:
        """The images of a step, what is to be found in them, and what is told."""
        rng = np.random.default_rng([seed, step])
        chosen = np.searchsorted(reached, rng.random(settings.batch))
        seen, truth = [views[i] for i in chosen], wanted[chosen]
        images = [view.image for view in seen]
        there = ((truth >= 0) & (truth < size)).all(-1)
        # the crops of each body, one body after another
        each = np.concatenate(np.split(truth, settings.bodies, 1))
        there_each = np.concatenate(np.split(there, settings.bodies, 1))
        count = (len(each), 2)
        middle = each[:, 0] + rng.uniform(-settings.crop / 3, settings.crop / 3, count)
        astray = (rng.random((len(each), 1)) < ASTRAY) | ~there_each[:, :1]
        corners = finder.corners(np.where(astray, rng.uniform(0, size, count), middle), size)
        arrays = {
            "images": finder.shrunk(images),
            "points": (truth / shrinking).astype(np.float32),
            "there": there,
            "crops": finder.crops(images * settings.bodies, corners),
            "crop_points": (each - corners[:, None]).astype(np.float32),
            "crop_there": there_each,
            "task": np.array([tasks.index(view.task) for view in seen]),
        }
        made = {name: torch.from_numpy(array) for name, array in arrays.items()}
        return made | {"text": network.words.ids([view.sentence(rng) for view in seen])}

    for batch in tqdm(
        in_order(make, settings.steps),
        desc="finder",
        unit="step",
        disable=quiet,
        total=settings.steps,
    ):
        there = {name: values.to(device, non_blocking=True) for name, values in batch.items()}
        read, loss = None, torch.zeros((), device=device)
        if naming is not None:
            read = finder.read(there["text"])
            loss = nn.functional.cross_entropy(naming(read), there["task"])
        found, errors = finder.coarse(there["images"], read)
        loss = loss + finding_loss(found, errors, there["points"], there["there"])
        told = finder.add_bodies(read, settings.batch)
        found, errors = finder.fine(there["crops"], told)
        loss = loss + finding_loss(found, errors, there["crop_points"], there["crop_there"])
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(finder.parameters(), 1.0)
        optimizer.step()
        schedule.step()
    if finder.tasks:
        told = [network.words.ids(texts) for texts in sentences_of(corpus).values()]
        learn_tasks(finder, told, max(1, settings.steps // 4), seed)
    # gradients left here would count in the norm to which the network's own are clipped, and be
    # missing in a resumed run
    optimizer.zero_grad()


def sentences_of(corpus: Corpus) -> dict[str, list[str]]:
    """The sentences of training of each task, in order."""
    found = dict[str, set[str]]()
    for part in corpus.train:
        for row in (part.cache.rows[i] for i in np.unique(part.episode)):
            found.setdefault(row.path.parts[0], set()).update(row.instructions)
    return {task: sorted(found[task]) for task in sorted(found)}


def in_order[T](make: Callable[[int], T], count: int) -> Iterator[T]:
    """What `make` returns for 0, 1, ..., made ahead by a thread for every core."""
    cores = usable_cores()
    with ThreadPoolExecutor(cores) as pool:
        ahead = deque[Future[T]]()
        for number in range(count):
            ahead.append(pool.submit(make, number))
            if len(ahead) > cores:
                yield ahead.popleft().result()
        while ahead:
            yield ahead.popleft().result()


@dataclass(frozen=True, eq=False)
class _View:
    """One image of a stack (N,H,W,3), and the episode that it is of."""

    images: NDArray[np.uint8] | CodedImages
    number: int
    row: Row

    @property
    def image(self) -> NDArray[np.uint8]:
        return self.images[self.number]

    @property
    def task(self) -> str:
        return self.row.path.parts[0]

    def sentence(self, rng: np.random.Generator) -> str:
        """One of the sentences of its episode."""
        return self.row.instructions[int(rng.integers(len(self.row.instructions)))]


def _views(
    settings: Finder, sight: TargetView, corpus: Corpus
) -> tuple[list[_View], NDArray[np.float64], NDArray[np.float64]]:
    """The images that have the target's origin in them, the points (N,P,2) px to be found, and how
    likely (N,) each is to be drawn: parts of the corpus by their weight."""
    camera, size = corpus.config.data.cameras[0], np.array(sight.size[::-1])
    views = list[_View]()
    points, shares = list[NDArray[np.float64]](), list[NDArray[np.float64]]()
    for part, weight in zip(corpus.train, corpus.weights, strict=True):
        arrays, images = part.cache.arrays, part.cache.images(camera)
        further = touch_points(part.cache)[part.frame] if settings.touches else None
        pixels = sight.pixels(arrays["target"][part.frame], further)
        if settings.goal:
            pixels = np.concatenate([pixels, sight.pixels(arrays["goal"][part.frame])], 1)
        inside = np.flatnonzero(((pixels[:, 0] >= 0) & (pixels[:, 0] < size)).all(-1))
        points.append(pixels[inside])
        shares.append(np.full(len(inside), weight / max(len(inside), 1)))
        rows = part.cache.rows
        views += [_View(images, int(part.frame[i]), rows[part.episode[i]]) for i in inside]
    if not views:
        raise TrainError(
            f"model.track: the target is in no image of {camera}; choose another camera"
        )
    likely = np.concatenate(shares)
    return views, np.concatenate(points), likely / likely.sum()


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
