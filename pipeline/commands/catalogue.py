"""tasks, motions, embodiments and their checks."""

import shutil
import sys
from pathlib import Path
from typing import Annotated

from pipeline.data.parsing import whole

from .common import (
    AsJson,
    UsageError,
    argument,
    numbers,
    option,
    print_findings,
    print_result,
    split_list,
    table,
)
from .options import Given, complete_robot, complete_task, recipe_options


def tasks(as_json: AsJson = False) -> None:
    """List the tasks."""
    from pipeline.intake.catalogue.listings import list_tasks

    values = list_tasks()
    rows = [
        (
            t["name"],
            t["category"],
            t["step_limit"],
            f"{t['description']} ({', '.join(t['objects'])})",
        )
        for t in values
    ]
    text = table(("task", "kind", "limit (frames)", "what the robot does (bodies)"), rows)
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() else None
    print_result(values, as_json, "\n".join(line[:width] for line in text.splitlines()))


def embodiments(as_json: AsJson = False) -> None:
    """List the robots."""
    from pipeline.intake.catalogue.listings import list_robots

    values = list_robots()
    headers = ("robot", "vector width", "opening (m)", "cameras", "also called")
    rows = [
        (
            *(e["name"], e["dof"], f"{e['max_opening']['left']:.3f}"),
            *(", ".join(e["cameras"]), ", ".join(e["aliases"])),
        )
        for e in values
    ]
    print_result(values, as_json, table(headers, rows))


def motions(as_json: AsJson = False) -> None:
    """List the models of motions."""
    from pipeline.intake.catalogue.listings import list_motions

    values = list_motions()
    rows = [
        (m["name"], n, text, ", ".join(m["tasks"]) if n == 1 and len(m["tasks"]) < 10 else "")
        for m in values
        for n, text in m["levels"].items()
        if n
    ]
    print_result(values, as_json, table(("model", "level", "the target", "tasks"), rows))


@recipe_options("expert", files=())
def check_task(
    given: Given,
    name: Annotated[
        str, argument("The task, or `all`.", metavar="NAME", autocompletion=complete_task)
    ],
    embodiment: Annotated[str, option("The robot.", autocompletion=complete_robot)] = "aloha",
    levels: Annotated[
        str | None,
        option("Levels, comma separated: 0 static, 1 constant velocity, 2 polynomial, 3 abrupt."),
    ] = "0,1,2,3",
    words: Annotated[
        bool, option("Whether its instructions are checked, too.", "--words/--no-words")
    ] = True,
    as_json: AsJson = False,
) -> None:
    """Check that a task keeps its contract; exit code 1 if it does not."""
    from pipeline.intake.check_task import check_task as check
    from pipeline.motion.models import levels_of
    from pipeline.run.names import check_known
    from pipeline.tasks.contract import TASKS, expand_tasks
    from pipeline.world.robots import get_embodiment

    names = expand_tasks([name])
    check_known("task", names, TASKS)
    known, requested = levels_of(TASKS[names[0]].motion), numbers(levels, whole, "--levels")
    if unknown := [level for level in requested if level not in known]:
        raise UsageError(
            f"--levels {unknown[0]} is unknown: levels are {', '.join(map(str, known))}"
        )
    robot = get_embodiment(embodiment).name
    findings = {task: check(task, robot, requested, given.recipe(), words) for task in names}
    print_findings(findings, as_json)


def check_object(
    name: Annotated[
        str, argument("The object family, an object from files, or `all`.", metavar="NAME")
    ],
    images: Annotated[
        Path | None, option("Directory for an image of each with its frames and grasps.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Check that an object family or an object from files keeps its contract; exit code 1 if it
    does not."""
    from pipeline.intake.catalogue.object_check import check_object as check
    from pipeline.run.names import check_known
    from pipeline.world.objects import FAMILIES

    names = sorted(FAMILIES) if name == "all" else [name]
    check_known("object family", names, FAMILIES)
    if images is not None:
        from pipeline.intake.catalogue.gallery import write_portrait

        for each in names:
            write_portrait(each, images / f"{each}.png")
    print_findings({family: check(family) for family in names}, as_json)


def check_robot(
    name: Annotated[str, argument("The robot.", metavar="NAME", autocompletion=complete_robot)],
    tasks: Annotated[
        str, option("Tasks to try at level 0, comma separated; `all`, or `none`.")
    ] = "click_bell",
    as_json: AsJson = False,
) -> None:
    """Check that a robot can do its work; exit code 1 if a clause does not hold."""
    from pipeline.intake.robots.check import check_robot as check
    from pipeline.run.names import check_known
    from pipeline.tasks.contract import TASKS, expand_tasks
    from pipeline.world.robots import canonical_name

    requested = [] if tasks == "none" else expand_tasks(split_list(tasks) or [])
    check_known("task", requested, TASKS)
    robot = canonical_name(name)
    print_findings({robot: [*check(robot, requested)]}, as_json)
