"""Networks by short name, hub id or directory, identified by the hash of their files."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.annotate.stage import AnnotateError, digest
from pipeline.data.keys import file_hash
from pipeline.data.parsing import read_json
from pipeline.poses import Pixels

_SAM, _DINO2 = ("tiny", "small", "base-plus", "large"), ("small", "base", "large", "giant")
_DINO3 = ("vits16", "vitb16", "vitl16")
ALIASES = {
    "grounding-dino-tiny": "IDEA-Research/grounding-dino-tiny",  # Swin-T, the paper's
    "grounding-dino-base": "IDEA-Research/grounding-dino-base",
    **{f"sam2.1-hiera-{s}": f"facebook/sam2.1-hiera-{s}" for s in _SAM},
    **{f"dinov2-{s}": f"facebook/dinov2-{s}" for s in _DINO2},
    **{f"dinov3-{s}": f"facebook/dinov3-{s}-pretrain-lvd1689m" for s in _DINO3},
}
_FILES: list[str] = ["*.json", "*.txt", "*.safetensors"]
_IMAGENET = ([0.485, 0.456, 0.406], [0.229, 0.224, 0.225])


class NoWeights(AnnotateError): ...


@dataclass(frozen=True)
class ModelFiles:
    """A model on this machine. `digest`, the hash of its files, alone enters keys."""

    name: str
    path: str
    digest: str


def resolve(name: str, download: bool = True) -> ModelFiles:
    """A local directory, else the hub's cache, else the hub. Raises NoWeights, AnnotateError."""
    path = Path(name)
    if not path.is_dir():
        if name.startswith(("/", ".", "~")):
            raise NoWeights(f"model directory {name} does not exist")
        path = _from_hub(ALIASES.get(name, name), download)
    if not (path / "config.json").is_file() or not list(path.glob("*.safetensors")):
        raise AnnotateError(f"{path} is no model directory: it needs config.json and *.safetensors")
    files = sorted({f for pattern in _FILES for f in path.glob(pattern)})
    return ModelFiles(name, str(path), digest([[f.name, file_hash(f.resolve())] for f in files]))


def _from_hub(repo: str, download: bool) -> Path:
    try:
        from huggingface_hub import errors, snapshot_download
    except ImportError as error:
        raise NoWeights(f"{repo} needs huggingface_hub: install the annotate extra") from error
    missing = errors.LocalEntryNotFoundError
    try:
        with contextlib.suppress(missing):
            return Path(snapshot_download(repo, local_files_only=True, allow_patterns=_FILES))
        if not download:
            raise NoWeights(f"model {repo} is not on this machine; the stage will download it")
        return Path(snapshot_download(repo, allow_patterns=_FILES))
    except (errors.HfHubHTTPError, errors.HFValidationError, missing, OSError) as error:
        raise NoWeights(
            f"model {repo} is not on this machine and cannot be downloaded"
            f" ({type(error).__name__}): run `hf download {repo}` where there is a network, or name"
            " a local directory that holds it (--mask-source sim needs no detector)"
        ) from error


def pick_device(device: str) -> str:
    try:
        import torch
    except ImportError as error:
        raise AnnotateError("install the annotate extra: models need torch") from error
    return ("cuda" if torch.cuda.is_available() else "cpu") if device == "auto" else device


def load_model(cls: type, files: ModelFiles, device: str) -> Any:
    from transformers.utils import logging

    logging.disable_progress_bar()
    given, name = {"local_files_only": True, "output_loading_info": True}, cls.__name__
    try:
        model, info = cls.from_pretrained(files.path, **given)
    except (OSError, ValueError, RuntimeError, KeyError) as error:
        why = f"cannot be loaded as {name}: {str(error).splitlines()[0]}"
        raise AnnotateError(f"model {files.name} {why}") from error
    # the library fills in random numbers for weights that a file lacks, and only warns
    if missing := sorted(info["missing_keys"]):
        raise AnnotateError(f"model {files.name} is no {name}: it has no {', '.join(missing[:2])}")
    return model.to(device).eval().requires_grad_(False)


@contextlib.contextmanager
def inference(device: str) -> Iterator[None]:
    """Without gradients, on a GPU in half precision."""
    import torch

    on_gpu = device.startswith("cuda")
    cast = torch.autocast("cuda", torch.float16) if on_gpu else contextlib.nullcontext()
    with torch.inference_mode(), cast:
        yield


def image_settings(files: ModelFiles) -> dict[str, Any]:
    settings: dict[str, Any] = {}
    for name in ("processor_config.json", "preprocessor_config.json"):
        path = Path(files.path) / name
        if path.is_file():
            content = read_json(path)
            settings |= content.get("image_processor", content)
    defaults = {"size": {}, "image_mean": _IMAGENET[0], "image_std": _IMAGENET[1]}
    return {name: settings.get(name, value) for name, value in defaults.items()}


def pixels(frames: Pixels, size: tuple[int, int], settings: dict[str, Any], device: str) -> Any:
    """Frames (N,H,W,3) uint8 as a normalised tensor (N,3,h,w) float32; `size` = (height, width)."""
    import torch
    import torch.nn.functional as functional

    x = torch.from_numpy(np.ascontiguousarray(frames)).to(device).permute(0, 3, 1, 2).float()
    if tuple(x.shape[2:]) != size:
        x = functional.interpolate(x, size, mode="bilinear", antialias=True, align_corners=False)
        x = x.clamp(0, 255).round()  # as the library's processors do
    numbers = (settings[name] for name in ("image_mean", "image_std"))
    mean, std = (torch.tensor(values, device=device).view(1, 3, 1, 1) for values in numbers)
    return (x / 255 - mean) / std
