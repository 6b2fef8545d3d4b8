"""Trains the finder of a network on the true places of targets in the images of a corpus."""

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from tqdm import tqdm

from pipeline.data.process.machine import usable_cores
from training.puma.corpus.cache import CodedImages
from training.puma.corpus.mixture import Corpus
from training.puma.corpus.shards import Row
from training.puma.errors import TrainError
from training.puma.finding.tools import touch_points
from training.puma.model.finder import finding_loss, learn_tasks
from training.puma.model.puma import Puma
from training.puma.model_keys import Finder
from training.puma.track import TargetView

ASTRAY = 0.1
"""Share of the crops in training that lie anywhere: from them the finder learns to doubt."""


def train_finder(network: Puma, sight: TargetView, corpus: Corpus, quiet: bool) -> None:
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
