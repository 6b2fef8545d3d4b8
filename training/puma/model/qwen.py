"""Qwen3-VL as a backbone: images at their own size, explicit positions, hidden states of the base
model at the queries.

The sequence is a user's turn: images of the past, views, instruction, further inputs, queries; then
the mark of the assistant's turn. Only the instruction differs in length; its padding stands between
it and what follows, is attended by nothing and takes no position, so every other token has a fixed
place.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn
from transformers import AutoTokenizer, Qwen3VLConfig, Qwen3VLModel

from pipeline.data.parsing import read_json
from training.puma.config import Config
from training.puma.errors import TrainError
from training.puma.model.inputs import Inputs
from training.puma.model.text import PADDING, HashedWords, TokenizedWords, Tokenizer
from training.puma.model.vision import Vision
from training.puma.model_keys import Backbone

UNIT = 32
"""Sides of images are multiples of this: patch size times merge size."""


@dataclass(frozen=True)
class Marks:
    """Token ids of all words but the instruction: before the images, before the queries of the
    world, between those and the queries of the actions, and after the queries."""

    before: Sequence[int]
    after: Sequence[int]
    world: Sequence[int] = ()
    action: Sequence[int] = ()


class QwenBackbone(nn.Module):
    """See the module."""

    prefix: Tensor
    seen: Tensor
    places: Tensor
    world: Tensor
    action: Tensor
    after: Tensor

    def __init__(self, model: Any, config: Config, marks: Marks) -> None:
        super().__init__()
        text = model.config.text_config
        self.model, self.width = model, int(text.hidden_size)
        self.checkpointing = config.train.checkpointing
        count = 0 if config.model.history == "none" else config.model.history_length
        self.past = Vision(model.visual, config.data.flow_size) if count else None
        self.views = Vision(model.visual, config.data.image_size)
        images = [self.past.grid] * count if self.past is not None else []
        images += [self.views.grid] * len(config.data.cameras)
        self.chunk = config.model.chunk
        ids, seen, places = _prefix(list(marks.before), images, model.config)
        self.register_buffer("prefix", torch.tensor(ids), persistent=False)
        self.register_buffer("seen", torch.tensor(seen), persistent=False)
        self.register_buffer("places", torch.tensor(places).T.contiguous(), persistent=False)
        for name in ("world", "action", "after"):
            words = torch.tensor(list(getattr(marks, name)), dtype=torch.long)
            self.register_buffer(name, words, persistent=False)

    def forward(self, inputs: Inputs, extras: Tensor, queries: Tensor) -> Tensor:
        """Hidden states (B,Q,width), after the last norm, at queries (Q,width); `extras`
        (B,E,width) stand before them."""
        b, embed = len(inputs), self.model.get_input_embeddings()
        images, deep = self._images(inputs)
        prefix = embed(self.prefix).expand(b, -1, -1)
        prefix = prefix.masked_scatter(self.seen[None, :, None], images.to(prefix.dtype))
        known = inputs.text >= 0
        text = embed(inputs.text.clamp(min=0))
        first, second = queries.to(text.dtype).tensor_split([len(queries) - self.chunk])
        tail = [embed(self.world), first, embed(self.action), second, embed(self.after)]
        tail = [part.expand(b, -1, -1) for part in tail]
        tokens = torch.cat([prefix, text, extras.to(text.dtype), *tail], 1)
        ones = known.new_ones(b, tokens.shape[1] - prefix.shape[1] - text.shape[1])
        attended = torch.cat([known.new_ones(b, prefix.shape[1]), known, ones], 1)
        visual = torch.zeros_like(attended)
        visual[:, : len(self.seen)] = self.seen
        hidden = self.model.language_model(
            inputs_embeds=tokens,
            attention_mask=attended.long(),
            position_ids=self._positions(attended[:, prefix.shape[1] :]),
            visual_pos_masks=visual,
            deepstack_visual_embeds=[layer.flatten(0, 1) for layer in deep],
            use_cache=False,
        ).last_hidden_state
        end = hidden.shape[1] - len(self.after)
        actions = hidden[:, end - self.chunk : end]
        end -= self.chunk + len(self.action)
        return torch.cat([hidden[:, end - len(first) : end], actions], 1)

    def _images(self, inputs: Inputs) -> tuple[Tensor, list[Tensor]]:
        """Tokens (B,V,width) of all images of a sample in their order, and those for the first
        layers."""
        b, on = len(inputs), self.checkpointing and self.training
        groups = (
            []
            if self.past is None or inputs.past is None
            else [self.past(inputs.past.flatten(0, 1), on)]
        )
        assert inputs.views is not None
        groups.append(self.views(inputs.views.flatten(0, 1), on))
        tokens = torch.cat([first.reshape(b, -1, self.width) for first, _ in groups], 1)
        layers = zip(*(deep for _, deep in groups), strict=True)
        return tokens, [
            torch.cat([part.reshape(b, -1, self.width) for part in layer], 1) for layer in layers
        ]

    def _positions(self, attended: Tensor) -> Tensor:
        """Positions (3,B,L) by time, row and column: those of the prefix, then one after the other
        what is attended (B,rest)."""
        first = self.places.max() + 1
        rest = first + attended.long().cumsum(1) - 1
        places = self.places[:, None].expand(-1, len(attended), -1)
        return torch.cat([places, rest.expand(3, -1, -1)], 2)


def _prefix(
    before: list[int], grids: Sequence[tuple[int, int]], config: Any
) -> tuple[list[int], list[bool], list[list[int]]]:
    """Token ids of all that stands before the instruction, which of them are images, and their
    positions [time, row, column]."""
    merge = config.vision_config.spatial_merge_size
    ids, seen, places = list(before), [False] * len(before), [[i] * 3 for i in range(len(before))]
    at = len(before)
    for height, width in ((h // merge, w // merge) for h, w in grids):
        ids += [
            config.vision_start_token_id,
            *[config.image_token_id] * (height * width),
            config.vision_end_token_id,
        ]
        seen += [False, *[True] * (height * width), False]
        places.append([at] * 3)
        places += [[at + 1, at + 1 + y, at + 1 + x] for y in range(height) for x in range(width)]
        at += 1 + max(height, width)
        places.append([at] * 3)
        at += 1
    return ids, seen, places


def build_qwen(config: Config, trained: bool) -> tuple[QwenBackbone, Tokenizer]:
    """The backbone and its tokenizer. `trained`: weights follow, so none are loaded. Raises
    TrainError for what cannot be had."""
    settings = config.model.backbone
    for name, size in (
        ("image_size", config.data.image_size),
        ("flow_size", config.data.flow_size),
    ):
        if size[0] % UNIT or size[1] % UNIT:
            raise TrainError(
                f"data.{name} {size[0]}x{size[1]}: Qwen3-VL takes sides that are multiples of"
                f" {UNIT}"
            )
    half = config.train.precision == "bf16" and (trained or settings.lora is not None)
    try:
        model = _weights(settings, half, settings.weights == "random" or trained)
        own = settings.name.endswith(".json")
        tokenizer = (
            None if own else AutoTokenizer.from_pretrained(settings.name, **_revision(settings))
        )
    except (OSError, ValueError) as error:
        reason = " ".join(str(error).split())[:200]
        raise TrainError(
            f"model.backbone.name {settings.name}: {reason}; give a hub id, a directory or a"
            " config.json"
        ) from error
    if config.train.checkpointing:
        model.language_model.activation_checkpointing_enable({"use_reentrant": False})
    if settings.lora is not None:
        model = _with_adapters(model, settings)
    if tokenizer is None:
        # the last id of a config's vocabulary stands for all marks that a tokenizer would have
        mark = model.config.text_config.vocab_size - 1
        words = HashedWords(mark)
        return QwenBackbone(model, config, _marks(config, words, [mark], [mark])), words
    before, after = (
        tokenizer(text, add_special_tokens=False)["input_ids"]
        for text in ("<|im_start|>user\n", "<|im_end|>\n<|im_start|>assistant\n")
    )
    words = TokenizedWords(tokenizer)
    return QwenBackbone(model, config, _marks(config, words, before, after)), words


def _marks(config: Config, words: Tokenizer, before: Sequence[int], after: Sequence[int]) -> Marks:
    """All words but the instruction, with the sentences of the published code where
    `model.sentences` asks for them."""
    model = config.model
    if not model.sentences:
        return Marks(before, after)

    def ids(text: str) -> list[int]:
        return [number for number in words.ids([text])[0].tolist() if number != PADDING]

    stop = ids(".")
    world = ids(" Predict future object states: ") if model.world != "none" else []
    ask = ids(f" Predict the next {model.chunk} robot actions: ")
    return Marks(before, [*stop, *after], world, [*(stop if world else []), *ask])


def _weights(settings: Backbone, half: bool, random: bool) -> Any:
    """The base model, without the layer of vocabulary logits; `half`: in bf16, for weights that are
    not trained."""
    revision = _revision(settings)
    if settings.name.endswith(".json"):
        if settings.weights != "random":
            raise ValueError("a config has no weights: set model.backbone.weights to random")
        found = Qwen3VLConfig(**read_json(Path(settings.name)))
    elif random:
        found = Qwen3VLConfig.from_pretrained(settings.name, **revision)
    else:
        kind = torch.bfloat16 if half else torch.float32
        return Qwen3VLModel.from_pretrained(settings.name, **revision, dtype=kind)
    found._attn_implementation = "sdpa"
    model: Any = Qwen3VLModel(found)
    for weight in model.parameters():
        # the weights only: frequencies of positions that are rounded to bf16 are wrong by half a
        # radian after 300 tokens
        weight.data = weight.data.to(torch.bfloat16 if half else torch.float32)
    return model


def _revision(settings: Backbone) -> dict[str, Any]:
    return {} if settings.revision is None else {"revision": settings.revision}


def _with_adapters(model: Any, settings: Backbone) -> Any:
    """The model with adapters in the linear layers of its language model; only they are trained."""
    from peft import LoraConfig, inject_adapter_in_model

    assert settings.lora is not None
    targets = r".*language_model\.layers\.\d+\.(self_attn\.(q|k|v|o)_proj|mlp\.(gate|up|down)_proj)"
    lora = settings.lora
    options = LoraConfig(
        r=lora.rank, lora_alpha=lora.alpha, lora_dropout=lora.dropout, target_modules=targets
    )
    model.requires_grad_(False)
    model = inject_adapter_in_model(options, model)
    for weight in model.parameters():
        if weight.requires_grad:
            weight.data = weight.data.float()
    return model
