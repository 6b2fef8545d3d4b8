"""Finds targets in all frames of a corpus: trains the finder, follows every episode with it, and
places the tools beside."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn
from tqdm import tqdm

from pipeline.data.names import SIDES
from pipeline.planning.kinematics import fk_batch
from pipeline.planning.planner import planner_for
from pipeline.poses import inverse, transform
from training.puma.cache import Cache, CodedImages
from training.puma.config import Config, Finder
from training.puma.data import Arrays, Corpus
from training.puma.errors import TrainError
from training.puma.model.finder import finding_loss
from training.puma.model.puma import Puma
from training.puma.preprocess import Preprocessing
from training.puma.shards import Row
from training.puma.track import CHOICES, TargetView, Tracks, aims

ASTRAY = 0.1
"""Share of the crops in training that lie anywhere: from them the finder learns to doubt."""

CLEAN = 1 / 3
"""Share of the samples whose joints stay as they were measured."""

MOVED = 0.1
"""Range (rad) of a joint above which its arm acts in an episode."""

FRAMES = 128
"""Frames that are searched at once."""


def follow(corpus: Corpus, network: Puma, trained: bool = False, quiet: bool = True) -> Corpus:
    """The corpus with the arrays `track` (N,M), those of all bodies, `tools` (N,2,3) m and `choice`
    (N,), which of CHOICES acts, for every frame.

    Trains the finder of the network, and fits the scale of what is found, unless they are `trained`
    already. The same for the same corpus, configuration, torch and processor. Raises TrainError if
    no image shows the target before it is touched.
    """
    finder, sight = network.finder, corpus.preprocessing.sight
    if finder is None or sight is None:
        return corpus
    if not trained:
        _train(network, sight, corpus, quiet)
    finder.eval()
    return with_tracks(corpus, network, partial(_find_tracks, network, sight), trained)


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
        seen = [
            aims(arrays["track"][part.frame], arrays["tools"][part.frame], settings.bodies)
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
            chain, np.asarray(joints[:, first : first + chain.dof], float)
        )[:, :3]
        first += chain.dof + 1
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
        free = np.flatnonzero(arrays["free"])
        for gripper in np.flatnonzero(~arms):
            arrays["state"][free, gripper] = arrays["state"][rng.permutation(free), gripper]
        arrays["tools"] = tools_of(prep.embodiments[0], prep.state.backward(arrays["state"]))
        if self.config.model.offsets:
            arrays["action"] = (arrays["action"] - (offsets / prep.action.spread)[:, None]).astype(
                np.float32
            )


def _train(network: Puma, sight: TargetView, corpus: Corpus, quiet: bool) -> None:
    """Train both locators on the true points of every frame that has the target's origin in the
    image. What reads sentences learns to tell tasks apart as well."""
    finder = network.finder
    assert finder is not None
    settings, rng = finder.settings, np.random.default_rng(corpus.config.train.seed)
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
    shrinking = size / settings.size[::-1]
    for _ in tqdm(range(settings.steps), desc="finder", unit="step", disable=quiet):
        chosen = rng.choice(len(views), settings.batch, p=shares)
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
        crops = finder.crops(images * settings.bodies, corners)
        read = None
        if naming is not None:
            read = finder.read(network.words.ids([view.sentence(rng) for view in seen]))
        loss = torch.zeros((), device=device)
        if naming is not None and read is not None:
            named = torch.tensor([tasks.index(view.task) for view in seen], device=device)
            loss = nn.functional.cross_entropy(naming(read), named)
        for locator, shown, points, seen_of, told in (
            (finder.coarse, finder.shrunk(images), truth / shrinking, there, read),
            (
                finder.fine,
                crops,
                each - corners[:, None],
                there_each,
                finder.add_bodies(read, len(seen)),
            ),
        ):
            found, errors = locator(torch.from_numpy(shown).to(device), told)
            points_in = torch.from_numpy(points).float().to(device)
            loss = loss + finding_loss(
                found, errors, points_in, torch.from_numpy(seen_of).to(device)
            )
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(finder.parameters(), 1.0)
        optimizer.step()
        schedule.step()
    # gradients left here would count in the norm to which the network's own are clipped, and be
    # missing in a resumed run
    optimizer.zero_grad()
    finder.requires_grad_(False).eval()


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


def _find_tracks(network: Puma, sight: TargetView, cache: Cache) -> NDArray[np.float32]:
    """What the finder sees in all frames (N,M) of a cache, each episode followed from its first
    frame, by its first sentence."""
    finder, images = network.finder, cache.images(network.config.data.cameras[0])
    assert finder is not None
    settings, out = finder.settings, list[NDArray[np.float32]]()
    for start, length, row in zip(cache.start, cache.length, cache.rows, strict=True):
        tracks, end = Tracks(sight, settings.bodies, settings.memory), start + length
        ids = network.words.ids(row.instructions[:1])
        for first in range(start, end, FRAMES):
            last = min(first + FRAMES, end)
            points, errors = finder.find(images[first:last], ids.repeat(last - first, 1))
            for time, *seen in zip(cache.arrays["time"][first:last], points, errors, strict=True):
                tracks.see(float(time), *seen)
                out.append(tracks.numbers)
    return np.stack(out)


def _add_arrays(cache: Cache, tracks: NDArray[np.float32]) -> Cache:
    """The cache with `track`, `tools` and `choice`."""
    arrays, choices = cache.arrays, list[NDArray[np.int64]]()
    for start, length, taught in zip(cache.start, cache.length, cache.taught, strict=True):
        choices.append(
            np.repeat(choice_of(cache.names, arrays["action"][taught : start + length]), length)
        )
    tools = tools_of(cache.rows[0].embodiment, arrays["state"])
    return replace(
        cache, arrays={**arrays, "track": tracks, "tools": tools, "choice": np.concatenate(choices)}
    )


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
