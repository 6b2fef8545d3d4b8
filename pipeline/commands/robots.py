"""robots add, check-robot: robots of others, from their files."""

from pathlib import Path
from typing import Annotated

import typer

from pipeline.commands import complete
from pipeline.commands.bounded import BoundedCommand
from pipeline.commands.common import AsJson, UsageError, split_list
from pipeline.commands.findings import print_findings

robots_app = typer.Typer(no_args_is_help=True, help="Add robots from files.")


@robots_app.command("add", cls=BoundedCommand)
def add(
    source: Annotated[Path, typer.Argument(help="A URDF or MJCF, a directory with a URDF, or an embodiment of RoboTwin.")],
    name: Annotated[str, typer.Option(help="Name of the robot, e.g. xarm6.")],
    to: Annotated[Path, typer.Option(help="A directory of plugins; the robot is written to TO/robots/NAME.")] = Path("plugins"),
    base: Annotated[str | None, typer.Option(help="The root link of the arm, if the URDF holds more than one.")] = None,
    jaw: Annotated[str | None, typer.Option(help="The joint that drives the gripper, if it is not found.")] = None,
    licence: Annotated[str, typer.Option(help="The licence of the vendor's files.")] = "unknown",
    gripper: Annotated[Path | None, typer.Option(help="A URDF or MJCF of a gripper, for an arm without one.")] = None,
    flange: Annotated[str | None, typer.Option(help="The link that carries the gripper, if it is not found.")] = None,
) -> None:
    """Make a robot from a vendor's URDF or MJCF: find its arm, hand and jaws, a place and a rest configuration."""
    from pipeline.run.robots.add import Options, add_robot, notes

    directory = add_robot(source, Options(name, to, base, jaw, licence, gripper, flange))
    print("\n".join(notes(directory)))


def check_robot(
    name: Annotated[str, typer.Argument(help="The robot.", metavar="NAME", autocompletion=complete.robot)],
    tasks: Annotated[str, typer.Option(help="Tasks to try at level 0, comma separated; `all`, or `none`.")] = "click_bell",
    images: Annotated[Path | None, typer.Option(help="Directory for an image of each clause.")] = None,
    as_json: AsJson = False,
) -> None:
    """Check that a robot can do its work; exit code 1 if a clause does not hold."""
    from pipeline.run.robots.check import check_robot as check
    from pipeline.tasks.contract import TASKS, expand_tasks
    from pipeline.world.robots import canonical_name

    wanted = [] if tasks == "none" else expand_tasks(split_list(tasks) or [])
    if unknown := [task for task in wanted if task not in TASKS]:
        raise UsageError(f"--tasks {unknown[0]!r}: `domino-data tasks` lists them")
    robot = canonical_name(name)
    print_findings({robot: [*check(robot, wanted, images)]}, as_json)
