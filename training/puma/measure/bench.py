"""How fast a configuration trains, loads and answers here, on made-up data of its sizes."""

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import torch

from pipeline.data.cameras import look
from pipeline.data.names import SIDES
from pipeline.evaluate.policies.policy import Observation, Start
from training.puma.config import Config, MixtureSource
from training.puma.corpus.cache import Cache
from training.puma.corpus.mixture import Corpus, preprocessing_of
from training.puma.corpus.shards import Row
from training.puma.corpus.split import SplitFrames
from training.puma.loop.loader import Loader
from training.puma.loop.rates import groups
from training.puma.model.inputs import on
from training.puma.model.puma import Puma, build_model
from training.puma.policy import PumaPolicy
from training.puma.processes.flops import forward_flops, peak_flops
from training.puma.track import track_numbers
from training.puma.train import sizes_of

EPISODE = 100
"""Frames of a made-up episode."""

JOINTS = tuple(
    f"{side}_{name}" for side in SIDES for name in (*(f"joint{i}" for i in range(1, 7)), "gripper")
)
EMBODIMENT = "aloha-agilex"
OVERHEAD = look((0.0, 0.0, 2.0), (0.0, 0.0, -1.0), (-1.0, 0.0, 0.0))
SOURCE_SIZE = 240, 320
FEATURE = 768


def made_up(config: Config, folder: Path, frames: int = 500) -> Corpus:
    """A corpus of random numbers, on disk and memory-mapped as a real one."""
    model, data, rng = config.model, config.data, np.random.default_rng(0)
    shapes: dict[str, tuple[tuple[int, ...], Any]] = {
        f"image_{c}": ((*data.image_size, 3), np.uint8) for c in data.cameras
    }
    shapes |= {"state": ((len(JOINTS),), np.float32), "action": ((len(JOINTS),), np.float32)}
    shapes |= {"time": ((), np.float32), "position": ((3,), np.float32)}
    if model.track:
        shapes |= {
            "target": ((7,), np.float32),
            "camera": ((7,), np.float32),
            "free": ((), np.bool_),
        }
        shapes |= {
            "track": ((model.track.bodies * track_numbers(model.track.points),), np.float32),
            "tools": ((len(SIDES), 3), np.float32),
        }
    if model.history != "none":
        shapes["past"] = (*data.flow_size, 3), np.uint8
    if model.world != "none":
        shapes |= {
            "world": ((4 if model.world == "boxes" else FEATURE,), np.float16),
            "valid": ((), np.bool_),
        }
    arrays = {}
    for name, (shape, kind) in shapes.items():
        array = np.lib.format.open_memmap(
            folder / f"{name}.npy", mode="w+", dtype=kind, shape=(frames, *shape)
        )
        array[:] = (
            OVERHEAD
            if name == "camera"
            else rng.integers(0, 2 if kind is np.bool_ else 200, array.shape).astype(kind)
        )
        array.flush()
        arrays[name] = np.load(folder / f"{name}.npy", mmap_mode="r")
    rows = [
        Row(i, "", EPISODE, EMBODIMENT, str(i), "target", ("press the bell now",))
        for i in range(frames // EPISODE)
    ]
    cache = Cache(folder, 15, JOINTS, dict.fromkeys(data.cameras, SOURCE_SIZE), rows, arrays)
    config = config.model_copy(
        update={"data": data.model_copy(update={"sources": (MixtureSource(dataset=folder),)})}
    )
    part = SplitFrames.of(cache, range(len(rows)))
    return Corpus(config, [part], [], preprocessing_of(config, [cache], [part]), [1.0])


def seconds_of(work: Callable[[], object], repeats: int = 5) -> float:
    """Median wall time (s) of a call, after one that does not count."""
    work()
    spent: list[float] = []
    for _ in range(repeats):
        began = time.perf_counter()
        work()
        spent.append(time.perf_counter() - began)
    return median(spent)


def loading(corpus: Corpus, network: Puma) -> dict[str, float]:
    """Samples a second of the loader alone, on this thread."""
    loader = Loader(corpus, network.words)
    return {"loader, samples/s": corpus.config.train.batch / seconds_of(loader.make, 10)}


def learning(corpus: Corpus, network: Puma, device: torch.device) -> dict[str, float]:
    """Samples a second of forward and backward with the optimiser, their split, MFU, and the same
    beside the bare backbone."""
    config = corpus.config
    batch = Loader(corpus, network.words).make()
    inputs = batch.inputs.to(device)
    targets = on(batch.targets, device)
    optimizer = torch.optim.AdamW(groups(network, config.train))
    half = torch.autocast(device.type, torch.bfloat16, enabled=config.train.precision == "bf16")

    def forward() -> torch.Tensor:
        with half:
            loss = network.losses(network(inputs), targets)["loss"]
        return loss

    def step() -> None:
        forward().backward()
        optimizer.step()
        optimizer.zero_grad()
        _wait(device)

    def bare() -> None:
        empty = network.queries.new_zeros(len(inputs), len(network.extra), network.queries.shape[1])
        with half:
            network.backbone(inputs, empty, network.queries).float().sum().backward()
        network.zero_grad()
        _wait(device)

    network.train()
    whole, backbone, ahead = (
        seconds_of(step),
        seconds_of(bare),
        seconds_of(lambda: (forward(), _wait(device))),
    )
    flops = 3 * forward_flops(network, inputs)
    rate = len(inputs) / whole
    return {
        "training, samples/s": rate,
        "training, samples/s of the bare backbone": len(inputs) / backbone,
        "training, share of the bare backbone": backbone / whole,
        "training, forward share": ahead / whole,
        "training, GFLOP a sample": flops / len(inputs) / 1e9,
        "training, MFU": flops / whole / peak_flops(device),
    }


def answering(
    corpus: Corpus, network: Puma, device: torch.device, compiled: bool = False
) -> dict[str, float]:
    """Milliseconds of one answer at batch 1: preprocessing, network, the bare backbone, all."""
    prep = corpus.preprocessing
    policy = PumaPolicy(network, prep, device=device.type)
    if compiled:
        policy.compile()
    rng = np.random.default_rng(0)
    images = {
        camera: rng.integers(0, 256, (*SOURCE_SIZE, 3), dtype=np.uint8) for camera in prep.cameras
    }
    policy.reset(
        Start(
            "press the bell now",
            EMBODIMENT,
            prep.names,
            prep.fps,
            prep.cameras,
            0,
            prep.source_sizes,
        )
    )
    for frame in range(0, prep.stride * prep.history_length + 1, policy.period):
        policy.act(
            Observation(np.zeros(len(JOINTS)), "press the bell now", frame / prep.fps, images)
        )
    now = Observation(
        np.zeros(len(JOINTS)),
        "press the bell now",
        prep.stride * prep.history_length / prep.fps,
        images,
    )
    inputs = policy.inputs(now).to(device)
    empty = network.queries.new_zeros(1, len(network.extra), network.queries.shape[1])

    def bare() -> None:
        with torch.inference_mode():
            network.backbone(inputs, empty, network.queries)
        _wait(device)

    name = "compiled" if compiled else "eager"
    whole, before = (
        seconds_of(lambda: policy.plan(now), 30),
        seconds_of(lambda: policy.inputs(now), 30),
    )
    backbone = seconds_of(bare, 30)
    return {
        f"answer, ms, {name}": 1e3 * whole,
        f"answer, ms of preprocessing, {name}": 1e3 * before,
        f"answer, ms of the bare backbone, {name}": 1e3 * backbone,
        f"answer, share of the bare backbone, {name}": backbone / whole,
    }


def report(config: Config, compiled: bool = False) -> dict[str, float | str]:
    """All of it, rounded, with the number of weights and the device."""
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    with tempfile.TemporaryDirectory() as folder:
        corpus = made_up(config, Path(folder))
        torch.manual_seed(0)
        network = build_model(corpus.config, sizes_of(corpus)).to(device)
        found: dict[str, float | str] = {
            "device": torch.cuda.get_device_name(device)
            if device.type == "cuda"
            else f"CPU, {torch.get_num_threads()} threads",
            "weights, million": round(
                sum(weight.numel() for weight in network.parameters()) / 1e6, 3
            ),
        }
        parts = [
            loading(corpus, network),
            learning(corpus, network, device),
            answering(corpus, network, device),
        ]
        if compiled:
            parts.append(answering(corpus, network, device, True))
        for part in parts:
            found |= {name: float(f"{value:.4g}") for name, value in part.items()}
    return found


def _wait(device: torch.device) -> None:
    if device.type == "cuda":
        torch.cuda.synchronize(device)
