"""What a run tells TensorBoard is its log."""

import json
from pathlib import Path

import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from tests.training.puma.tiny import config_of
from training.puma.config import Config
from training.puma.errors import TrainError
from training.puma.loop.runs import LOG
from training.puma.processes import trackers
from training.puma.train import train


def told(config: Config, **values: object) -> Config:
    return config.model_copy(update={"train": config.train.model_copy(update=values)})


def test_tensorboard_has_the_rows_of_the_log_also_of_a_run_that_was_stopped(
    dataset: Path, cache: Path, tmp_path: Path
):
    config = told(config_of(dataset, cache), trackers=("tensorboard",))
    train(config, tmp_path / "run", steps=2, quiet=True)
    train(config, tmp_path / "run", quiet=True)
    rows = [json.loads(line) for line in (tmp_path / "run" / LOG).read_text().splitlines()]
    events = EventAccumulator(str(tmp_path / "run" / "puma")).Reload()
    for name in ("loss", "rate", "norm"):
        want = {row["step"]: pytest.approx(row[name], rel=1e-6) for row in rows if name in row}
        assert {event.step: event.value for event in events.Scalars(name)} == want
    assert len(events.Scalars("loss")) == 6
    said = [path.read_text() for path in (tmp_path / "run" / "puma").rglob("hparams.yml")]
    assert len(said) == 2 and all(f"train.seed: '{config.train.seed}'" in text for text in said)


def test_a_tracker_that_is_not_installed_is_one_line(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(trackers, "find_spec", lambda name: None)
    with pytest.raises(
        TrainError, match=r"^train.trackers: wandb is not installed: pip install wandb$"
    ):
        trackers.check(["wandb"])
