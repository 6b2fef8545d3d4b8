"""The policy network: backbone, queries of its own for every output, heads in float32."""

from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

from training.puma.config import Config
from training.puma.model.finder import FinderNet
from training.puma.model.heads import (
    ActionHead,
    ActionHeads,
    WorldHead,
    action_loss,
    box_loss,
    feature_loss,
    mode_loss,
)
from training.puma.model.inputs import Inputs
from training.puma.model.oracle import Oracle, oracle_size
from training.puma.model.perceptron import PerceptronBackbone, PerceptronMembers
from training.puma.model.text import HashedWords, Tokenizer
from training.puma.model.tiny import TinyBackbone
from training.puma.track import CHOICES, aim_numbers, track_numbers

FARTHEST = 8.0
"""Standard deviations at which numbers are clipped: a target that is taken for something else may
be found anywhere."""


CHOOSER = 32
"""Width of the network that chooses arms."""

IGNORED = -100
"""Stands for the arms of a frame from which their choice is not learned."""


@dataclass(eq=False)
class Outputs:
    """`actions` (B,K,A) normalised; `world` (B,N,D), or None if nothing is predicted; logits
    `choice` (B,CHOICES) and `touched` (B,) likewise.

    Where the policy chooses among M chunks: `chunks` (B,M,K,A) and `scores` (B,M); `actions` are
    those with the highest score. Where it has M members: their `chunks`; `actions` are the mean."""

    actions: Tensor
    world: Tensor | None
    choice: Tensor | None = None
    chunks: Tensor | None = None
    scores: Tensor | None = None
    touched: Tensor | None = None


@dataclass(eq=False)
class Targets:
    """What outputs should be: `action` (B,K,A), `action_valid` (B,K), for the world `world`
    (B,N,D), `world_valid` (B,N), `choice` (B,), and whether nothing touched the target, `free`
    (B,). The latter is learned of rows that are `judged` (B,), by default all."""

    action: Tensor
    action_valid: Tensor
    world: Tensor | None = None
    world_valid: Tensor | None = None
    choice: Tensor | None = None
    free: Tensor | None = None
    judged: Tensor | None = None


@dataclass(frozen=True)
class Sizes:
    """Numbers that follow from the data: joints, entries of a world target, and tasks that
    sentences are taken for."""

    joints: int
    world: int
    tasks: int = 0


class Standard(nn.Module):
    """Numbers (B,F) in standard deviations from the mean of those that `fit` was given."""

    mean: Tensor
    spread: Tensor

    def __init__(self, numbers: int) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(numbers))
        self.register_buffer("spread", torch.ones(numbers))

    def fit(self, values: Tensor, floor: float = 1e-3) -> None:
        """Take the scale of values (N,F); one that deviates by less than `floor` is divided by
        it."""
        self.mean.copy_(values.mean(0))
        self.spread.copy_(values.std(0).clamp(min=floor))

    def forward(self, values: Tensor) -> Tensor:
        return ((values - self.mean) / self.spread).clamp(-FARTHEST, FARTHEST)


class Chooser(nn.Module):
    """Numbers (B,F) -> logits (B,N), by a perceptron of two small layers."""

    def __init__(self, numbers: int, choices: int) -> None:
        super().__init__()
        self.first, self.second, self.third = (
            nn.Linear(a, b) for a, b in pairwise((numbers, CHOOSER, CHOOSER, choices))
        )

    def forward(self, given: Tensor) -> Tensor:
        return self.third(self.second(self.first(given).relu()).relu())


class Puma(nn.Module):
    """See the package. `backbone(inputs, extras, queries)` gives hidden states at the queries;
    `backbone.width` is their width."""

    def __init__(self, config: Config, sizes: Sizes, backbone: nn.Module, words: Tokenizer) -> None:
        super().__init__()
        model, width = config.model, int(backbone.width)  # pyright: ignore[reportArgumentType]
        self.config, self.sizes, self.words = config, sizes, words
        self.backbone = backbone
        self.queries = nn.Parameter(0.02 * torch.randn(model.queries, width))
        self.extra = nn.ModuleDict(
            {name: nn.Linear(n, width) for name, n in extra_sizes(config, sizes).items()}
        )
        self.action_head = (
            ActionHead(width, model.modes * sizes.joints)
            if model.members == 1
            else ActionHeads(width, sizes.joints, model.members)
        )
        self.mode_head = nn.Linear(width, model.modes) if model.modes > 1 else None
        self.world_head = WorldHead(width, sizes.world) if model.world != "none" else None
        self.oracle = Oracle(width, oracle_size(model.chunk)) if model.oracle else None
        self.finder = self.aim_scale = self.chooser = self.toucher = None
        if (track := model.track) is not None:
            self.finder = FinderNet(track, model.backbone.words, sizes.tasks)
            self.finder.requires_grad_(False)
            aimed = aim_numbers(track.points, track.bodies, track.near)
            self.aim_scale = Standard(aimed)
            self._tracked = track.bodies * track_numbers(track.points)
            if model.arms:
                self.chooser = Chooser(self._tracked + track.words, len(CHOICES))
            if model.touched:
                self.toucher = Chooser(aimed + sizes.joints + track.words, 1)

    def train(self, mode: bool = True) -> "Puma":
        """See torch. A finder that knows its tasks reads in training as it does afterwards."""
        super().train(mode)
        if self.finder is not None and self.sizes.tasks:
            self.finder.eval()
        return self

    def forward(self, inputs: Inputs) -> Outputs:
        """Actions and the later world."""
        own = ("choice", "told")
        given = {name: getattr(inputs, name).flatten(1) for name in self.extra if name not in own}
        told = None if self.finder is None else self.finder.read(inputs.text)
        if told is not None:
            given["told"] = told
        choice = None if self.chooser is None else self.choose(given["aims"], told)
        touched = None if self.toucher is None else self.touch(given["aims"], given["state"], told)
        if self.aim_scale is not None:
            given["aims"] = self.aim_scale(given["aims"])
        if inputs.choice is not None and self.chooser is not None:
            given["choice"] = functional.one_hot(inputs.choice, len(CHOICES)).float()
        extras = [layer(given[name])[:, None] for name, layer in self.extra.items()]
        empty = self.queries.new_zeros(len(inputs), 0, self.queries.shape[1])
        hidden = self.backbone(
            inputs, torch.cat(extras, 1) if extras else empty, self.queries
        ).float()
        device = hidden.device.type
        with torch.autocast(device, enabled=False):
            before, last = (
                hidden[:, : -self.config.model.chunk],
                hidden[:, -self.config.model.chunk :],
            )
            if self.oracle is not None and inputs.oracle is not None:
                last = self.oracle(last, inputs.oracle)
            world, actions = (
                None if self.world_head is None else self.world_head(before),
                self.action_head(last),
            )
            if actions.shape[-1] == self.sizes.joints:
                return Outputs(actions, world, choice, touched=touched)
            chunks = actions.unflatten(-1, (-1, self.sizes.joints)).transpose(1, 2)
            if self.mode_head is None:
                return Outputs(chunks.mean(1), world, choice, chunks, touched=touched)
            scores = self.mode_head(last.mean(1))
            best = chunks[torch.arange(len(chunks)), scores.argmax(1)]
            return Outputs(best, world, choice, chunks, scores, touched)

    def choose(self, aims: Tensor, told: Tensor | None) -> Tensor:
        """Logits (B,CHOICES) of the arms for `aims` (B,F) and embedded sentences (B,E), from the
        track and the sentence alone: the arm that has moved is not the reason to move it."""
        assert self.chooser is not None and self.aim_scale is not None
        seen = self.aim_scale(aims)[:, : self._tracked]
        return self.chooser(seen if told is None else torch.cat([seen, told], 1))

    def touch(self, aims: Tensor, state: Tensor, told: Tensor | None) -> Tensor:
        """Logits (B,) that the target has been touched, for `aims` (B,F), joints (B,A), and
        embedded sentences (B,E)."""
        assert self.toucher is not None and self.aim_scale is not None
        seen = [self.aim_scale(aims), state, *([] if told is None else [told])]
        return self.toucher(torch.cat(seen, 1))[:, 0]

    def losses(self, outputs: Outputs, targets: Targets) -> dict[str, Tensor]:
        """`action`, `mode` where several chunks are predicted, `world` where it is, and their
        weighted sum `loss`."""
        over = self.config.train.action_loss
        chunks = outputs.actions[:, None] if outputs.chunks is None else outputs.chunks
        if outputs.scores is None:
            # members learn by themselves: only then do their errors differ, and the mean has less
            wanted, valid = targets.action[:, None], targets.action_valid[:, None]
            found = {"action": action_loss(chunks, wanted, valid.expand(chunks.shape[:3]), over)}
            found["loss"] = found["action"]
        else:
            action, mode = mode_loss(
                chunks, outputs.scores, targets.action, targets.action_valid, over
            )
            found = {"action": action, "mode": mode, "loss": action + mode}
        if (
            outputs.world is not None
            and targets.world is not None
            and targets.world_valid is not None
        ):
            measure = box_loss if self.config.model.world == "boxes" else feature_loss
            found["world"] = measure(outputs.world, targets.world, targets.world_valid)
            found["loss"] = found["loss"] + self.config.train.world_weight * found["world"]
        if outputs.choice is not None and targets.choice is not None:
            wrong = functional.cross_entropy(
                outputs.choice, targets.choice, ignore_index=IGNORED, reduction="sum"
            )
            found["choice"] = wrong / (targets.choice != IGNORED).sum().clamp(min=1)
            found["loss"] = found["loss"] + found["choice"]
        if outputs.touched is not None and targets.free is not None:
            judged = torch.ones_like(targets.free) if targets.judged is None else targets.judged
            found["touched"] = functional.binary_cross_entropy_with_logits(
                outputs.touched, (~targets.free).float(), judged.float()
            )
            found["loss"] = found["loss"] + found["touched"]
        return found


def extra_sizes(config: Config, sizes: Sizes) -> dict[str, int]:
    """Numbers of each further input, in their order; each becomes one token."""
    model, track = config.model, config.model.track
    wanted = {
        "past_time": model.history_length if model.history_times and model.history != "none" else 0,
        "state": sizes.joints if model.state else 0,
        "clock": 1 if model.clock else 0,
        "aims": aim_numbers(track.points, track.bodies, track.near) if track else 0,
        "told": track.words if track else 0,
        "choice": len(CHOICES) if model.arms else 0,
        "touched": 1 if model.touched else 0,
    }
    return {name: n for name, n in wanted.items() if n}


def build_model(config: Config, sizes: Sizes, trained: bool = False) -> Puma:
    """The network with its first weights, from the global generator of torch. `trained`: weights
    follow, none are loaded."""
    extras = len(extra_sizes(config, sizes))
    kind, size = config.model.backbone.kind, config.model.backbone.words
    if kind == "tiny":
        return Puma(config, sizes, TinyBackbone(config, extras), HashedWords(size))
    if kind == "perceptron":
        pieces = config.model.track is not None and config.model.track.words > 0
        words = HashedWords(size, pieces=pieces)
        backbone = PerceptronBackbone if config.model.members == 1 else PerceptronMembers
        return Puma(config, sizes, backbone(config, extras), words)
    from training.puma.model.qwen import build_qwen

    backbone, words = build_qwen(config, trained)
    return Puma(config, sizes, backbone, words)
