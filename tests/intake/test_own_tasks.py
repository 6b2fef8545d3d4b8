import re
from typing import Any

import pytest

from pipeline.data.recipe.model import RecipeError
from pipeline.intake.own_tasks import check_task
from pipeline.tasks import TASKS
from pipeline.tasks.contract import Draw, Task


def own(**attributes: Any) -> Task:
    """An instance of a task outside the package, like click_bell but for some attributes."""
    return type(
        "Own",
        (type(TASKS["click_bell"]),),
        {"__module__": __name__, "name": "own", "suite": "mine"} | attributes,
    )()


def raising(self: Task, draw: object) -> None:
    raise ZeroDivisionError("division by zero")


def endless(self: Task, draw: Draw) -> None:
    while draw.uniform(0, 1) < 2:
        pass


def test_a_sound_task_and_those_of_the_package_pass():
    check_task(own())
    check_task(own(height=0.1, arm=lambda self: "left", arms=lambda self, bodies: {"arm": "left"}))
    for name in ("click_bell", "handover_block"):
        check_task(TASKS[name])


@pytest.mark.parametrize(
    ("attributes", "message"),
    [
        (
            {"category": "trackin"},
            "category is 'trackin', which is not one of interception, tracking",
        ),
        ({"target": 3}, "target is 3, which is not the name of a body"),
        (
            {"step_limit": "many"},
            "step_limit is 'many', which is not a whole number from 1 to 10000",
        ),
        ({"step_limit": 10**12}, "step_limit is 1000000000000, which is not a whole number"),
        ({"motion": "planer"}, "motion is 'planer', which is not one of "),
        ({"suite": "all"}, "suite is 'all', which is not a name of its own"),
        ({"suite": "domino"}, "suite is 'domino', which is not a name of its own"),
        ({"step_limit": True}, "step_limit is True, which is not a whole number"),
        ({"motion": ["planar"]}, "which is not one of "),
        ({"layout": lambda: 1}, "its layout raised TypeError: "),
        ({"suite": "click_bell"}, "suite is 'click_bell', which is not a name of its own"),
        ({"seen": "press it"}, "seen is 'press it', which is not a tuple of sentences"),
        ({"limits": {"lift": 0.1}}, "which is not limits by name: write them with `by_name`"),
        ({"workspace": (0, 1, 0, 1)}, "which is not a Workspace"),
        (
            {"layout": raising},
            f"test_own_tasks.py:{raising.__code__.co_firstlineno + 1}: task own: "
            "its layout raised ZeroDivisionError: division by zero",
        ),
        ({"layout": lambda self, draw: [draw.one_of("bel")]}, "its layout raised"),
        ({"layout": endless}, "its layout does not end within 0.2 s: check its loops"),
        ({"target": "bel"}, "target is 'bel', which its layout does not place: there are bell"),
    ],
)
def test_what_is_wrong_is_one_line_that_names_the_task(attributes, message, monkeypatch):
    monkeypatch.setattr(
        "pipeline.intake.own_tasks.LAYOUT_SECONDS",
        0.2 if attributes.get("layout") is endless else 20.0,
    )
    with pytest.raises(RecipeError) as error:
        check_task(own(**attributes))
    assert (
        re.match(r"\S+: task own: ", str(error.value))
        and message in f"{error.value}"
        and "\n" not in str(error.value)
    )
