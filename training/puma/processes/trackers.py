"""TensorBoard and Weights & Biases, through accelerate: the rows of a run's log for those who look
there."""

from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from typing import Any

from accelerate import Accelerator

from training.puma.config import Config
from training.puma.errors import TrainError


def check(names: Sequence[str]) -> None:
    """Raise TrainError for a tracker that is not installed: accelerate would leave it out without a
    word."""
    if missing := [name for name in names if find_spec(name) is None]:
        raise TrainError(f"train.trackers: {missing[0]} is not installed: pip install {missing[0]}")


def begin(accelerator: Accelerator, config: Config) -> None:
    """Tell the trackers the configuration of the run."""
    if config.train.trackers:
        accelerator.init_trackers("puma", flat(config.model_dump(mode="json")))


def end(accelerator: Accelerator) -> None:
    """Let the trackers write what they still hold."""
    for tracker in accelerator.trackers:
        tracker.finish()


def flat(values: Mapping[str, Any], above: str = "") -> dict[str, str]:
    """Nested values as one level of texts, keys joined by dots."""
    out: dict[str, str] = {}
    for key, value in values.items():
        out |= (
            flat(value, f"{above}{key}.")
            if isinstance(value, dict)
            else {f"{above}{key}": str(value)}
        )
    return out
