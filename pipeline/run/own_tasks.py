"""Whether a task from outside the package declares what a build needs, found before anything is written."""

import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

from pipeline.data.episode.meta import Category
from pipeline.data.parsing import show_value
from pipeline.data.recipe.model import RecipeError
from pipeline.motion.models import MODELS
from pipeline.motion.workspace import Workspace
from pipeline.tasks import TASKS, Task
from pipeline.tasks.contract import families_of
from pipeline.tasks.limits import Limit

CATEGORIES = get_args(Category.__value__)
MOST_STEPS = 10_000
"""Control periods of an episode that a task may ask for."""

ALL = "all"
"""The word that `tasks:` reads as the suite `domino`, which holds no task of anybody else."""

PACKAGE = Path(__file__).parents[1]


def check_task(task: Task, source: str) -> None:
    """Draw the trial layouts of a task, unless it ships with the package. Raises RecipeError, naming the task and what is wrong."""
    if _ships(task):
        return
    where = f"{source}: task {task.name}:"
    if fault := _fault(task):
        raise RecipeError(f"{where} {fault}")
    try:
        families_of(task)
    except Exception as error:  # a task is a user's code, which may raise anything
        raise RecipeError(
            f"{where} its layout raised {type(error).__name__}: {' '.join(str(error).split())}{_line_of(error)}"
        ) from error


def _fault(task: Task) -> str | None:
    """What is wrong with the attributes of a task's class."""
    taken = {ALL, *TASKS, *(each.suite for each in TASKS.values() if _ships(each))}
    wanted: list[tuple[str, Callable[[Any], object], str]] = [
        ("category", lambda value: value in CATEGORIES, f"one of {', '.join(CATEGORIES)}"),
        ("target", lambda value: isinstance(value, str) and value, "the name of a body"),
        ("step_limit", lambda value: type(value) is int and 1 <= value <= MOST_STEPS, f"a whole number from 1 to {MOST_STEPS}"),
        ("motion", lambda value: isinstance(value, str) and value in MODELS, f"one of {', '.join(MODELS)}"),
        ("suite", lambda value: isinstance(value, str) and value not in taken, "a name of its own"),
        ("workspace", lambda value: isinstance(value, Workspace), "a Workspace"),
        *((name, lambda value: not isinstance(value, str), "a tuple of sentences") for name in ("seen", "unseen")),
        *((name, _is_by_name, f"{name} by name: write them with `by_name`") for name in ("limits", "sizes")),
    ]
    for name, fits, kind in wanted:
        value = getattr(task, name, None)
        if not fits(value):
            return f"{name} is {show_value(value)}, which is not {kind}"
    return None


def _is_by_name(values: Any) -> bool:
    return hasattr(values, "items") and all(isinstance(value, Limit) for value in values.values())


def _ships(task: Task) -> bool:
    return type(task).__module__.startswith("pipeline.")


def _line_of(error: Exception) -> str:
    """The first line outside the package that an error passed, as text."""
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if not Path(frame.filename).is_relative_to(PACKAGE)]
    return f" ({Path(frames[0].filename).name}, line {frames[0].lineno})" if frames else ""
