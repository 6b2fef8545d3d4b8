"""A backbone that reads the further inputs alone: a multilayer perceptron, which trains in a minute
on a processor."""

from itertools import pairwise

import torch
from torch import Tensor, nn

from training.puma.config import Config
from training.puma.model.inputs import Inputs


class PerceptronBackbone(nn.Module):
    """Further inputs, one token each, to hidden states at the queries."""

    def __init__(self, config: Config, extras: int) -> None:
        super().__init__()
        settings, queries = config.model.backbone, config.model.queries
        self.width = settings.width
        sizes = [extras * self.width, *[4 * self.width] * settings.layers]
        layers = [layer for a, b in pairwise(sizes) for layer in (nn.ReLU(), nn.Linear(a, b))]
        self.body = nn.Sequential(*layers, nn.ReLU(), nn.Linear(sizes[-1], queries * self.width))

    def forward(self, inputs: Inputs, extras: Tensor, queries: Tensor) -> Tensor:
        """Hidden states (B,Q,width) at queries (Q,width); `extras` (B,E,width)."""
        return self.body(extras.flatten(1)).unflatten(1, queries.shape) + queries


class PerceptronMembers(nn.ModuleList):
    """Perceptrons beside each other. Each reads its own share of the further inputs' width."""

    def __init__(self, config: Config, extras: int) -> None:
        super().__init__(PerceptronBackbone(config, extras) for _ in range(config.model.members))
        self.width = len(self) * config.model.backbone.width

    def forward(self, inputs: Inputs, extras: Tensor, queries: Tensor) -> Tensor:
        """Hidden states (B,Q,width); `extras` (B,E,width), `queries` (Q,width)."""
        shares = zip(self, extras.chunk(len(self), -1), queries.chunk(len(self), -1), strict=True)
        return torch.cat([member(inputs, *share) for member, *share in shares], -1)
