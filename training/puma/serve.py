"""A checkpoint behind the policy server of domino-data."""

from collections.abc import Callable
from pathlib import Path

from pipeline.evaluate.serving.server import Limits, Place, PolicyServer
from pipeline.evaluate.serving.session import Domino
from training.puma import checkpoint
from training.puma.errors import TrainError
from training.puma.policy import PumaPolicy

Tell = Callable[[str], None]


def server(folder: Path, place: Place, clients: int = 1, compiled: bool = False, tell: Tell = lambda line: None) -> PolicyServer:
    """The server of a checkpoint, or of the newest one of a run; every client gets a policy of its own.

    A client with other cameras, image sizes, joints or rate is refused by the policy's contract. Raises TrainError.
    """
    held = checkpoint.load(folder)
    if held.config.model.oracle:
        raise TrainError(f"{folder}: is told the truth about the target and cannot be served; run: puma eval {folder}")
    language = Domino(label(folder))
    return PolicyServer(lambda: PumaPolicy.load(held.path, compiled=compiled), language, place, Limits(clients), tell)


def label(folder: Path) -> str:
    """What results call a checkpoint: the run's name, the step, a hash of weights and preprocessing."""
    held = checkpoint.load(folder)
    weights = (held.path / "policy.py").read_text().split("weights ")[1][:8]
    return f"puma:{held.config.name}-{held.step}@{weights}{held.preprocessing.digest[:4]}"
