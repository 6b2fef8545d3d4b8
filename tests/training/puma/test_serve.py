"""A checkpoint behind the policy server, in the closed loop, and the command line."""

import asyncio
import json
import threading
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from pipeline.data.errors import DominoError
from pipeline.evaluate.names import make_policy, policy_name
from pipeline.evaluate.policies.policy import PolicyError, Start
from pipeline.evaluate.scoring.clock import parse_clock
from pipeline.evaluate.serving.server import ServerAddress
from tests.training.puma.test_train import SIZES, seen, start
from tests.training.puma.tiny import config_of
from training.puma import checkpoint
from training.puma.cli import app
from training.puma.errors import TrainError
from training.puma.measure.bench import report
from training.puma.policy import PumaPolicy
from training.puma.serve import label, server
from training.puma.train import train

COMMAND = CliRunner()


@pytest.fixture(scope="module")
def run(dataset: Path, cache: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("run")
    train(config_of(dataset, cache), out, steps=1, quiet=True)
    return out


def test_a_served_policy_answers_as_the_local_one(run: Path):
    local = PumaPolicy.load(run)
    stop, up, loop = asyncio.Event(), threading.Event(), asyncio.new_event_loop()
    served_here = server(run, ServerAddress(port=0))
    thread = threading.Thread(
        target=loop.run_until_complete, args=(served_here.serve(stop, lambda port: up.set()),)
    )
    thread.start()
    try:
        assert up.wait(10)
        remote = make_policy(policy_name(f"ws://127.0.0.1:{served_here.port}"))
        assert remote.label == label(run) and label(run).startswith("puma:test-1@")
        remote.reset(start())
        local.reset(start())
        for k in range(4):
            np.testing.assert_array_equal(remote.act(seen(2 * k / 15)), local.act(seen(2 * k / 15)))
        remote.close()
        with pytest.raises(
            PolicyError, match="the policy has 320x240, the evaluation 32x24: add --size 320x240"
        ):
            given = start()
            remote.reset(
                Start(
                    given.instruction,
                    given.embodiment,
                    given.action_names,
                    15,
                    given.cameras,
                    0,
                    {**SIZES, "left_camera": (24, 32)},
                )
            )
    finally:
        loop.call_soon_threadsafe(stop.set)
        thread.join(20)
        loop.run_until_complete(loop.shutdown_default_executor())
        loop.close()


def test_an_oracle_is_not_served(dataset: Path, cache: Path, tmp_path: Path):
    train(config_of(dataset, cache, oracle=True), tmp_path, steps=1, quiet=True)
    with pytest.raises(TrainError, match="cannot be served; run: puma eval"):
        server(tmp_path, ServerAddress(port=0))
    assert hasattr(PumaPolicy.load(tmp_path), "see")


def test_the_contract_is_that_of_the_data(run: Path):
    contract = PumaPolicy.load(run).contract
    given = start()
    assert (contract.action_names, contract.rate, contract.image_sizes) == (
        given.action_names,
        given.fps,
        given.image_sizes,
    )
    assert (
        parse_clock("sim").name == "sim"
        and "policy.py@" in policy_name(str(checkpoint.newest(run) / "policy.py")).label
    )


def test_the_command_trains_checks_and_lists(dataset: Path, cache: Path, tmp_path: Path):
    config = tmp_path / "mine.yaml"
    config.write_text(config_of(dataset, cache).to_yaml())
    out = tmp_path / "run"
    made = COMMAND.invoke(
        app,
        ["train", "--config", str(config), "--set", "train.steps=2", "--out", str(out), "--quiet"],
    )
    assert made.exit_code == 0 and made.output.strip().endswith("step_00000002")
    checked = COMMAND.invoke(app, ["replay-check", str(out), "--json"])
    assert checked.exit_code == 0 and json.loads(checked.output)["different"] == 0
    heart = COMMAND.invoke(app, ["overfit", "--config", str(config), "--steps", "2"])
    assert heart.exit_code == 1 and "in 2 steps on one batch of 4" in heart.output
    assert "puma-tiny " in COMMAND.invoke(app, ["configs"]).output
    wrong = COMMAND.invoke(app, ["train", "--config", "nothing", "--out", str(out)])
    assert isinstance(wrong.exception, DominoError)


def test_figures_are_those_of_made_up_data(dataset: Path, cache: Path):
    found = report(config_of(dataset, cache))
    assert found["loader, samples/s"] > 0 and 0 < found["training, share of the bare backbone"] < 2
    assert found["answer, ms, eager"] > 0 and found["training, GFLOP a sample"] > 0
