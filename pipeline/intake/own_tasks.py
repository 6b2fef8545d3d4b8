"""Whether a task from outside the package declares what a build needs, found before anything is written."""

from typing import Any, get_args

from pipeline.data.episode.meta import Category
from pipeline.data.own_code import describe_error, file_of, is_outside, line_of_class, line_of_error
from pipeline.data.parsing import show_value
from pipeline.data.recipe.model import RecipeError
from pipeline.data.time_limit import time_limit
from pipeline.motion.models import MODELS
from pipeline.motion.workspace import Workspace
from pipeline.tasks import TASKS, Task
from pipeline.tasks.contract import Limit
from pipeline.tasks.layout import bodies_of, families_of

CATEGORIES = get_args(Category.__value__)
MOST_STEPS = 10_000
"""Control periods of an episode that a task may ask for."""

LAYOUT_SECONDS = 20.0
"""What the trial layouts of a task, which take less than a second, may take."""

ALL = "all"
"""The word that `tasks:` reads as the suite `domino`, which holds no task of anybody else."""


def check_task(task: Task) -> None:
    """Draw the trial layouts of a task, unless it ships with the package.

    Raises RecipeError: the line of the task's file, its name and what is wrong."""
    cls = type(task)
    if not is_outside(cls):
        return
    if fault := _fault(task):
        raise RecipeError(f"{line_of_class(cls, fault.partition(' ')[0])}: task {task.name}: {fault}")
    late = TimeoutError()
    try:
        with time_limit(LAYOUT_SECONDS, late):
            families_of(task)
            bodies = bodies_of(task)
    except Exception as error:  # a task is a user's code, which may raise anything
        what = f"raised {describe_error(error)}"
        if error is late:
            what = f"does not end within {LAYOUT_SECONDS:g} s: check its loops"
        place = line_of_error(error, file_of(cls)) or line_of_class(cls, "layout")
        raise RecipeError(f"{place}: task {task.name}: its layout {what}") from error
    for name in ("target", "manipulated"):
        if (body := getattr(task, name)) not in bodies:
            raise RecipeError(
                f"{line_of_class(cls, name)}: task {task.name}: {name} is {body!r}, which its layout does not place: "
                f"there are {', '.join(sorted(bodies))}"
            )


def _fault(task: Task) -> str | None:
    """What is wrong with the attributes of a task's class; the first word is the attribute's name."""

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
    taken = {ALL, *TASKS, *(each.suite for each in TASKS.values() if not is_outside(type(each)))}
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
