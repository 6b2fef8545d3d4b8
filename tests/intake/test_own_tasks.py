import re
from typing import Any

import pytest

from pipeline.data.recipe.model import RecipeError
from pipeline.intake.own_tasks import check_task
from pipeline.tasks import TASKS
from pipeline.tasks.contract import Task


def own(**attributes: Any) -> Task:
    """An instance of a task outside the package, like click_bell but for some attributes."""
    return type(
        "Own",
        (type(TASKS["click_bell"]),),
        {"__module__": __name__, "name": "own", "suite": "mine"} | attributes,
    )()


def raising(self: Task, draw: object) -> None:
    raise ZeroDivisionError("division by zero")


def test_a_sound_task_and_those_of_the_package_pass():
    check_task(own())
    check_task(own(height=0.1, arm=lambda self: "left", arms=lambda self, bodies: {"arm": "left"}))
    for name in ("click_bell", "handover_block"):
        check_task(TASKS[name])


@pytest.mark.parametrize(
    ("attributes", "wrong"),
    [
        ({"category": "trackin"}, "category"),
        ({"target": 3}, "target"),
        ({"step_limit": "many"}, "step_limit"),
        ({"step_limit": 10**12}, "step_limit"),
        ({"step_limit": True}, "step_limit"),
        ({"motion": "planer"}, "planar"),
        ({"motion": ["planar"]}, "motion"),
        *(({"suite": name}, "suite") for name in ("all", "domino", "click_bell")),
        ({"layout": lambda: 1}, "TypeError: "),
        ({"seen": "press it"}, "seen"),
        ({"limits": {"lift": 0.1}}, "limits"),
        ({"workspace": (0, 1, 0, 1)}, "workspace"),
        (
            {"layout": raising},
            f"test_own_tasks.py:{raising.__code__.co_firstlineno + 1}: task own: "
            "its layout raised ZeroDivisionError: division by zero",
        ),
        ({"layout": lambda self, draw: [draw.one_of("bel")]}, "its layout raised"),
        ({"target": "bel"}, "bell"),
    ],
)
def test_what_is_wrong_is_one_line_that_names_the_task(attributes, wrong):
    with pytest.raises(RecipeError) as error:
        check_task(own(**attributes))
    message = str(error.value)
    assert re.match(r"\S+: task own: ", message) and wrong in message and "\n" not in message
