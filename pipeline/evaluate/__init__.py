"""Closed-loop evaluation. Importing this package registers `domino/<task>-v0` for every task with gymnasium."""

from gymnasium.envs.registration import register, registry

from pipeline.evaluate.env import DominoEnv
from pipeline.tasks import TASKS


def env_id(task: str) -> str:
    """The gymnasium id of a task."""
    return f"domino/{task}-v0"


for _task in TASKS:
    if env_id(_task) not in registry:
        register(env_id(_task), entry_point="pipeline.evaluate.env:DominoEnv", kwargs={"task": _task})

__all__ = ["DominoEnv", "env_id"]
