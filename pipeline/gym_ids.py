"""The gymnasium ids of tasks. Nothing here imports a task or the simulator."""

from collections.abc import Iterable
from pathlib import Path

LIBRARY = Path(__file__).parent / "tasks" / "library"


def shipped_tasks(suite: str = "domino") -> list[str]:
    """Names of the tasks in the package of a suite, or of all with `*`, sorted: each has a file of
    sentences."""
    return sorted(path.stem for path in LIBRARY.glob(f"{suite}/*/phrases/*.txt"))


def env_id(task: str) -> str:
    """The gymnasium id of a task."""
    return f"domino/{task}-v0"


def register_ids(tasks: Iterable[str]) -> None:
    """Register the ids of tasks with gymnasium; those that are registered already stay as they
    are."""
    from gymnasium.envs.registration import register, registry

    for task in tasks:
        if env_id(task) not in registry:
            register(
                env_id(task),
                entry_point="pipeline.evaluate.environment.env:DominoEnv",
                kwargs={"task": task},
            )


def register_shipped() -> None:
    """Register the ids of the suite `domino`."""
    register_ids(shipped_tasks())
