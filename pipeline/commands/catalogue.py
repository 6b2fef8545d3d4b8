"""tasks, motions, embodiments, objects: what the factory can make, and whether it keeps its contracts."""

import shutil
import sys
from pathlib import Path
from typing import Annotated

import typer

from pipeline.commands import complete
from pipeline.commands.common import AsJson, LevelList, UsageError, numbers, print_findings, print_result, table
from pipeline.commands.options import Given, recipe_options
from pipeline.data.parsing import whole


def tasks(as_json: AsJson = False) -> None:
    """List the tasks."""
    from pipeline.tasks.listing import listing

    values = listing()
    rows = [(t["name"], t["category"], t["step_limit"], f"{t['description']} ({', '.join(t['objects'])})") for t in values]
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() else None
    lines = table(("task", "kind", "limit (frames)", "what the robot does (bodies)"), rows).splitlines()
    print_result(values, as_json, "\n".join(line[:width] for line in lines))


def embodiments(as_json: AsJson = False) -> None:
    """List the robots."""
    from pipeline.run.catalogue.robots import listing

    values = listing()
    headers = ("robot", "vector width", "reach (m)", "opening (m)", "cameras", "also called")
    rows = [
        (
            *(e["name"], e["dof"], f"{e['reach']['left']:.2f}", f"{e['max_opening']['left']:.3f}"),
            *(", ".join(e["cameras"]), ", ".join(e["aliases"])),
        )
        for e in values
    ]
    print_result(values, as_json, table(headers, rows))


def motions(
    paths: Annotated[Path | None, typer.Option(help="Write a PNG with paths of every model here.")] = None,
    as_json: AsJson = False,
) -> None:
    """List the models of motions."""
    from pipeline.run.catalogue.motions import listing, write_paths

    if paths is not None:
        if paths.suffix != ".png":
            raise UsageError(f"--paths {paths}: is not the name of an image: let it end in .png")
        write_paths(paths)
    values = listing()
    rows = [
        (m["name"], number, text, ", ".join(m["tasks"]) if number == 1 and len(m["tasks"]) < 10 else "")
        for m in values
        for number, text in m["levels"].items()
        if number
    ]
    print_result(values, as_json, table(("model", "level", "the target", "tasks"), rows))


@recipe_options("expert", files=())
def check_task(
    given: Given,
    name: Annotated[str, typer.Argument(help="The task, or `all`.", metavar="NAME", autocompletion=complete.task)],
    embodiment: Annotated[str, typer.Option(help="The robot.", autocompletion=complete.robot)] = "aloha",
    levels: LevelList = "0,1,2,3",
    images: Annotated[Path, typer.Option(help="Directory for images of poses that an arm cannot reach, if any.")] = Path(
        "check-task"
    ),
    as_json: AsJson = False,
) -> None:
    """Check that a task keeps its contract; exit code 1 if it does not."""
    from pipeline.motion.models import levels_of
    from pipeline.run.check_task import check_task as check
    from pipeline.tasks.contract import TASKS, expand_tasks
    from pipeline.world.robots import get_embodiment

    names = expand_tasks([name])
    if names[0] not in TASKS:
        raise UsageError(f"no task {name!r}; `domino-data tasks` lists them")
    known, wanted = levels_of(TASKS[names[0]].motion), tuple(numbers(levels, whole, "--levels") or ())
    if unknown := [level for level in wanted if level not in known]:
        raise UsageError(f"--levels {unknown[0]} is unknown: levels are {', '.join(map(str, known))}")
    robot = get_embodiment(embodiment).name
    found = {task: check(task, robot, wanted, images, given.recipe()) for task in names}
    print_findings(found, as_json)


def check_object(
    name: Annotated[str, typer.Argument(help="The object family, an object from files, or `all`.", metavar="NAME")],
    images: Annotated[Path | None, typer.Option(help="Directory for an image of each with its frames and grasps.")] = None,
    as_json: AsJson = False,
) -> None:
    """Check that an object family or an object from files keeps its contract; exit code 1 if it does not."""
    from pipeline.run.catalogue.object_check import check_object as check
    from pipeline.world.objects import FAMILIES

    names = sorted(FAMILIES) if name == "all" else [name]
    if names[0] not in FAMILIES:
        raise UsageError(f"no object family {name!r}; `domino-data objects` lists them")
    if images is not None:
        from pipeline.run.catalogue.gallery import write_portrait

        for each in names:
            write_portrait(each, images / f"{each}.png")
    print_findings({family: check(family) for family in names}, as_json)
