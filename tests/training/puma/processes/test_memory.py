"""What training takes of a card, against counts made by hand, and the refusal of what cannot
fit."""

import json
from pathlib import Path

import pytest
import torch
from typer.testing import CliRunner

from tests.training.puma.tiny import config_of, qwen_json
from training.puma import train as training
from training.puma.cli import app
from training.puma.config import Config
from training.puma.errors import TrainError
from training.puma.model.puma import Sizes, build_model
from training.puma.processes.memory import Weights, activations, least, refusal, weights_of
from training.puma.processes.parallel import shell_of
from training.puma.reading import CONFIGS, read_config

SIZES = Sizes(14, 32)
SHELLS = {"half": {"precision": "bf16"}, "whole": {}}


def tiny_qwen(folder: Path, **backbone: object) -> Config:
    name = {"kind": "qwen3-vl", "name": str(qwen_json(folder / "q.json")), "weights": "random"}
    return config_of(folder, folder, backbone=name | backbone)


@pytest.mark.parametrize("kind", SHELLS)
def test_a_shell_has_every_weight_on_meta_and_everything_else_as_it_is(tmp_path: Path, kind: str):
    config = tiny_qwen(tmp_path)
    config = config.model_copy(update={"train": config.train.model_copy(update=SHELLS[kind])})
    torch.manual_seed(0)
    before = torch.get_rng_state()
    shell = shell_of(config, SIZES)
    assert torch.equal(torch.get_rng_state(), before)
    built = build_model(config, SIZES)
    assert {name: (w.shape, w.dtype) for name, w in shell.named_parameters()} == {
        name: (w.shape, w.dtype) for name, w in built.named_parameters()
    }
    assert all(weight.is_meta for weight in shell.parameters())
    assert all(
        torch.equal(one, other) for one, other in zip(shell.buffers(), built.buffers(), strict=True)
    )


def test_bytes_of_a_card_are_those_counted_by_hand():
    weights = Weights(trained=1000, frozen=6, layer=100, rest=300)
    assert least(weights, "ddp", 8) == least(weights, "fsdp", 1) == 16_006
    assert least(weights, "zero2", 8) == 6 + 2000 + 4000
    assert least(weights, "fsdp", 8) == 6 + 2000 + 4 * (300 + 200)


def test_weights_of_a_layer_and_of_adapters(tmp_path: Path):
    found = weights_of(shell_of(tiny_qwen(tmp_path), SIZES))
    # q and o 64x64, k and v 64x32, three of 64x128, two norms of 64, norms of q and k of 16
    assert found.layer == 2 * 64 * 64 + 2 * 64 * 32 + 3 * 64 * 128 + 2 * 64 + 2 * 16
    assert found.rest == found.trained - 2 * found.layer and found.frozen == 0
    adapted = weights_of(shell_of(tiny_qwen(tmp_path, lora={"rank": 2, "alpha": 4}), SIZES))
    # of every layer: q, k, v, o and the three of the feed-forward part, each with two matrices of
    # rank 2
    per_layer = 2 * ((64 + 64) + 2 * (64 + 32) + (64 + 64) + 3 * (64 + 128))
    assert adapted.layer == per_layer and adapted.frozen > 0


def test_the_backward_pass_keeps_less_with_checkpointing(tmp_path: Path):
    config = tiny_qwen(tmp_path)
    kept = config.model_copy(
        update={"train": config.train.model_copy(update={"checkpointing": True})}
    )
    less, more = (activations(shell_of(c, SIZES), 4) for c in (kept, config))
    assert 0 < less < more and activations(shell_of(kept, SIZES), 8) == 2 * less
    assert activations(shell_of(config_of(tmp_path, tmp_path), SIZES), 4) == 0


def test_what_cannot_fit_is_refused_in_one_line_that_names_what_can(tmp_path: Path):
    config = read_config(
        "puma-4b",
        [f"model.backbone.name={CONFIGS / 'qwen3-vl-4b.json'}", "model.backbone.weights=random"],
    )
    assert config.train.parallel == "zero2"
    weights = weights_of(shell_of(config, Sizes(14, 768)))
    assert refusal(config, weights, 1, 80_000_000_000) == ""
    said = refusal(config, weights, 1, 48_000_000_000)
    assert said.startswith(
        "puma-4b: 4.51 billion trained weights take 72 GB in one process, the card has 48 GB: use"
        " train.parallel="
    )
    assert (
        "zero2 over 4 processes (36 GB each)" in said
        and "fsdp over 4 processes (22 GB each)" in said
        and "adapters" in said
    )
    assert "\n" not in said
    assert refusal(config, weights, 4, 48_000_000_000) == ""


def test_training_refuses_before_it_makes_anything(
    tmp_path: Path, dataset: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("training.puma.processes.memory.os.sysconf", lambda name: 1000)
    monkeypatch.setattr(training, "build_model", lambda *_: pytest.fail("weights were made"))
    with pytest.raises(TrainError, match=r"this machine's memory has 0 GB: use train\.parallel"):
        training.train(config_of(dataset, cache), tmp_path / "out", quiet=True)
    assert not (tmp_path / "out").exists()


def test_the_command_prints_a_table(tmp_path: Path):
    words = [
        "memory",
        "--set",
        f"model.backbone.name={qwen_json(tmp_path / 'q.json')}",
        "--set",
        "model.backbone.weights=random",
    ]
    found = CliRunner().invoke(
        app, [*words, "--set", "data.image_size=[64,64]", "--cards", "1,2", "--json"]
    )
    assert [(need["kind"], need["processes"]) for need in json.loads(found.stdout)] == [
        ("ddp", 1),
        ("ddp", 2),
        ("zero2", 2),
        ("fsdp", 2),
    ]
    assert CliRunner().invoke(app, [*words, "--cards", "none"]).exit_code == 2
