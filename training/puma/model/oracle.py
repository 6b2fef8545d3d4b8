"""The target's true future as an input, as in the paper's oracle experiment.

The paper names a window of future poses and a vector of trajectory parameters. Here the window has
the poses of the next K frames, and the parameters are place and velocity of the target now and at
the end of the window.
"""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

POSE, PARAMETERS = 7, 12


def oracle_size(chunk: int) -> int:
    """Numbers that describe the future of a chunk."""
    return POSE * chunk + PARAMETERS


def oracle_numbers(poses: NDArray[np.float32], fps: int) -> NDArray[np.float32]:
    """Numbers (B, 7K + 12) of world poses (B,K+1,7) of the target: now, and at the next K frames.

    Window of poses (m, quaternions wxyz), then position (m) and velocity (m/s) now and at the end.
    """
    places = poses[..., :3]
    now, end = places[:, 1] - places[:, 0], places[:, -1] - places[:, -2]
    parameters = [places[:, 0], now * fps, places[:, -1], end * fps]
    return np.concatenate(
        [poses[:, 1:].reshape(len(poses), -1), *parameters], axis=1, dtype=np.float32
    )


class Oracle(nn.Module):
    """Hidden states (B,K,H) of the action queries, told the future (B,F): its code, made by an MLP,
    is put beside each of them, and a further layer makes one of both."""

    def __init__(self, width: int, numbers: int) -> None:
        super().__init__()
        self.encoder = nn.Sequential(
            nn.Linear(numbers, width), nn.ReLU(), nn.Linear(width, width), nn.ReLU()
        )
        self.merge = nn.Sequential(nn.Linear(2 * width, width), nn.ReLU(), nn.Linear(width, width))

    def forward(self, hidden: Tensor, future: Tensor) -> Tensor:
        code = self.encoder(future)[:, None].expand_as(hidden)
        return hidden + self.merge(torch.cat([hidden, code], -1))
