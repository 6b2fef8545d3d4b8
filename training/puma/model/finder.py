"""Finds bodies in an image: coarsely in the whole, made small, then in crops of the full image
around that. A sentence may name them."""

from collections.abc import Iterable, Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from training.puma.model.text import PADDING, padded
from training.puma.model.tiny import Points
from training.puma.model_keys import Finder
from training.puma.preprocess import resized

HELPERS = 8
"""Filters beside those of the points: what else is to be seen says how exact the points are."""

LEAST, MOST = -1.5, 4.5
"""Logarithms of the smallest and the largest error (px) that can be expected."""

CELL = 4
"""Stride (px) of the responses of `Points`."""

LETTERS = 64
"""Numbers of a piece of a sentence."""

UNREAD = 0.2
"""Share of the pieces of a sentence that are left out in training: others must do without them."""

UNKNOWN = (0.3, 0.95)
"""The same where tasks are learned: the range from which it is drawn for each sentence."""

SENTENCES = 192
"""Sentences of a step in which tasks are learned."""

SHARPNESS = 30.0
"""Factor of the mean over the pieces of a sentence, of which softmax gives the likelihood of each
task."""

type Images = NDArray[np.uint8]
type Floats = NDArray[np.float32]


class Locator(nn.Module):
    """Images (N,h,w,3) uint8 -> points (N,K,2) px and the errors (N,K) px that are expected of
    them. Which points depends on `told` (N,T)."""

    def __init__(self, points: int, width: int, told: int = 0) -> None:
        super().__init__()
        self.points, filters = points, points + HELPERS
        self.body = Points(filters, width, told)
        self.doubt = nn.Sequential(nn.Linear(3 * filters, 32), nn.GELU(), nn.Linear(32, points))

    def forward(self, images: Tensor, told: Tensor | None = None) -> tuple[Tensor, Tensor]:
        seen = self.body(images.permute(0, 3, 1, 2).float() / 127.5 - 1, told)
        filters = seen.shape[1] // 3
        found = torch.stack([seen[:, : self.points], seen[:, filters : filters + self.points]], -1)
        # -1 and 1 are the middles of the first and the last cell
        cells = torch.tensor(
            [-(-images.shape[2] // CELL), -(-images.shape[1] // CELL)], device=images.device
        )
        pixels = ((found + 1) / 2 * (cells - 1) + 0.5) * CELL
        return pixels, self.doubt(seen).clamp(LEAST, MOST).exp()


class Reader(nn.Module):
    """Sentences as ids of pieces (N,L), padded with negative ones -> embeddings (N,E)."""

    def __init__(self, pieces: int, width: int) -> None:
        super().__init__()
        self.pieces = nn.Embedding(pieces, LETTERS)
        self.out = nn.Sequential(
            nn.Linear(LETTERS, LETTERS), nn.GELU(), nn.Linear(LETTERS, width), nn.Tanh()
        )

    def forward(self, ids: Tensor) -> Tensor:
        read = ids >= 0
        if self.training:
            read = read & (torch.rand(ids.shape, device=ids.device) > UNREAD)
        found = self.pieces(ids.clamp(min=0)) * read[..., None]
        return self.out(found.sum(1) / read.sum(1, keepdim=True).clamp(min=1))


class FinderNet(nn.Module):
    """A locator for whole images, made small, and one for crops around each body. `pieces` is the
    size of the vocabulary where sentences are read, `tasks` how many they are taken for."""

    means: Tensor
    """What the sentences of each task read on average (T,E)."""

    def __init__(self, settings: Finder, pieces: int, tasks: int = 0) -> None:
        super().__init__()
        self.settings, self.tasks = settings, tasks
        bodies, told = settings.bodies, settings.words
        self.reader = Reader(pieces, told) if told else None
        if tasks:
            self.register_buffer("means", torch.zeros(tasks, told))
            self.says = nn.Embedding(pieces, tasks)
        self.coarse = Locator(bodies * settings.points, settings.width, told)
        which = bodies if bodies > 1 else 0
        self.fine = Locator(settings.points, settings.width, told + which)

    def shrunk(self, images: Iterable[Images]) -> Images:
        """Images (H,W,3) at the size of the first locator."""
        return np.stack([resized(image, self.settings.size) for image in images])

    def find(self, images: Images, ids: Tensor | None = None) -> tuple[Floats, Floats]:
        """Points (N,P,2) px in images (N,H,W,3), and the errors (N,P) px that are expected of them.

        Points of one body follow those of another; `ids` (N,L) are the sentences.
        """
        device, size = next(self.parameters()).device, np.array(images.shape[2:0:-1])
        bodies = self.settings.bodies
        with torch.inference_mode():
            told = self.read(ids)
            rough, _ = self.coarse(torch.from_numpy(self.shrunk(images)).to(device), told)
            middles = rough[:, :: self.settings.points].transpose(0, 1).flatten(0, 1)
            corners = self.corners(middles.cpu().numpy() * size / self.settings.size[::-1], size)
            crops = self.crops([*images] * bodies, corners)
            found, errors = self.fine(
                torch.from_numpy(crops).to(device), self.add_bodies(told, len(images))
            )
        found = found.cpu().numpy() + corners[:, None].astype(np.float32)
        return self.by_image(found), self.by_image(errors.cpu().numpy())

    def read(self, ids: Tensor | None) -> Tensor | None:
        """Embeddings (N,E) of sentences; None where none are read. Once it is trained, a finder
        that knows its tasks gives the mean of the likeliest one."""
        if self.reader is None or ids is None:
            return None
        ids = ids.to(next(self.parameters()).device)
        if self.training or not self.tasks:
            return self.reader(ids)
        return self.means[self.task_logits(ids).argmax(1)]

    def task_logits(self, ids: Tensor) -> Tensor:
        """Logits (N,T) of the task that sentences (N,L) ask for."""
        read = (ids >= 0)[..., None]
        said = (self.says(ids.clamp(min=0)) * read).sum(1)
        return SHARPNESS * said / read.sum(1).clamp(min=1)

    def add_bodies(self, read: Tensor | None, count: int) -> Tensor | None:
        """What the second locator is told (B N,T) for the crops of every body of `count` images:
        the sentences, and which body."""
        bodies = self.settings.bodies
        if bodies == 1:
            return read
        device = next(self.parameters()).device
        which = torch.eye(bodies, device=device).repeat_interleave(count, 0)
        return which if read is None else torch.cat([read.repeat(bodies, 1), which], 1)

    def by_image(self, found: Floats) -> Floats:
        """Values (B N,K,...) of the crops as (N,B K,...)."""
        each = np.split(found, self.settings.bodies)
        return np.concatenate(each, 1)

    def corners(self, middle: NDArray[np.floating], size: NDArray[np.int64]) -> NDArray[np.int64]:
        """Upper left corners (N,2) px of crops around `middle` (N,2) px that lie within images of
        `size` (width, height)."""
        return np.clip(
            np.rint(middle - self.settings.crop / 2), 0, size - self.settings.crop
        ).astype(np.int64)

    def crops(self, images: list[Images], corners: NDArray[np.int64]) -> Images:
        """The crops (N,c,c,3) of images (H,W,3) at corners (N,2) px."""
        size = self.settings.crop
        pairs = zip(images, corners, strict=True)
        return np.stack([image[y : y + size, x : x + size] for image, (x, y) in pairs])


def learn_tasks(finder: FinderNet, sentences: Sequence[Tensor], steps: int, seed: int) -> None:
    """Keep the mean of what the sentences (N,L) of each task read. Learn to tell the task by a few
    pieces of a sentence: most pieces of an unseen one are unknown."""
    reader, rng = finder.reader, np.random.default_rng([seed, len(sentences)])
    assert reader is not None
    device, peak = finder.means.device, finder.settings.rate
    reader.eval()
    with torch.no_grad():
        read = [[reader(some.to(device)) for some in ids.split(512)] for ids in sentences]
        finder.means.copy_(torch.stack([torch.cat(parts).mean(0) for parts in read]))
        nn.init.zeros_(finder.says.weight)
    optimizer = torch.optim.AdamW(finder.says.parameters(), peak, weight_decay=1e-3)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, peak, total_steps=steps)
    for _ in range(steps):
        which = rng.integers(len(sentences), size=SENTENCES)
        rows = [sentences[task][rng.integers(len(sentences[task]))].numpy() for task in which]
        ids = padded(rows).numpy()
        unread = rng.random(ids.shape) < rng.uniform(*UNKNOWN, (SENTENCES, 1))
        told = finder.task_logits(torch.from_numpy(np.where(unread, PADDING, ids)).to(device))
        loss = nn.functional.cross_entropy(told, torch.from_numpy(which).to(device))
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
    optimizer.zero_grad()


def finding_loss(found: Tensor, errors: Tensor, wanted: Tensor, there: Tensor) -> Tensor:
    """Negative log-likelihood of the points (N,K,2) px that are `there` (N,K), plus a tenth of
    their distance from the found ones (px).

    The distances follow a Laplace law of the expected errors (N,K); the second term keeps points
    learning that are expected to be far off."""
    distance = (found - wanted).abs().mean(-1)
    loss = distance / errors + errors.log() + 0.1 * distance.clamp(max=100)
    return (loss * there).sum() / there.sum().clamp(min=1)
