"""A multilayer perceptron from features to a chunk of actions: trained with torch, stored and run with NumPy alone."""

import io
import json
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Settings:
    """How a network is made: what it sees (features.INPUTS), actions in a chunk, width of its two hidden layers, passes over the
    data, seed of its weights and of the order of samples, and how many frames back `two_frames` looks."""

    inputs: str = "position"
    chunk: int = 20
    width: int = 256
    epochs: int = 80
    seed: int = 0
    back: int = 1
    rate: float = 3e-3
    batch: int = 256


@dataclass(frozen=True, eq=False)
class Network:
    """Layers of weights (in, out) and biases, between the scales of inputs and outputs: x -> relu -> relu -> chunk (H,A)."""

    settings: Settings
    layers: tuple[tuple[Floats, Floats], ...]
    input_scale: tuple[Floats, Floats]
    output_scale: tuple[Floats, Floats]

    def __call__(self, x: Floats) -> Floats:
        """Chunks (N,H,A) for features (N,F)."""
        mean, std = self.input_scale
        h = np.clip((x - mean) / std, -8, 8)
        for weight, bias in self.layers[:-1]:
            h = np.maximum(h @ weight + bias, 0)
        weight, bias = self.layers[-1]
        mean, std = self.output_scale
        return ((h @ weight + bias) * std + mean).reshape(len(x), self.settings.chunk, -1)

    def to_bytes(self) -> bytes:
        """A NumPy archive without pickles."""
        out, arrays = io.BytesIO(), dict[str, Any]()
        for i, (weight, bias) in enumerate(self.layers):
            arrays |= {f"weight{i}": weight, f"bias{i}": bias}
        scales = np.array([json.dumps(asdict(self.settings)), str(len(self.layers))])
        arrays |= {"x_mean": self.input_scale[0], "x_std": self.input_scale[1]}
        arrays |= {"y_mean": self.output_scale[0], "y_std": self.output_scale[1]}
        np.savez_compressed(out, head=scales, **arrays)
        return out.getvalue()

    @classmethod
    def read(cls, path: Path) -> "Network":
        """Inverse of `to_bytes`. Raises OSError, ValueError or KeyError for a file that is none."""
        with np.load(path, allow_pickle=False) as file:
            settings, count = file["head"]
            layers = tuple((file[f"weight{i}"], file[f"bias{i}"]) for i in range(int(count)))
            scales = ((file["x_mean"], file["x_std"]), (file["y_mean"], file["y_std"]))
            return cls(Settings(**json.loads(str(settings))), layers, *scales)


def scale(values: Floats, least: float = 1e-4) -> tuple[Floats, Floats]:
    """Mean and standard deviation (F,) of the columns of values (N,F); 1 for those that are constant."""
    std = values.std(0)
    return values.mean(0), np.where(std < least, 1.0, std)


def train(x: Floats, y: Floats, settings: Settings) -> Network:
    """A network from features (N,F) to chunks (N,H,A), by the mean absolute error of scaled outputs; the same for the same
    arguments, torch and processor. Raises ImportError without torch."""
    import torch

    torch.set_num_threads(1)
    torch.manual_seed(settings.seed)
    flat = y.reshape(len(y), -1)
    x_scale, y_scale = scale(x), scale(flat)
    inputs = torch.tensor(np.clip((x - x_scale[0]) / x_scale[1], -8, 8), dtype=torch.float32)
    wanted = torch.tensor((flat - y_scale[0]) / y_scale[1], dtype=torch.float32)
    sizes = (inputs.shape[1], settings.width, settings.width, wanted.shape[1])
    linear = [torch.nn.Linear(a, b) for a, b in pairwise(sizes)]
    model = torch.nn.Sequential(linear[0], torch.nn.ReLU(), linear[1], torch.nn.ReLU(), linear[2])
    optimiser = torch.optim.AdamW(model.parameters(), settings.rate, weight_decay=1e-4)
    steps = settings.epochs * -(-len(inputs) // settings.batch)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, settings.rate, total_steps=steps)
    for _ in range(settings.epochs):
        for rows in torch.randperm(len(inputs)).split(settings.batch):
            loss = torch.nn.functional.l1_loss(model(inputs[rows]), wanted[rows])
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            schedule.step()
    layers = tuple((a.weight.detach().numpy().T.astype(float), a.bias.detach().numpy().astype(float)) for a in linear)
    return Network(settings, layers, x_scale, y_scale)
