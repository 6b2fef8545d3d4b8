"""Checkpoints: directories of safetensors and JSON, written atomically, from which a run resumes
and a policy acts.

model.safetensors       weights
optimizer.safetensors   state of AdamW by the name of the weight, and the generator of torch
state.json              step, sampler, hashes of the others
config.yaml, preprocessing.json
setup.yaml              `domino-data evaluate --like CHECKPOINT`
policy.py               `domino-data evaluate --policy CHECKPOINT/policy.py`
README.md               the model card
"""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
import yaml
from safetensors import SafetensorError, safe_open
from safetensors.torch import load_file, save_file
from safetensors.torch import save as to_bytes
from torch import Tensor, nn

from pipeline.data.atomic import atomic_directory, remove, write_atomic
from pipeline.data.keys import digest, file_hash
from pipeline.data.parsing import read_json, read_yaml
from pipeline.data.setup import SETUP_FILE
from training.puma.config import Config, parse_config
from training.puma.errors import TrainError
from training.puma.model.puma import Puma, Sizes, build_model
from training.puma.preprocess import Preprocessing
from training.puma.processes.parallel import like, whole

SCHEMA = 1
POLICY = '''"""A PUMA policy, weights {weights}, configuration {config}.

domino-data evaluate --policy THIS_FILE --cameras {cameras}
"""

from pathlib import Path

from training.puma.policy import PumaPolicy


def make_policy() -> PumaPolicy:
    return PumaPolicy.load(Path(__file__).parent)
'''


@dataclass(eq=False)
class Loaded:
    """A checkpoint: `step` optimiser steps done, and where the sampler stood."""

    path: Path
    step: int
    sampler: dict[str, Any]
    config: Config
    preprocessing: Preprocessing
    sizes: Sizes

    def model(self) -> Puma:
        """The network with its trained weights. Raises TrainError for weights of another
        network."""
        network = build_model(self.config, self.sizes, trained=True)
        load_weights(network, self.path)
        return network


@dataclass(eq=False)
class Standing:
    """What a run saves of itself beside weights."""

    step: int
    sampler: dict[str, Any]
    card: str


@dataclass(eq=False)
class Tensors:
    """Weights by name; state of the optimiser by `name|key`, and the generator of torch."""

    weights: dict[str, Tensor]
    optimizer: dict[str, Tensor]


def tensors_of(network: nn.Module, optimizer: torch.optim.Optimizer, keep: bool = True) -> Tensors:
    """What a checkpoint holds, gathered where it is in shares: every process calls it, and one of
    them keeps what it gets."""
    weights = _gather(network.state_dict().items(), keep)
    state: Mapping[Any, dict[str, Tensor]] = optimizer.state
    named = (
        (f"{name}|{key}", v)
        for name, weight in network.named_parameters()
        for key, v in state.get(weight, {}).items()
    )
    return Tensors(weights, {"generator": torch.get_rng_state(), **_gather(named, keep)})


def _gather(tensors: Iterable[tuple[str, Tensor]], keep: bool) -> dict[str, Tensor]:
    """Tensors by name, whole and on the processor; one after the other, so that no card holds them
    all."""
    out = dict[str, Tensor]()
    for name, value in tensors:
        found = whole(value)
        if keep:
            out[name] = found.cpu().contiguous()
    return out


def save(
    folder: Path, network: Puma, tensors: Tensors, preprocessing: Preprocessing, standing: Standing
) -> None:
    """Write a checkpoint. Raises OSError if the disk refuses; nothing half-written is left."""
    with atomic_directory(folder) as part:
        save_file(tensors.weights, part / "model.safetensors")
        save_file(tensors.optimizer, part / "optimizer.safetensors")
        text = json.dumps(preprocessing.to_dict(), indent=1)
        (part / "preprocessing.json").write_text(text + "\n")
        if preprocessing.setup:
            (part / SETUP_FILE).write_text(
                yaml.safe_dump(dict(preprocessing.setup), sort_keys=False)
            )
        (part / "config.yaml").write_text(network.config.to_yaml())
        weights, how = (
            file_hash(part / "model.safetensors")[:16],
            digest(network.config.model_dump(mode="json"))[:8],
        )
        state = {
            "schema": SCHEMA,
            "step": standing.step,
            "sampler": standing.sampler,
            "sizes": vars(network.sizes),
            "weights": weights,
            "preprocessing": preprocessing.digest,
        }
        (part / "state.json").write_text(json.dumps(state, indent=1) + "\n")
        (part / "policy.py").write_text(
            POLICY.format(weights=weights, config=how, cameras=",".join(preprocessing.cameras))
        )
        (part / "README.md").write_text(standing.card)


def load(folder: Path) -> Loaded:
    """Read what a checkpoint says, without its weights. Raises TrainError, one line."""
    folder = newest(folder)
    try:
        state = read_json(folder / "state.json")
        preprocessing = Preprocessing.from_dict(read_json(folder / "preprocessing.json"))
        config = parse_config(read_yaml(folder / "config.yaml"), str(folder / "config.yaml"))
        if state["schema"] != SCHEMA:
            raise ValueError(f"its schema is {state['schema']}, not {SCHEMA}")
        if preprocessing.digest != state["preprocessing"]:
            raise ValueError("preprocessing.json is not the one that the weights were trained with")
        return Loaded(
            folder, state["step"], state["sampler"], config, preprocessing, Sizes(**state["sizes"])
        )
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise TrainError(
            f"{folder}: is no checkpoint that can be used ({' '.join(str(error).split())[:200]})"
        ) from error


def newest(folder: Path) -> Path:
    """The checkpoint in a directory: itself, or the newest of a run. Raises TrainError if there is
    none."""
    if (folder / "state.json").exists():
        return folder
    found = checkpoints(folder)
    if not found:
        raise TrainError(
            f"{folder}: holds no checkpoint: name a directory that `puma train --out` has written"
        )
    return found[-1]


def checkpoints(run: Path) -> list[Path]:
    """Checkpoints of a run, the oldest first."""
    return sorted(path.parent for path in (run / "checkpoints").glob("step_*/state.json"))


def checkpoint_path(run: Path, step: int) -> Path:
    """Where the checkpoint of a step goes."""
    return run / "checkpoints" / f"step_{step:08d}"


def prune(run: Path, keep: int) -> None:
    """Leave the newest `keep` checkpoints."""
    for old in checkpoints(run)[:-keep]:
        remove(old)


def load_weights(network: nn.Module, folder: Path) -> None:
    """Put the weights of a checkpoint into a network of the same shape. Raises TrainError."""
    try:
        missing, unexpected = network.load_state_dict(
            load_file(folder / "model.safetensors"), strict=False
        )
    except (OSError, SafetensorError, RuntimeError) as error:
        raise TrainError(
            f"{folder}: weights cannot be loaded ({' '.join(str(error).split())[:200]})"
        ) from error
    if missing or unexpected:
        raise TrainError(
            f"{folder}: weights are of another network: {', '.join([*missing, *unexpected][:3])}"
        )


def save_finder(finder: nn.Module, path: Path | None, made_of: str) -> None:
    """Write a trained finder, with what its training depends on; nothing without a path."""
    if path is None:
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    held = {name: value.cpu().contiguous() for name, value in finder.state_dict().items()}
    write_atomic(path, to_bytes(held, {"made_of": made_of}))


def load_finder(finder: nn.Module, path: Path | None, made_of: str) -> bool:
    """Load what `save_finder` wrote, if it is there and made of the same; returns whether it was.

    Raises TrainError for a file that cannot be read."""
    if path is None or not path.exists():
        return False
    try:
        with safe_open(path, "pt") as held:
            if (held.metadata() or {}).get("made_of") != made_of:
                return False
        finder.load_state_dict(load_file(path))
    except (OSError, SafetensorError, RuntimeError) as error:
        raise TrainError(f"{path}: cannot be loaded ({error}): delete it") from error
    return True


def begin_from(network: nn.Module, folder: Path) -> None:
    """Put the weights of a checkpoint into a network that may have adapters beside them. Raises
    TrainError."""
    held = load_file(folder / "model.safetensors")
    weights = {
        name: held.get(name, held.get(name.replace(".base_layer", "")))
        for name in network.state_dict()
    }
    found = {name: value for name, value in weights.items() if value is not None}
    lacking = [name for name in weights if name not in found and ".lora_" not in name]
    wrong = [
        name
        for name, value in network.state_dict().items()
        if name in found and found[name].shape != value.shape
    ]
    if lacking or wrong:
        raise TrainError(
            f"{folder}: weights are of another network: {', '.join([*lacking, *wrong][:3])}"
        )
    network.load_state_dict(found, strict=False)


def load_optimizer(network: nn.Module, optimizer: torch.optim.Optimizer, folder: Path) -> None:
    """Put back the state of the optimiser and of the generator of torch. Raises TrainError."""
    try:
        # one tensor at a time: every process reads them, and together they take twice as much as
        # the weights
        with safe_open(folder / "optimizer.safetensors", "pt") as held:
            there = set(held.keys())
            torch.set_rng_state(held.get_tensor("generator"))
            for name, weight in network.named_parameters():
                keys = [
                    key for key in ("step", "exp_avg", "exp_avg_sq") if f"{name}|{key}" in there
                ]
                parts = {key: held.get_tensor(f"{name}|{key}") for key in keys}
                if parts:
                    optimizer.state[weight] = {
                        k: v if k == "step" else like(v, weight) for k, v in parts.items()
                    }
    except (OSError, SafetensorError, KeyError) as error:
        raise TrainError(
            f"{folder}: the optimiser's state cannot be loaded"
            f" ({' '.join(str(error).split())[:200]})"
        ) from error
