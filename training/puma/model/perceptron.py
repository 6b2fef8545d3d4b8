"""A backbone that reads the further inputs alone: a multilayer perceptron, which trains in a minute
on a processor."""

from itertools import pairwise

import torch
from torch import Tensor, nn

from training.puma.config import Config
from training.puma.model.heads import shares
from training.puma.model.inputs import Inputs


class PerceptronBackbone(nn.Module):
    """Further inputs, one token each, to hidden states at the queries."""

    def __init__(self, config: Config, extras: int) -> None:
        super().__init__()
        self.width = config.model.backbone.width
        self.body = _body(config, extras)

    def forward(self, inputs: Inputs, extras: Tensor, queries: Tensor) -> Tensor:
        """Hidden states (B,Q,width) at queries (Q,width); `extras` (B,E,width)."""
        return self.body(extras.flatten(1)).unflatten(1, queries.shape) + queries


class PerceptronMembers(nn.ModuleList):
    """Perceptrons beside each other, each of which reads its own share of the width."""

    def __init__(self, config: Config, extras: int) -> None:
        members = config.model.members
        super().__init__(_body(config, extras) for _ in range(members))
        self.width = members * config.model.backbone.width

    def forward(self, inputs: Inputs, extras: Tensor, queries: Tensor) -> Tensor:
        """As PerceptronBackbone."""
        each = zip(self, shares(extras, len(self)), strict=True)
        hidden = [body(read.flatten(1)).unflatten(1, (len(queries), -1)) for body, read in each]
        return torch.cat(hidden, -1) + queries


def _body(config: Config, extras: int) -> nn.Sequential:
    settings = config.model.backbone
    sizes = [extras * settings.width, *[4 * settings.width] * settings.layers]
    layers = [layer for a, b in pairwise(sizes) for layer in (nn.ReLU(), nn.Linear(a, b))]
    last = nn.Linear(sizes[-1], config.model.queries * settings.width)
    return nn.Sequential(*layers, nn.ReLU(), last)
