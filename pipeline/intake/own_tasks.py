"""Whether a task from outside the package declares what a build needs, found before anything is
written."""

from collections.abc import Callable
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
        raise RecipeError(
            f"{line_of_class(cls, fault.partition(' ')[0])}: task {task.name}: {fault}"
        )
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
                f"{line_of_class(cls, name)}: task {task.name}: {name} is {body!r}, which its"
                f" layout does not place: there are {', '.join(sorted(bodies))}"
            )


def _fault(task: Task) -> str | None:
    """What is wrong with the attributes of a task's class; the first word is the attribute's
    name."""
    taken = {ALL, *TASKS, *(each.suite for each in TASKS.values() if not is_outside(type(each)))}
    rules: dict[str, tuple[Callable[[Any], bool], str]] = {
        "category": (CATEGORIES.__contains__, f"one of {', '.join(CATEGORIES)}"),
        "target": (lambda value: isinstance(value, str) and value != "", "the name of a body"),
        "step_limit": (
            lambda value: type(value) is int and 1 <= value <= MOST_STEPS,
            f"a whole number from 1 to {MOST_STEPS}",
        ),
        "motion": (
            lambda value: isinstance(value, str) and value in MODELS,
            f"one of {', '.join(MODELS)}",
        ),
        "suite": (lambda value: isinstance(value, str) and value not in taken, "a name of its own"),
        "workspace": (lambda value: isinstance(value, Workspace), "a Workspace"),
        "seen": (lambda value: not isinstance(value, str), "a tuple of sentences"),
        "unseen": (lambda value: not isinstance(value, str), "a tuple of sentences"),
        "limits": (_is_by_name, "limits by name: write them with `by_name`"),
        "sizes": (_is_by_name, "sizes by name: write them with `by_name`"),
    }
    for name, (holds, kind) in rules.items():
        if not holds(value := getattr(task, name, None)):
            return f"{name} is {show_value(value)}, which is not {kind}"
    return None


def _is_by_name(values: Any) -> bool:
    return hasattr(values, "items") and all(isinstance(value, Limit) for value in values.values())
