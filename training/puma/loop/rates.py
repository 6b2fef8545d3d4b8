"""Learning rates: of the parts of a network, and over the steps of a training."""

import math
from typing import Any

from torch import nn

from training.puma.config import Train
from training.puma.model.puma import Puma


def groups(network: Puma, settings: Train) -> list[dict[str, Any]]:
    """Weights by learning rate: those of the backbone, of the heads, and of the world head with the
    queries. Biases, norms and queries do not decay."""
    rates = {
        "backbone": settings.backbone_rate,
        "heads": settings.head_rate,
        "world": settings.world_rate or settings.head_rate,
    }
    found: dict[tuple[float, bool], list[nn.Parameter]] = {}
    for name, weight in network.named_parameters():
        if weight.requires_grad:
            decays = weight.ndim > 1 and name != "queries"
            found.setdefault((rates[_part_of(name)], decays), []).append(weight)
    return [
        {"params": some, "lr": rate, "peak": rate, "weight_decay": settings.weight_decay * decays}
        for (rate, decays), some in found.items()
    ]


def _part_of(name: str) -> str:
    if name.startswith("backbone."):
        return "backbone"
    return "world" if name == "queries" or name.startswith("world_head.") else "heads"


def rate_at(step: int, settings: Train) -> float:
    """Share of the peak learning rate at a step: linear warm-up, then a cosine to the floor."""
    if step < settings.warmup:
        return (step + 1) / settings.warmup
    floor = min(1.0, settings.floor_rate / settings.backbone_rate)
    part = (step - settings.warmup) / max(1, settings.steps - settings.warmup)
    return floor + (1 - floor) * (1 + math.cos(math.pi * min(1.0, part))) / 2
