"""Whether a task from outside the package declares what a build needs, found before anything is written."""

import contextlib
import traceback
from collections.abc import Iterator
from difflib import get_close_matches
from pathlib import Path
from typing import Any, get_args

from pipeline.data.episode.meta import Category
from pipeline.data.parsing import show_value
from pipeline.data.recipe.model import RecipeError
from pipeline.data.time_limit import time_limit
from pipeline.motion.models import MODELS
from pipeline.motion.workspace import Workspace
from pipeline.tasks import TASKS, Task
from pipeline.tasks.contract import Limit
from pipeline.tasks.layout import families_of

CATEGORIES = get_args(Category.__value__)
MOST_STEPS = 10_000
"""Control periods of an episode that a task may ask for."""

LAYOUT_SECONDS = 20.0
"""What the trial layouts of a task, which take less than a second, may take."""

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
    late = TimeoutError()
    try:
        with time_limit(LAYOUT_SECONDS, late):
            families_of(task)
    except Exception as error:  # a task is a user's code, which may raise anything
        what = f"raised {type(error).__name__}: {' '.join(str(error).split())}"
        if error is late:
            what = f"does not end within {LAYOUT_SECONDS:g} s: check its loops"
        raise RecipeError(f"{where} its layout {what}{_line_of(error)}") from error


def _fault(task: Task) -> str | None:
    """What is wrong with the attributes of a task's class."""

    def unlike(name: str, kind: str) -> str:
        return f"{name} is {show_value(getattr(task, name, None))}, which is not {kind}"

    known = {name for name in dir(Task) if not name.startswith("_")} | Task.__annotations__.keys()
    own = set(_own_names(task))
    for name in sorted(own - known):
        if close := get_close_matches(name, known - own, 1, 0.8):
            return f"has no attribute {name}: write {close[0]}, or _{name} for a name of your own"
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


def _own_names(task: Task) -> Iterator[str]:
    """The public names that the class of a task and its bases outside the package define."""
    for each in type(task).__mro__:
        if not each.__module__.startswith("pipeline."):
            yield from (name for name in vars(each) if not name.startswith("_"))


def _ships(task: Task) -> bool:
    return type(task).__module__.startswith("pipeline.")


def _line_of(error: Exception) -> str:
    """The first line outside the package that an error passed, as text."""
    files = [(Path(frame.filename), frame.lineno) for frame in traceback.extract_tb(error.__traceback__)]
    outside = [each for each in files if not each[0].is_relative_to(PACKAGE) and each[0] != Path(contextlib.__file__)]
    return f" ({outside[0][0].name}, line {outside[0][1]})" if outside else ""
