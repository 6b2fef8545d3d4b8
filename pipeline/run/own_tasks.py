"""Whether a task from outside the package declares what a build needs, found before anything is written."""

import traceback
from pathlib import Path
from typing import Any, get_args

from pipeline.data.episode.meta import Category
from pipeline.data.parsing import show_value
from pipeline.data.recipe.model import RecipeError
from pipeline.motion.models import MODELS
from pipeline.motion.workspace import Workspace
from pipeline.tasks import TASKS, Task
from pipeline.tasks.contract import Limit
from pipeline.tasks.layout import families_of

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

    def unlike(name: str, kind: str) -> str:
        return f"{name} is {show_value(getattr(task, name, None))}, which is not {kind}"

    if getattr(task, "category", None) not in CATEGORIES:
        return unlike("category", f"one of {', '.join(CATEGORIES)}")
    if not isinstance(getattr(task, "target", None), str) or not task.target:
        return unlike("target", "the name of a body")
    if type(task.step_limit) is not int or not 1 <= task.step_limit <= MOST_STEPS:
        return unlike("step_limit", f"a whole number from 1 to {MOST_STEPS}")
    if not isinstance(task.motion, str) or task.motion not in MODELS:
        return unlike("motion", f"one of {', '.join(MODELS)}")
    taken = {ALL, *TASKS, *(each.suite for each in TASKS.values() if _ships(each))}
    if not isinstance(task.suite, str) or task.suite in taken:
        return unlike("suite", "a name of its own")
    if not isinstance(task.workspace, Workspace):
        return unlike("workspace", "a Workspace")
    for name in ("seen", "unseen"):
        if isinstance(getattr(task, name), str):
            return unlike(name, "a tuple of sentences")
    for name, kind in (("limits", "limits"), ("sizes", "sizes")):
        values: Any = getattr(task, name)
        if not hasattr(values, "items") or not all(isinstance(value, Limit) for value in values.values()):
            return unlike(name, f"{kind} by name: write them with `by_name`")
    return None


def _ships(task: Task) -> bool:
    return type(task).__module__.startswith("pipeline.")


def _line_of(error: Exception) -> str:
    """The first line outside the package that an error passed, as text."""
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if not Path(frame.filename).is_relative_to(PACKAGE)]
    return f" ({Path(frames[0].filename).name}, line {frames[0].lineno})" if frames else ""
