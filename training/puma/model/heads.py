"""What is read from the queries: joint targets, and the target's later features or boxes."""

from typing import Literal

import torch
from torch import Tensor, nn

EVERY = 0.05
"""Share of the mean over all chunks in the loss of several."""


class _Residual(nn.Module):
    def __init__(self, width: int) -> None:
        super().__init__()
        self.body = nn.Sequential(nn.LayerNorm(width), nn.Linear(width, width), nn.ReLU())

    def forward(self, x: Tensor) -> Tensor:
        return x + self.body(x)


class ActionHead(nn.Sequential):
    """(..., H) -> (..., A) normalised joint targets: the paper's MLP with two residual blocks of
    twice the width."""

    def __init__(self, hidden: int, actions: int) -> None:
        wide = 2 * hidden
        first = (nn.LayerNorm(hidden), nn.Linear(hidden, wide), nn.ReLU())
        super().__init__(
            *first, _Residual(wide), _Residual(wide), nn.LayerNorm(wide), nn.Linear(wide, actions)
        )


def shares(values: Tensor, count: int) -> list[Tensor]:
    """The last dimension of values (...,H), cut into `count` equal parts."""
    parts = values.unflatten(-1, (count, -1))
    return [parts[..., k, :] for k in range(count)]


class ActionHeads(nn.ModuleList):
    """(..., H) -> (..., M A): an action head for each of M shares of the width."""

    def __init__(self, hidden: int, actions: int, members: int) -> None:
        super().__init__(ActionHead(hidden // members, actions) for _ in range(members))

    def forward(self, hidden: Tensor) -> Tensor:
        each = zip(self, shares(hidden, len(self)), strict=True)
        return torch.cat([head(read) for head, read in each], -1)


class WorldHead(nn.Sequential):
    """(..., H) -> (..., D)."""

    def __init__(self, hidden: int, numbers: int) -> None:
        super().__init__(nn.Linear(hidden, hidden), nn.GELU(), nn.Linear(hidden, numbers))


Over = Literal["sum", "mean"]
"""How the errors of the joints become one number."""


def action_loss(found: Tensor, wanted: Tensor, valid: Tensor, over: Over = "sum") -> Tensor:
    """L1 over the joints, averaged over the steps (B,K) that exist; chunks are (B,K,A). Zero where
    none does."""
    return _mean(_distance(found, wanted, over), valid)


def mode_loss(
    found: Tensor, scores: Tensor, wanted: Tensor, valid: Tensor, over: Over = "sum"
) -> tuple[Tensor, Tensor]:
    """As `action_loss`, of the best of several chunks (B,M,K,A), and how badly scores (B,M)
    foretell which one that is.

    All chunks learn a little from every sample: one that is never the best would stay where it
    began."""
    error = torch.where(valid[:, None], _distance(found, wanted[:, None], over), 0).sum(-1)
    best = error.argmin(1)
    least, exist = error.gather(1, best[:, None])[:, 0], valid.any(1)
    action = ((1 - EVERY) * least + EVERY * error.mean(1)).sum() / valid.sum().clamp(min=1)
    return action, _mean(nn.functional.cross_entropy(scores.float(), best, reduction="none"), exist)


def feature_loss(found: Tensor, wanted: Tensor, valid: Tensor) -> Tensor:
    """1 - cosine, averaged over the moments (B,N) at which the target is known; features are
    (B,N,D)."""
    return _mean(1 - torch.cosine_similarity(found.float(), wanted.float(), dim=-1), valid)


def box_loss(found: Tensor, wanted: Tensor, valid: Tensor) -> Tensor:
    """L1 summed over the corners (B,N,4), fractions of the image, averaged over the moments at
    which the target is seen."""
    return _mean((found.float() - wanted.float()).abs().sum(-1), valid)


def _distance(found: Tensor, wanted: Tensor, over: Over) -> Tensor:
    errors = (found.float() - wanted.float()).abs()
    return errors.sum(-1) if over == "sum" else errors.mean(-1)


def _mean(values: Tensor, valid: Tensor) -> Tensor:
    return torch.where(valid, values, 0).sum() / valid.sum().clamp(min=1)
