"""A small backbone that is trained from scratch: convolutions that locate points, and a transformer
over one token a thing.

It has the interface of the large one. Instructions are bags of words, which tells tasks and colors
apart and little more.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional

from training.puma.config import Config
from training.puma.model.inputs import Inputs


class Points(nn.Module):
    """Images (N,3,h,w) from -1 to 1 -> (N, 3 M): where M filters respond (expected column and row,
    -1 to 1), and how strongly.

    Normalisation and responses that are sharp from the start are what makes it find anything:
    without them its points stay in the middle of the image for the first thousand steps. With
    `told`, so many numbers (N,told) scale and shift every layer's responses.
    """

    def __init__(self, points: int, width: int = 32, told: int = 0) -> None:
        super().__init__()
        self.body = nn.Sequential(
            *_block(3, width, 7, 4),
            *_block(width, width, 3, 1),
            *_block(width, width, 3, 1),
            nn.Conv2d(width, points, 1),
        )
        self.sharpness = nn.Parameter(torch.full((points,), 4.0))
        self.told = nn.Linear(told, 6 * width) if told else None

    def forward(self, images: Tensor, told: Tensor | None = None) -> Tensor:
        maps = images
        changes = iter(() if self.told is None else self.told(told)[..., None, None].chunk(6, 1))
        for layer in self.body:
            maps = layer(maps)
            if self.told is not None and isinstance(layer, nn.GELU):
                maps = maps * (1 + next(changes)) + next(changes)
        n, points, height, width = maps.shape
        flat = maps.flatten(2).float() * self.sharpness[:, None]
        share = flat.softmax(-1)
        rows = torch.linspace(-1, 1, height, device=images.device)
        columns = torch.linspace(-1, 1, width, device=images.device)
        y = (share.view(n, points, height, width).sum(3) * rows).sum(2)
        x = (share.view(n, points, height, width).sum(2) * columns).sum(2)
        return torch.cat([x, y, (share * flat).sum(-1).tanh()], -1)


class Summary(nn.Module):
    """Images (N,3,h,w) from -1 to 1 -> (N,width): what is to be seen where, at a sixteenth of the
    resolution."""

    def __init__(self, size: tuple[int, int], width: int) -> None:
        super().__init__()
        self.body = nn.Sequential(
            *_block(3, 24, 5, 4), *_block(24, 32, 3, 2), *_block(32, 32, 3, 2)
        )
        with torch.no_grad():
            # on the device of the weights, which may be meta
            numbers = self.body(next(self.body.parameters()).new_zeros(1, 3, *size)).numel()
        self.out = nn.Linear(numbers, width)

    def forward(self, images: Tensor) -> Tensor:
        return self.out(self.body(images).flatten(1))


def _block(before: int, after: int, size: int, stride: int) -> tuple[nn.Module, ...]:
    return nn.Conv2d(before, after, size, stride, size // 2), nn.GroupNorm(4, after), nn.GELU()


class Layer(nn.Module):
    """A pre-norm transformer layer without a mask."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.norm1, self.norm2 = nn.LayerNorm(width), nn.LayerNorm(width)
        self.qkv, self.out = nn.Linear(width, 3 * width), nn.Linear(width, width)
        self.up, self.down = nn.Linear(width, 2 * width), nn.Linear(2 * width, width)

    def forward(self, x: Tensor) -> Tensor:
        b, length, width = x.shape
        q, k, v = self.qkv(self.norm1(x)).view(b, length, 3, self.heads, -1).permute(2, 0, 3, 1, 4)
        x = x + self.out(
            functional.scaled_dot_product_attention(q, k, v)
            .transpose(1, 2)
            .reshape(b, length, width)
        )
        return x + self.down(functional.gelu(self.up(self.norm2(x))))


class TinyBackbone(nn.Module):
    """A small transformer whose tokens are those of views, past images and the instruction, the
    extra tokens and the queries.

    A view has a points token and a summary token, an image of the past a summary token. Every place
    has a learned embedding."""

    def __init__(self, config: Config, extras: int) -> None:
        super().__init__()
        settings, model, data = config.model.backbone, config.model, config.data
        self.width = settings.width
        self.points = Points(settings.keypoints)
        self.locate = nn.Linear(3 * settings.keypoints, self.width)
        self.summary = Summary(data.image_size, self.width)
        past = 0 if model.history == "none" else model.history_length
        self.past = Summary(data.flow_size, self.width) if past else None
        self.words = nn.Embedding(settings.words, self.width)
        self.place = nn.Parameter(
            0.02 * torch.randn(2 * len(data.cameras) + past + 1 + extras, self.width)
        )
        self.layers = nn.ModuleList(
            [Layer(self.width, settings.heads) for _ in range(settings.layers)]
        )
        self.norm = nn.LayerNorm(self.width)

    def forward(self, inputs: Inputs, extras: Tensor, queries: Tensor) -> Tensor:
        """Hidden states (B,Q,width) at queries (Q,width); `extras` (B,E,width) are further
        inputs."""
        assert inputs.views is not None
        b = len(inputs)
        views = _planes(inputs.views)
        tokens = [
            self.locate(self.points(views)).view(b, -1, self.width),
            self.summary(views).view(b, -1, self.width),
        ]
        if self.past is not None and inputs.past is not None:
            tokens.append(self.past(_planes(inputs.past)).view(b, -1, self.width))
        known = (inputs.text >= 0)[..., None]
        words = self.words(inputs.text.clamp(min=0)) * known
        tokens.append(words.sum(1, keepdim=True) / known.sum(1, keepdim=True).clamp(min=1))
        context = torch.cat([*tokens, extras], 1) + self.place
        x = torch.cat([context, queries.expand(b, -1, -1)], 1)
        for layer in self.layers:
            x = layer(x)
        return self.norm(x[:, -len(queries) :])


def _planes(images: Tensor) -> Tensor:
    """(B,n,h,w,3) uint8 -> (B n,3,h,w) float from -1 to 1."""
    return images.flatten(0, 1).permute(0, 3, 1, 2).float() / 127.5 - 1
