"""The network and its optimiser over one or several processes: copies (DDP), or weights, gradients
and states of AdamW in shares (FSDP 2). What FSDP needs takes 3 s to import: it is imported only for
shares.

How much memory each way takes is in memory.py. For shares only the first process ever holds all
weights; the others, and the network that is trained, begin on the meta device.
"""

from collections.abc import Callable
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeGuard

import torch
from accelerate import (
    Accelerator,
    DistributedDataParallelKwargs,
    DistributedType,
    init_empty_weights,
)
from torch import Tensor, distributed, nn

from training.puma.config import Config, Train
from training.puma.errors import TrainError
from training.puma.model.puma import Puma, Sizes, build_model
from training.puma.processes import trackers

if TYPE_CHECKING:
    from torch.distributed.tensor import DTensor

LONGEST_WAIT = timedelta(days=7)
"""How long processes wait for what one of them does alone, such as decoding a dataset."""

LAYERS = "language_model.layers."
"""Where the layers stand that are gathered one by one; what else there is, is gathered once a
step."""


def start_accelerator(settings: Train, out: Path) -> Accelerator:
    """The processes of this run, and its trackers, which write below `out` where they write files.

    Raises TrainError if accelerate is configured for what is not done here, and for a tracker that
    is not installed.
    """
    trackers.check(settings.trackers)
    told: list[Any] = [*settings.trackers]
    on_cpu = not torch.cuda.is_available()
    # gradients are not held a second time in the buffers in which copies exchange them
    copies = DistributedDataParallelKwargs(gradient_as_bucket_view=True)
    accelerator = Accelerator(
        mixed_precision=settings.precision,
        cpu=on_cpu,
        log_with=told or None,
        project_dir=str(out),
        kwargs_handlers=[copies],
    )
    if accelerator.distributed_type not in (
        DistributedType.NO,
        DistributedType.MULTI_CPU,
        DistributedType.MULTI_GPU,
    ):
        found = accelerator.distributed_type.value
        raise TrainError(
            f"accelerate is configured for {found}: configure one or several processes, and set"
            " train.parallel to shard"
        )
    return accelerator


def one_first[T](work: Callable[[], T], accelerator: Accelerator) -> T:
    """What `work` returns in every process. The first process does it, then the first of every
    other machine, then the rest: what it makes on a disk, those that come later find.

    Raises the TrainError of any process in all of them.
    """
    if accelerator.num_processes == 1:
        return work()
    group: Any = distributed.new_group(backend="gloo", timeout=LONGEST_WAIT)
    found: list[T] = []
    for turn in (accelerator.is_main_process, accelerator.is_local_main_process, True):
        reasons = list[str | None]([None] * accelerator.num_processes)
        reason: str | None = None
        if turn and not found:
            try:
                found.append(work())
            except TrainError as error:
                reason = str(error)
        distributed.all_gather_object(reasons, reason, group=group)
        for said in reasons:
            if said is not None:
                raise TrainError(said)
    return found[0]


def is_shared(accelerator: Accelerator, settings: Train) -> bool:
    """Whether each process holds a share of the weights, not a copy."""
    return settings.parallel != "ddp" and accelerator.num_processes > 1


def shell_of(config: Config, sizes: Sizes) -> Puma:
    """The network without its weights: they are on the meta device; what is computed and not
    trained (positions) is there."""
    with torch.random.fork_rng(devices=[]), init_empty_weights(include_buffers=False):
        network = build_model(config, sizes, trained=True)
    for weight in network.parameters():
        if weight.requires_grad:
            weight.data = weight.data.float()
    return network


def share_weights(network: Puma, shell: Puma, accelerator: Accelerator, settings: Train) -> Puma:
    """The network whose weights each process holds a share of: `shell`, with the weights that
    `network` has in the first process.

    `zero2` keeps what was gathered in the forward pass until the backward pass is done; `fsdp`
    gathers every layer twice. Raises TrainError for a network whose backbone is frozen: it has
    little to share, and adapters train as copies.
    """
    from torch.distributed.checkpoint.state_dict import StateDictOptions, set_model_state_dict
    from torch.distributed.device_mesh import init_device_mesh
    from torch.distributed.fsdp import fully_shard

    if not all(weight.requires_grad for weight in shell.parameters()):
        raise TrainError(
            f"train.parallel {settings.parallel} is for networks that are trained as a whole: set"
            " it to ddp"
        )
    weights = network.state_dict() if accelerator.is_main_process else {}
    mesh = init_device_mesh(accelerator.device.type, (accelerator.num_processes,))
    again = settings.parallel == "fsdp"
    for name, module in shell.named_modules():
        if LAYERS in name and name.rpartition(".")[2].isdigit():
            fully_shard(module, mesh=mesh, reshard_after_forward=again)
    fully_shard(shell, mesh=mesh, reshard_after_forward=False)
    computed = dict(shell.named_buffers())
    shell.to_empty(device=accelerator.device)
    for name, buffer in shell.named_buffers():
        buffer.copy_(computed[name])
    set_model_state_dict(
        shell, weights, options=StateDictOptions(full_state_dict=True, broadcast_from_rank0=True)
    )
    return shell


def prepare(
    network: nn.Module, optimizer: torch.optim.Optimizer, accelerator: Accelerator, settings: Train
) -> tuple[nn.Module, torch.optim.Optimizer]:
    """The model to call and the optimiser to step."""
    if not is_shared(accelerator, settings):
        return accelerator.prepare(network, optimizer)
    return network.to(accelerator.device), optimizer


def part() -> None:
    """End the group of processes, once all have come here: one that ends while others still talk to
    it makes them abort."""
    if distributed.is_available() and distributed.is_initialized():
        distributed.barrier()
        distributed.destroy_process_group()


def in_shares(network: nn.Module) -> None:
    """Give up what a forward pass gathered that no backward pass followed: weights are in shares
    again."""
    for module in network.modules():
        reshard = getattr(module, "reshard", None)
        if reshard is not None:
            reshard()


def is_share(tensor: Tensor) -> TypeGuard["DTensor"]:
    """Whether a tensor is one process's share of a larger one."""
    return hasattr(tensor, "device_mesh")


def whole(tensor: Tensor) -> Tensor:
    """A tensor gathered from its shares; every process must ask for the same ones in the same
    order."""
    return tensor.full_tensor() if is_share(tensor) else tensor


def like(tensor: Tensor, weight: Tensor) -> Tensor:
    """A whole tensor in shares as those of `weight`, on its device."""
    if is_share(weight):
        from torch.distributed.tensor import distribute_tensor

        return distribute_tensor(tensor.to(weight.device), weight.device_mesh, weight.placements)
    return tensor.to(weight.device)
