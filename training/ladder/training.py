"""Trains a network of the ladder with torch."""

import hashlib
from collections.abc import Sequence
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path

import numpy as np

from pipeline.data.atomic import write_atomic
from pipeline.poses import Floats
from training.ladder.demonstrations import Demonstration
from training.ladder.network import Network, Settings, scale, scaled
from training.ladder.samples import samples, weights

OTHERS, CHOICE = 0.05, 0.1
"""Weights in the loss: of the answers that are not the best, which keeps all of them alive; of
saying which one is the best."""


def train(x: Floats, y: Floats, settings: Settings, weights: Floats | None = None) -> Network:
    """A network from features (N,F) to chunks (N,H,A), by the mean absolute error of scaled
    outputs. Rows are drawn evenly, or in proportion to `weights` (N,).

    Experts may do one thing in two ways, such as turning a wrist by a quarter to either side, and
    what lies between them does
    nothing: so the network has several answers, of which only the best one of a sample learns it
    (relaxed winner-takes-all, Rupprecht et al. 2017), and it learns which one that is. The same for
    the same arguments, torch and processor. Raises ImportError without torch.
    """
    import torch
    from torch.nn.functional import cross_entropy

    torch.set_num_threads(1)
    torch.manual_seed(settings.seed)
    flat = y.reshape(len(y), -1)
    x_scale, y_scale = scale(x), scale(flat)
    inputs = torch.tensor(scaled(x, x_scale), dtype=torch.float32)
    wanted = torch.tensor((flat - y_scale[0]) / y_scale[1], dtype=torch.float32)
    count, length = settings.answers, wanted.shape[1]
    linear = [
        torch.nn.Linear(a, b)
        for a, b in pairwise(
            (inputs.shape[1], settings.width, settings.width, count * (length + 1))
        )
    ]
    model = torch.nn.Sequential(linear[0], torch.nn.ReLU(), linear[1], torch.nn.ReLU(), linear[2])
    optimiser = torch.optim.AdamW(model.parameters(), settings.rate, weight_decay=1e-4)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, settings.rate, total_steps=settings.steps
    )
    shares = None if weights is None else torch.tensor(weights)
    for _ in range(settings.steps):
        if shares is None:
            rows = torch.randint(len(inputs), (settings.batch,))
        else:
            rows = torch.multinomial(shares, settings.batch, replacement=True)
        answers, likely = model(inputs[rows]).split([count * length, count], 1)
        error = (answers.view(-1, count, length) - wanted[rows][:, None]).abs().mean(2)
        best = error.detach().argmin(1)
        won = error.gather(1, best[:, None]).mean()
        loss = (1 - OTHERS) * won + OTHERS * error.mean() + CHOICE * cross_entropy(likely, best)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
    layers = tuple(
        (a.weight.detach().numpy().T.astype(float), a.bias.detach().numpy().astype(float))
        for a in linear
    )
    return Network(settings, layers, x_scale, y_scale)


def train_missing(
    shown: Sequence[Demonstration], settings: Settings, where: Path, weight: float = 1.0
) -> Path:
    """The file of a trained network, trained if it is not there: its name carries a hash of
    settings, demonstrations and the weight of corrections."""
    digest, drawn = (
        hashlib.sha256(repr(asdict(settings)).encode()),
        weights(shown, settings, weight),
    )
    if any(d.corrected for d in shown):
        digest.update(repr([weight, *(d.corrected for d in shown)]).encode())
    for d in shown:
        for values in (d.joints, d.actions, d.poses, d.points):
            digest.update(np.ascontiguousarray(values).tobytes())
    path = (
        where / f"{settings.inputs}_{settings.actions}_c{settings.chunk}_s{settings.seed}"
        f"_{digest.hexdigest()[:8]}.npz"
    )
    if not path.exists():
        write_atomic(path, train(*samples(shown, settings), settings, drawn).to_bytes())
    return path
