"""Two processes on this machine: shares train what copies train, and go on from a checkpoint to the
same bits."""

import json
import os
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.torch import load_file
from torch import multiprocessing

from tests.training.puma.tiny import config_of, qwen_json
from training.puma import checkpoint
from training.puma.config import Config
from training.puma.loop.runs import LOG
from training.puma.processes.parallel import part
from training.puma.train import train

pytestmark = pytest.mark.slow


def note_what_is_done_alone(rank: int, path: Path) -> None:
    """Append a line for every cache that this process decodes and every network that it builds with
    weights."""
    from training.puma import train
    from training.puma.corpus import cache

    def noting(name: str, do: Callable[..., Any]) -> Callable[..., Any]:
        def done(*given: Any) -> Any:
            with path.open("a") as file:
                file.write(f"{name} {rank}\n")
            return do(*given)

        return done

    cache._write = noting("decodes", cache._write)
    train.build_model = noting("builds", train.build_model)


def work(rank: int, port: int, runs: list[tuple[Config, Path, int]]) -> None:
    """Runs one after the other as one of two processes."""
    os.environ |= {
        "MASTER_ADDR": "127.0.0.1",
        "MASTER_PORT": str(port),
        "ACCELERATE_USE_CPU": "true",
    }
    os.environ |= {"WORLD_SIZE": "2", "RANK": str(rank), "LOCAL_RANK": str(rank)}
    torch.set_num_threads(1)
    note_what_is_done_alone(rank, runs[0][1].parent / "alone.txt")
    for config, out, steps in runs:
        train(config, out, steps=steps, quiet=True)
    part()


@pytest.fixture(scope="module")
def runs(dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    root = tmp_path_factory.mktemp("parallel")
    backbone = {"kind": "qwen3-vl", "name": str(qwen_json(root / "q.json")), "weights": "random"}
    base = config_of(dataset, tmp_path_factory.mktemp("decoded"), backbone=backbone)
    jobs, out = list[tuple[Config, Path, int]](), dict[str, Path]()
    for name, parallel in (
        ("ddp", "ddp"),
        ("fsdp", "fsdp"),
        ("stopped", "fsdp"),
        ("zero2", "zero2"),
    ):
        settings = {"parallel": parallel, "save_every": 1, "validate_every": 1, "steps": 2}
        config = base.model_copy(
            update={
                "train": base.train.model_copy(update=settings),
                "data": base.data.model_copy(update={"validation": 0.34}),
            }
        )
        out[name] = root / name
        jobs += [(config, out[name], steps) for steps in ((1, 2) if name == "stopped" else (2,))]
    multiprocessing.spawn(work, (_free_port(), jobs), nprocs=2)  # pyright: ignore[reportPrivateImportUsage]
    return out


def _free_port() -> int:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])


def losses(out: Path) -> list[float]:
    return [json.loads(line)["loss"] for line in (out / LOG).read_text().splitlines()]


@pytest.mark.parametrize("kind", ["fsdp", "zero2"])
def test_shares_train_what_copies_train(runs: dict[str, Path], kind: str):
    np.testing.assert_allclose(losses(runs[kind]), losses(runs["ddp"]), rtol=1e-4)
    ours, theirs = (
        load_file(checkpoint.newest(runs[name]) / "model.safetensors") for name in (kind, "ddp")
    )
    assert {name: v.shape for name, v in ours.items()} == {
        name: v.shape for name, v in theirs.items()
    }
    # the first steps of AdamW have the size of the learning rate (1e-3) whatever the size of the
    # gradient
    assert all((value - theirs[name]).abs().max() < 5e-4 for name, value in ours.items())


def test_one_process_decodes_and_of_shares_one_holds_all_weights(runs: dict[str, Path]):
    lines = (runs["ddp"].parent / "alone.txt").read_text().splitlines()
    assert lines.count("decodes 0") == 1 and "decodes 1" not in lines
    # ddp, fsdp, stopped twice, zero2
    assert (lines.count("builds 0"), lines.count("builds 1")) == (5, 1)


def test_a_run_in_shares_goes_on_to_the_same_bits(runs: dict[str, Path]):
    assert losses(runs["stopped"]) == losses(runs["fsdp"])
    ends = [
        load_file(checkpoint.newest(runs[name]) / "model.safetensors")
        for name in ("stopped", "fsdp")
    ]
    assert all(torch.equal(value, ends[1][name]) for name, value in ends[0].items())


def test_a_checkpoint_of_shares_acts_in_one_process(runs: dict[str, Path]):
    weights = load_file(checkpoint.newest(runs["fsdp"]) / "model.safetensors")
    network = checkpoint.load(runs["fsdp"]).model()
    assert all(torch.equal(value, weights[name]) for name, value in network.state_dict().items())
