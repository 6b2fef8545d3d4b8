"""Checks tasks from outside the package."""

from collections.abc import Mapping, Sequence
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from pipeline.data.episode.meta import Category
from pipeline.data.parsing import show_value
from pipeline.data.process.own_code import (
    describe_error,
    file_of,
    is_outside,
    line_of_class,
    line_of_error,
)
from pipeline.data.recipe.model import RecipeError
from pipeline.motion.models import MODELS
from pipeline.motion.workspace import Workspace
from pipeline.tasks import TASKS, Task
from pipeline.tasks.contract import Limit
from pipeline.tasks.layout import bodies_of, families_of

ALL = "all"


class _Declared(BaseModel):
    model_config = ConfigDict(strict=True, from_attributes=True, arbitrary_types_allowed=True)

    category: Category
    target: Annotated[str, Field(min_length=1)]
    step_limit: Annotated[int, Field(ge=1, le=10_000)]
    motion: str
    suite: str
    workspace: Workspace
    seen: Sequence[str]
    unseen: Sequence[str]
    limits: Mapping[str, Limit]
    sizes: Mapping[str, Limit]


def check_task(task: Task) -> None:
    """Draw trial layouts of a foreign task. Raises RecipeError with file, line and name."""
    cls = type(task)
    if not is_outside(cls):
        return
    if wrong := _find_wrong(task):
        name, fault = wrong
        raise RecipeError(f"{line_of_class(cls, name)}: task {task.name}: {name} {fault}")
    try:
        families_of(task)
        bodies = bodies_of(task)
    except Exception as error:  # a task is a user's code, which may raise anything
        place = line_of_error(error, file_of(cls)) or line_of_class(cls, "layout")
        what = f"its layout raised {describe_error(error)}"
        raise RecipeError(f"{place}: task {task.name}: {what}") from error
    for name in ("target", "manipulated"):
        if (body := getattr(task, name)) not in bodies:
            what = f"{name} is {body!r}; its layout places {', '.join(sorted(bodies))}"
            raise RecipeError(f"{line_of_class(cls, name)}: task {task.name}: {what}")


def _find_wrong(task: Task) -> tuple[str, str] | None:
    try:
        _Declared.model_validate(task)
    except ValidationError as error:
        first = error.errors()[0]
        name, fault = str(first["loc"][0]), first["msg"].replace("Input should be", "must be")
        return name, f"is {show_value(getattr(task, name, None))}: {fault}"
    if task.motion not in MODELS:
        return "motion", f"is {task.motion!r}: must be one of {', '.join(MODELS)}"
    shipped = {each.suite for each in TASKS.values() if not is_outside(type(each))}
    if task.suite in {ALL, *TASKS, *shipped}:
        return "suite", f"is {task.suite!r}, which is taken: choose a name of its own"
    return None
