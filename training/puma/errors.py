"""The error of this room."""

from pipeline.data.errors import DominoError


class TrainError(DominoError):
    """Bad input for training, evaluation or serving of PUMA. One line that names the thing and the
    fix."""
