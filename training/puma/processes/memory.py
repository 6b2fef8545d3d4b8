"""How much memory training takes on each card, calculated from the network without allocating it.

A trained weight takes 16 bytes: itself, its gradient and the two averages of AdamW, in float32.
Under autocast there is a copy in bf16, too, from the forward pass on. Shares divide the 16 bytes by
the number of processes and gather weights again: all of them (`zero2`), or those of two layers and
what belongs to no layer (`fsdp`). Activations are an estimate.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from accelerate import Accelerator
from torch import nn

from training.puma.config import Config
from training.puma.errors import TrainError
from training.puma.model.puma import Puma, Sizes
from training.puma.model.text import BUCKET
from training.puma.processes.parallel import LAYERS, shell_of

GB = 1e9
KINDS = ("ddp", "zero2", "fsdp")
# bytes: a trained weight with its gradient and averages; bf16; float32
TRAINED, HALF, SINGLE = 16, 2, 4


@dataclass(frozen=True)
class Weights:
    """`trained` weights, bytes of `frozen` ones, and trained weights of the largest layer and
    outside of all layers."""

    trained: int
    frozen: int
    layer: int
    rest: int


def weights_of(network: nn.Module) -> Weights:
    """The weights of a network, which may be on the meta device."""
    layers = dict[str, int]()
    trained = frozen = 0
    for name, weight in network.named_parameters():
        if not weight.requires_grad:
            frozen += weight.numel() * weight.element_size()
            continue
        trained += weight.numel()
        before, inside, after = name.partition(LAYERS)
        if inside:
            layer = before + after.partition(".")[0]
            layers[layer] = layers.get(layer, 0) + weight.numel()
    return Weights(trained, frozen, max(layers.values(), default=0), trained - sum(layers.values()))


def least(weights: Weights, kind: str, processes: int) -> int:
    """Bytes that a process needs for weights, gradients and AdamW, whatever the batch."""
    if kind == "ddp" or processes == 1:
        return weights.frozen + TRAINED * weights.trained
    gathered = weights.trained if kind == "zero2" else weights.rest + 2 * weights.layer
    return weights.frozen + TRAINED * weights.trained // processes + SINGLE * gathered


def activations(network: Puma, samples: int) -> int:
    """Bytes of what the backward pass of so many samples needs of Qwen3-VL: with checkpointing the
    input of every layer, and one layer whole. 0 for the small backbone."""
    backbone: Any = network.backbone
    if not hasattr(backbone, "model"):
        return 0
    text, vision = backbone.model.config.text_config, backbone.model.config.vision_config
    tokens = (
        len(backbone.prefix)
        + 2 * BUCKET
        + len(network.extra)
        + len(network.queries)
        + len(backbone.after)
    )
    heads = 2 * (text.num_attention_heads + text.num_key_value_heads) * text.head_dim
    inside = 4 * text.hidden_size + heads + 3 * text.intermediate_size
    patches = int(backbone.seen.sum()) * vision.spatial_merge_size**2
    within = 8 * vision.hidden_size + 2 * vision.intermediate_size
    if backbone.checkpointing:
        numbers = tokens * (text.num_hidden_layers * text.hidden_size + inside)
        numbers += patches * (vision.depth * vision.hidden_size + within)
    else:
        numbers = tokens * text.num_hidden_layers * inside + patches * vision.depth * within
    return SINGLE * numbers * samples


@dataclass(frozen=True)
class Need:
    """What each of some processes takes (bytes): `state` for sure, `all` with bf16 copies and
    activations."""

    kind: str
    processes: int
    state: int
    all: int


def needs(config: Config, processes: Sequence[int]) -> list[Need]:
    """What a configuration takes on so many cards, each way; shares need two cards, and a network
    that is trained as a whole."""
    network = shell_of(config, usual_sizes(config))
    weights, out = weights_of(network), list[Need]()
    for count in processes:
        samples = -(-config.train.batch // (count * config.train.accumulate))
        besides = activations(network, samples) + HALF * weights.trained * (
            config.train.precision == "bf16"
        )
        for kind in KINDS:
            if kind == "ddp" or (count > 1 and not weights.frozen):
                state = least(weights, kind, count)
                out.append(Need(kind, count, state, state + besides))
    return out


def usual_sizes(config: Config) -> Sizes:
    """Sizes of a network for two arms of six joints and features of DINOv2's base size: others
    change the memory by nothing that counts."""
    return Sizes(14, 4 if config.model.world == "boxes" else 768)


def check(config: Config, accelerator: Accelerator) -> None:
    """Raise TrainError where a process cannot hold its weights, gradients and AdamW, with what
    could."""
    if accelerator.device.type == "cuda":
        what, has = "the card", torch.cuda.get_device_properties(accelerator.device).total_memory
    else:
        ram = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
        what, has = (
            "its share of this machine's memory",
            ram // max(1, int(os.environ.get("LOCAL_WORLD_SIZE", "1"))),
        )
    if reason := refusal(
        config,
        weights_of(shell_of(config, usual_sizes(config))),
        accelerator.num_processes,
        has,
        what,
    ):
        raise TrainError(reason)


def refusal(
    config: Config, weights: Weights, processes: int, has: int, what: str = "the card"
) -> str:
    """Why processes that have so many bytes each cannot train these weights, and what could; "" if
    they may."""
    kind = config.train.parallel
    takes = least(weights, kind, processes)
    if takes <= has:
        return ""
    counts = (2, 4, 8, 16) if not weights.frozen else ()
    ways = (
        (way, count, least(weights, way, count))
        for way in KINDS[1:]
        for count in counts
        if count >= processes
    )
    found: Mapping[str, str] = {
        way: f"train.parallel={way} over {count} processes ({size / GB:.0f} GB each)"
        for way, count, size in sorted(ways, key=lambda w: -w[1])
        if size <= 0.8 * has
    }
    other = [found[way] for way in KINDS[1:] if way in found]
    if config.model.backbone.kind != "tiny" and config.model.backbone.lora is None:
        other.append("adapters (model.backbone.lora={rank: 16}, train.parallel=ddp)")
    helps = " or ".join(other) or "a smaller network"
    count = f"{kind} over {processes} processes" if processes > 1 else "one process"
    return (
        f"{config.name}: {weights.trained / 1e9:.2f} billion trained weights take {takes / GB:.0f}"
        f" GB in {count}, {what} has {has / GB:.0f} GB: use {helps}"
    )


def table(found: Sequence[Need], cards: Sequence[int] = (24, 40, 48, 80, 141)) -> str:
    """Markdown: a row a way and number of processes, and on which cards (GB) it fits with a tenth
    to spare."""
    lines = [
        (
            "| train.parallel | cards | weights, gradients, AdamW (GB a card) | with activations |"
            " fits |"
        ),
        "|---|---:|---:|---:|---|",
    ]
    for need in found:
        fits = (
            ", ".join(f"{card} GB" for card in cards if need.all <= 0.9 * card * GB)
            or "none of these"
        )
        lines.append(
            f"| {need.kind} | {need.processes} | {need.state / GB:.1f} | {need.all / GB:.1f} |"
            f" {fits} |"
        )
    return "\n".join(lines)
