"""objects and robots."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import typer

from .command import Verb
from .common import (
    AsJson,
    UsageError,
    argument,
    check_file,
    number,
    option,
    print_result,
    split_list,
    table,
)

objects_app = typer.Typer(
    help="Object families, and objects from mesh files.", rich_markup_mode=None
)


@objects_app.callback(invoke_without_command=True)
def objects(
    context: typer.Context,
    gallery: Annotated[
        Path | None, option("Write a page with images of instances, frames and grasps here.")
    ] = None,
    families: Annotated[str | None, option("Families, comma separated; all by default.")] = None,
    as_json: AsJson = False,
) -> None:
    """List the object families, or draw them."""
    if context.invoked_subcommand is not None:
        return
    from pipeline.intake.catalogue.listings import list_objects
    from pipeline.world.objects import FAMILIES

    check_file(gallery, "--gallery", "a page", ".html")
    names = sorted(FAMILIES) if families is None else split_list(families) or [""]
    if unknown := [name for name in names if name not in FAMILIES]:
        raise UsageError(
            f"--families: no object family {unknown[0]!r}: families are"
            f" {', '.join(sorted(FAMILIES))}"
        )
    described = list_objects(names)
    rows = [
        (
            *(name, " x ".join(f"{100 * s:.1f}" for s in d["size"]), ", ".join(d["frames"])),
            *(", ".join(sorted(d["grasps"])), ", ".join(d["tasks"])),
        )
        for name, d in described.items()
    ]
    text = table(("family", "size (cm)", "frames", "kinds of grasps", "tasks that draw it"), rows)
    if gallery is not None:
        from pipeline.intake.catalogue.gallery import write_gallery

        write_gallery(gallery, names)
        text = str(gallery)
    page = str(gallery) if gallery else None
    print_result({"families": names, "described": described, "gallery": page}, as_json, text)


@objects_app.command("add", cls=Verb)
def objects_add(
    source: Annotated[
        Path,
        argument("A mesh (.glb, .gltf, .obj, .stl, .ply, .off), or a directory of RoboTwin-OD."),
    ],
    name: Annotated[str, option("What the object is to be called, e.g. mug7.")],
    family: Annotated[
        str, option("The object family that it stands for; `domino-data objects` lists them.")
    ],
    to: Annotated[
        Path, option("A directory of plugins; the object is written to TO/objects/NAME.")
    ] = Path("plugins"),
    mass: Annotated[float | None, number(0, 50, "Mass (kg).")] = None,
    density: Annotated[
        float | None, number(0, 20000, "Density (kg/m3), where no mass is given; 400.")
    ] = None,
    up: Annotated[
        Literal["x", "y", "z", "-x", "-y", "-z"] | None,
        option("Axis of the file that is up; by default it stands as the family does."),
    ] = None,
    scale: Annotated[float, number(1e-6, 1000, "Metres per unit of the file.")] = 1.0,
    words: Annotated[
        str | None, option("What people call it, comma separated, the noun first; NAME by default.")
    ] = None,
    licence: Annotated[str, option("The licence of the mesh, e.g. CC-BY-4.0.")] = "unknown",
    within: Annotated[
        Path | None, option("Directory below which textures may lie; that of the mesh by default.")
    ] = None,
) -> None:
    """Make an object of a mesh: its collision pieces, how it stands, grasps for two fingers and the
    frames of its family."""
    from pipeline.intake.catalogue.object_check import check_object
    from pipeline.intake.objects.add import add_objects, describe
    from pipeline.intake.objects.draft import ObjectOptions

    called = tuple(split_list(words) or ())
    added = add_objects(
        source, ObjectOptions(name, family, to, mass, density, up, scale, called, licence, within)
    )
    print("\n".join(line for one in added for line in describe(one)))
    names = [one.directory.name for one in added]
    failed = [(each, finding) for each in names for finding in check_object(each) if not finding.ok]
    for each, finding in failed:
        print(f"FAIL {each}: {finding.name}: {finding.detail}")
    if failed:
        print("correct object.toml, or add it again with another --up, --mass or --family")
        raise typer.Exit(1)


@objects_app.command("fetch", cls=Verb)
def objects_fetch(
    source: Annotated[
        Literal["robosuite", "pybullet", "mani_skill", "ycb", "robotwin"],
        argument("Who publishes the objects; ycb and robotwin are on the hub."),
    ],
    to: Annotated[
        Path, option("A directory of plugins; the objects are written to TO/objects.")
    ] = Path("plugins"),
    wheel: Annotated[Path | None, option("The wheel as a file, in place of a download.")] = None,
    revision: Annotated[str, option("Branch, tag or commit of the dataset on the hub.")] = "main",
) -> None:
    """Make checked objects of the meshes that others publish; their licences are kept beside."""
    from pipeline.intake.fetch_objects import WHEELS, fetch_dataset, fetch_wheel

    if source in WHEELS:
        lines = fetch_wheel(source, to, wheel)
    elif wheel is not None:
        raise UsageError(f"--wheel: {source} is on the hub, not in a wheel")
    else:
        from huggingface_hub import HfApi

        lines = fetch_dataset(source, to, HfApi(), revision)
    for line in lines:
        print(line, flush=True)


robots_app = typer.Typer(no_args_is_help=True, help="Add robots from files.", rich_markup_mode=None)


@robots_app.command("add", cls=Verb)
def robots_add(
    source: Annotated[Path, argument("A URDF or MJCF, or a directory with a URDF.")],
    name: Annotated[str, option("Name of the robot, e.g. xarm6.")],
    to: Annotated[
        Path, option("A directory of plugins; the robot is written to TO/robots/NAME.")
    ] = Path("plugins"),
    base: Annotated[
        str | None, option("The root link of the arm, if the URDF holds more than one.")
    ] = None,
    jaw: Annotated[
        str | None, option("The joint that drives the gripper, if it is not found.")
    ] = None,
    licence: Annotated[str, option("The licence of the vendor's files.")] = "unknown",
    gripper: Annotated[
        Path | None, option("A URDF or MJCF of a gripper, for an arm without one.")
    ] = None,
    flange: Annotated[
        str | None, option("The link that carries the gripper, if it is not found.")
    ] = None,
    package: Annotated[
        list[str] | None,
        option("NAME=DIR: where package://NAME/ is, if it is not found; may be repeated."),
    ] = None,
) -> None:
    """Make a robot from a vendor's URDF or MJCF: find its arm, hand and jaws, a place and a rest
    configuration."""
    from pipeline.intake.robots.add import RobotOptions, add_robot, describe

    packages = _packages(package or ())
    options = RobotOptions(name, to, base, jaw, licence, gripper, flange, packages)
    print("\n".join(describe(add_robot(source, options))))


def _packages(given: Sequence[str]) -> dict[str, Path]:
    """Directories by the names of packages. Raises UsageError."""
    directories = {}
    for text in given:
        name, _, directory = text.partition("=")
        if not name or not Path(directory).is_dir():
            raise UsageError(f"--package {text!r}: is not NAME=DIR with a directory that exists")
        directories[name] = Path(directory)
    return directories
