"""Floating-point operations of a network, and how many a device can do."""

import time
from functools import lru_cache

import torch
from torch import nn
from torch.utils.flop_counter import FlopCounterMode

PEAKS = {"H100": 989e12, "H200": 989e12, "A100": 312e12, "4090": 165e12, "L40S": 362e12}
"""Dense bf16 operations a second by vendors' data sheets, by a part of the device's name."""


def forward_flops(network: nn.Module, *inputs: object) -> float:
    """Operations of one forward pass, counted as it runs; the generator of torch is left as it
    was."""
    with torch.random.fork_rng(), torch.no_grad(), FlopCounterMode(display=False) as counter:
        network(*inputs)
    return float(counter.get_total_flops())


def step_flops(network: nn.Module, inputs: object) -> float:
    """Operations of training on one sample: forward, and twice that backward; what checkpointing
    repeats does not count."""
    return 3 * forward_flops(network, inputs) / len(inputs)  # pyright: ignore[reportArgumentType]


@lru_cache(maxsize=4)
def peak_flops(device: torch.device) -> float:
    """Operations a second of a device: from a data sheet, or what a product of two matrices reaches
    here."""
    if device.type == "cuda":
        name = torch.cuda.get_device_name(device)
        known = [peak for part, peak in PEAKS.items() if part in name]
        if known:
            return known[0]
    side = 768
    a = torch.randn(side, side, device=device)
    best = float("inf")
    for _ in range(5):
        began = time.perf_counter()
        float((a @ a)[0, 0])
        best = min(best, time.perf_counter() - began)
    return 2 * side**3 / best
