"""The image encoder of Qwen3-VL for many images of one size: the modules of transformers, called as
one batch.

transformers packs all images into one sequence and attends image by image; here images of one size
are a batch dimension, patches are embedded by one matrix product instead of a 3-D convolution, and
positions are computed once for each size. Nothing depends on the content of a tensor, so the whole
can be captured as one graph.
"""

from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional
from torch.utils.checkpoint import checkpoint
from transformers.models.qwen3_vl.modeling_qwen3_vl import apply_rotary_pos_emb_vision
from transformers.vision_utils import (
    get_vision_interpolation_indices_and_weights,
    get_vision_position_ids,
)


def patches_of(images: Tensor, patch: int, merge: int, frames: int) -> Tensor:
    """Images (N,H,W,3) uint8 -> patches (N, P, 3 frames patch patch) float from -1 to 1, in blocks
    of merge x merge.

    The image is repeated `frames` times, as for a still. H and W are multiples of patch * merge.
    """
    n, height, width, _ = images.shape
    rows, columns = height // patch, width // patch
    x = (images.permute(0, 3, 1, 2).float() / 127.5 - 1).reshape(
        n, 3, rows // merge, merge, patch, columns // merge, merge, patch
    )
    x = x.permute(0, 2, 5, 3, 6, 1, 4, 7).unsqueeze(6)
    return x.expand(-1, -1, -1, -1, -1, -1, frames, -1, -1).reshape(
        n, rows * columns, 3 * frames * patch * patch
    )


class Vision(nn.Module):
    """Calls the encoder `visual` of a Qwen3-VL model, whose weights it does not own, for images of
    one size."""

    indices: Tensor
    weights: Tensor
    positions: Tensor

    def __init__(self, visual: Any, size: tuple[int, int]) -> None:
        super().__init__()
        config = visual.config
        self._visual = (visual,)
        self._patch, self._merge, self._frames = (
            config.patch_size,
            config.spatial_merge_size,
            config.temporal_patch_size,
        )
        self.grid = size[0] // self._patch, size[1] // self._patch
        grid = torch.tensor([[1, *self.grid]])
        indices, weights = get_vision_interpolation_indices_and_weights(
            grid,
            num_grid_per_side=visual.num_grid_per_side,
            mode=visual.interpolation_mode,
            align_corners=visual.interpolation_align_corners,
            spatial_merge_size=self._merge,
        )
        self.register_buffer("indices", indices, persistent=False)
        self.register_buffer("weights", weights, persistent=False)
        self.register_buffer(
            "positions", get_vision_position_ids(grid, self._merge), persistent=False
        )

    @property
    def tokens(self) -> int:
        """Tokens of an image in the language model."""
        return self.grid[0] * self.grid[1] // self._merge**2

    def forward(self, images: Tensor, checkpointing: bool = False) -> tuple[Tensor, list[Tensor]]:
        """Tokens (N,T,H) of images (N,height,width,3) uint8, and as many for each of the first
        layers of the language model."""
        visual = self._visual[0]
        embed = visual.patch_embed.proj
        patches = patches_of(images, self._patch, self._merge, self._frames).to(embed.weight.dtype)
        x = functional.linear(patches, embed.weight.flatten(1), embed.bias)
        x = x + (visual.pos_embed(self.indices) * self.weights[:, :, None]).sum(1).to(x.dtype)
        rotary = visual.rotary_pos_emb(x, self.positions)
        deep: list[Tensor] = []
        for number, block in enumerate(visual.blocks):
            x = _again(block, x, rotary) if checkpointing else _block(block, x, rotary)
            if number in visual.deepstack_visual_indexes:
                merger = visual.deepstack_merger_list[visual.deepstack_visual_indexes.index(number)]
                deep.append(self._merge_patches(merger, x))
        return self._merge_patches(visual.merger, x), deep

    def _merge_patches(self, merger: Any, x: Tensor) -> Tensor:
        return merger(x.flatten(0, 1)).view(len(x), self.tokens, -1)


def _again(block: Any, x: Tensor, rotary: tuple[Tensor, Tensor]) -> Tensor:
    """As `_block`, keeping nothing for the backward pass."""
    found = checkpoint(_block, block, x, rotary, use_reentrant=False)
    assert isinstance(found, Tensor)
    return found


def _block(block: Any, x: Tensor, rotary: tuple[Tensor, Tensor]) -> Tensor:
    """One transformer block on a batch (N,P,C)."""
    n, length, width = x.shape
    attention = block.attn
    q, k, v = attention.qkv(block.norm1(x)).view(n, length, 3, attention.num_heads, -1).unbind(2)
    q, k = apply_rotary_pos_emb_vision(q, k, *rotary)
    q, k, v = (part.transpose(1, 2) for part in (q, k, v))
    seen = functional.scaled_dot_product_attention(q, k, v, scale=attention.scaling)
    x = x + attention.proj(seen.transpose(1, 2).reshape(n, length, width))
    return x + block.mlp(block.norm2(x))
