"""The network and its optimiser over one or several processes: copies (DDP), or weights, gradients and states of AdamW in shares
(FSDP 2).

Weights, gradients and states of AdamW in float32 are 16 bytes a weight, 64 GB for 4 billion: a card of 80 GB holds a copy of 2
billion, or of 4 billion with adapters; more needs shares.
"""

from pathlib import Path
from typing import Any

import torch
from accelerate import Accelerator, DistributedType
from torch import Tensor, distributed, nn
from torch.distributed.device_mesh import init_device_mesh
from torch.distributed.fsdp import FSDPModule, fully_shard
from torch.distributed.tensor import DTensor, distribute_tensor

from training.puma import trackers
from training.puma.config import Train
from training.puma.errors import TrainError

LAYERS = "language_model.layers."
"""Where the layers stand that are gathered one by one; what else there is, is gathered once a step."""


def started(settings: Train, out: Path) -> Accelerator:
    """The processes of this run, and its trackers, which write below `out` where they write files.

    Raises TrainError where accelerate is configured for what is not done here, and for a tracker that is not installed.
    """
    trackers.check(settings.trackers)
    told: list[Any] = [*settings.trackers]
    on_cpu = not torch.cuda.is_available()
    accelerator = Accelerator(mixed_precision=settings.precision, cpu=on_cpu, log_with=told or None, project_dir=str(out))
    if accelerator.distributed_type not in (DistributedType.NO, DistributedType.MULTI_CPU, DistributedType.MULTI_GPU):
        found = accelerator.distributed_type.value
        raise TrainError(
            f"accelerate is configured for {found}: configure one or several processes, and set train.parallel to shard"
        )
    return accelerator


def share_out(network: nn.Module, accelerator: Accelerator, settings: Train) -> None:
    """Leave each process its share of the weights, in place; nothing for `ddp` and for one process. Optimisers are made afterwards.

    `zero2` keeps what was gathered in the forward pass until the backward pass is done; `fsdp` gathers every layer twice.
    Raises TrainError for a network whose backbone is frozen: it has little to share, and adapters train as copies.
    """
    if settings.parallel == "ddp" or accelerator.num_processes == 1:
        return
    if not all(weight.requires_grad for weight in network.parameters()):
        raise TrainError(f"train.parallel {settings.parallel} is for networks that are trained as a whole: set it to ddp")
    mesh = init_device_mesh(accelerator.device.type, (accelerator.num_processes,))
    again = settings.parallel == "fsdp"
    for name, module in network.named_modules():
        if LAYERS in name and name.rpartition(".")[2].isdigit():
            fully_shard(module, mesh=mesh, reshard_after_forward=again)
    fully_shard(network, mesh=mesh, reshard_after_forward=False)


def prepared(
    network: nn.Module, optimizer: torch.optim.Optimizer, accelerator: Accelerator, settings: Train
) -> tuple[nn.Module, torch.optim.Optimizer]:
    """The model to call and the optimiser to step."""
    if settings.parallel == "ddp" or accelerator.num_processes == 1:
        return accelerator.prepare(network, optimizer)
    return network.to(accelerator.device), optimizer


def part() -> None:
    """End the group of processes, once all have come here: one that ends while others still talk to it makes them abort."""
    if distributed.is_available() and distributed.is_initialized():
        distributed.barrier()
        distributed.destroy_process_group()


def in_shares(network: nn.Module) -> None:
    """Give up what a forward pass gathered that no backward pass followed: weights are in shares again."""
    for module in network.modules():
        if isinstance(module, FSDPModule):
            module.reshard()


def whole(tensor: Tensor) -> Tensor:
    """A tensor gathered from its shares; every process must ask for the same ones in the same order."""
    return tensor.full_tensor() if isinstance(tensor, DTensor) else tensor


def like(tensor: Tensor, weight: Tensor) -> Tensor:
    """A whole tensor in shares as those of `weight`, on its device."""
    if isinstance(weight, DTensor):
        return distribute_tensor(tensor.to(weight.device), weight.device_mesh, weight.placements)
    return tensor.to(weight.device)
