"""Object features: patch tokens averaged under a mask."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.annotate.stage import AnnotateError
from pipeline.poses import Bools, Floats32, Pixels

from .models import ModelFiles, image_settings, inference, load_model, pixels


@dataclass(eq=False)
class Encoder:
    """DINOv2 or DINOv3: `grid` x `grid` patches of an image `size` px square, after `prefix`
    tokens.
    """

    model: Any
    settings: dict[str, Any]
    size: int
    grid: int
    prefix: int
    device: str


def load_encoder(files: ModelFiles, size: int, device: str) -> Encoder:
    """Load an encoder. Raises AnnotateError for other files, or a size its patches do not
    divide."""
    from transformers import AutoModel

    model = load_model(AutoModel, files, device)
    patch = getattr(model.config, "patch_size", None)
    if not isinstance(patch, int):
        raise AnnotateError(f"model {files.name} is a {model.config.model_type}, no patch encoder")
    if size % patch:
        odd = f"feature size {size} is no multiple of the patch size {patch} of {files.name}"
        raise AnnotateError(f"{odd}: use {size // patch * patch}")
    prefix, settings = 1 + getattr(model.config, "num_register_tokens", 0), image_settings(files)
    return Encoder(model, settings, size, size // patch, prefix, device)


def patch_tokens(encoder: Encoder, frames: Pixels) -> Floats32:
    """Normalised patch tokens (N,grid,grid,D) of frames (N,H,W,3)."""
    with inference(encoder.device):
        x = pixels(frames, (encoder.size, encoder.size), encoder.settings, encoder.device)
        tokens = encoder.model(pixel_values=x).last_hidden_state[:, encoder.prefix :].float()
    return tokens.reshape(len(frames), encoder.grid, encoder.grid, -1).cpu().numpy()


def overlap(pixels_along: int, patches: int) -> Floats32:
    """Matrix (patches, pixels): covered length in patches; rows sum to 1."""
    edges = np.arange(pixels_along + 1) * patches / pixels_along
    low, high, place = edges[:-1], edges[1:], np.arange(patches)[:, None]
    return np.clip(np.minimum(high, place + 1) - np.maximum(low, place), 0, None).astype(np.float32)


def area_weights(mask: Bools, grid: tuple[int, int]) -> Floats32:
    """Covered fraction of each patch (..., rows, columns) for masks (...,H,W), exactly."""
    rows, columns = overlap(mask.shape[-2], grid[0]), overlap(mask.shape[-1], grid[1])
    return np.asarray(rows @ mask.astype(np.float32) @ columns.T, np.float32)


def pool(tokens: Floats32, mask: Bools) -> tuple[Floats32, Floats32]:
    """Features (N,K,D), the mean of tokens (N,g,g,D) under masks (N,K,H,W), and coverage (N,K)
    in patches.
    """
    weights = area_weights(mask, (tokens.shape[1], tokens.shape[2]))
    coverage = weights.sum((2, 3))
    summed = np.einsum("nkij,nijd->nkd", weights, tokens, optimize=True)
    return (summed / np.where(coverage > 0, coverage, 1.0)[..., None]).astype(np.float32), coverage


def features_of(
    encoder: Encoder, frames: Pixels, mask: Bools, batch: int
) -> tuple[NDArray[np.float16], Floats32]:
    """Features (T,K,D) fp16 and coverage (T,K) of frames (T,H,W,3)."""
    spans = [slice(start, start + batch) for start in range(0, len(frames), batch)]
    parts = [pool(patch_tokens(encoder, frames[span]), mask[span]) for span in spans]
    features, coverage = (np.concatenate(each) for each in zip(*parts, strict=True))
    return features.astype(np.float16), coverage
