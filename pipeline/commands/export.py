"""export and publish."""

import sys
from collections.abc import Iterable, Sequence
from dataclasses import MISSING, Field, fields
from inspect import Parameter, Signature
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from pipeline.data.dataset import Dataset, forbidden, licences_in
from pipeline.data.parsing import real
from pipeline.data.process.machine import usable_cores
from pipeline.data.slots.select import VALIDATION

from .command import Verb
from .common import (
    AsJson,
    Quiet,
    Root,
    UsageError,
    Workers,
    argument,
    names_nothing,
    note,
    number,
    numbers,
    option,
    print_result,
    split_list,
)

GIVEN, OPTIONS = "given", "options"  # of the format, in the context of a command line
FORMATS = (
    "lerobot, lerobot-v2.1, aloha, robotwin, xpolicylab, parquet, zarr, robomimic, rlds,"
    " dynamicwam, puma-gt"
)


def format_options(formats: Iterable[str]) -> list[Any]:
    """The options of formats, as typer knows them."""
    from pipeline.export import EXPORTERS
    from pipeline.export.options import flag_name, is_flag

    found, users = dict[str, Field[Any]](), dict[str, list[str]]()
    for name in formats:
        for f in fields(EXPORTERS[name].options):
            found[f.name] = f
            users.setdefault(f.name, []).append(name)

    def verb(**_: Any) -> None: ...

    parameters = list[Parameter]()
    for name, f in found.items():
        text = f"{f.metadata['help']} ({', '.join(users[name])})"
        if not is_flag(f) and f.default not in (MISSING, None, ""):
            text += f" [default: {f.default}]"
        shown = option(text, flag_name(f), show_default=False)
        kind = Annotated[bool | None if is_flag(f) else str | None, shown]
        parameters.append(Parameter(name, Parameter.KEYWORD_ONLY, default=None, annotation=kind))
    verb.__signature__ = Signature(parameters)  # pyright: ignore[reportFunctionMemberAccess]
    verb.__annotations__ = {each.name: each.annotation for each in parameters}
    holder = typer.Typer(add_completion=False)
    holder.command()(verb)
    return typer.main.get_command(holder).params


def named_format(args: Sequence[str]) -> str | None:
    """The value of --format in a command line, if there is one."""
    words = args[: args.index("--")] if "--" in args else args
    for word, after in pairwise([*words, ""]):
        name, sign, value = word.partition("=")
        if name == "--format":
            return value if sign else after
    return None


class ExportCommand(Verb):
    """A command that takes the options of a format beside its own, importing no other format."""

    def get_params(self, ctx: Any) -> list[Any]:
        return [*super().get_params(ctx), *ctx.meta.get(OPTIONS, ())]

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the command line. Raises TyperException for options of other formats."""
        from pipeline.export import EXPORTERS

        name = named_format(args)
        # whether the format exists is for the verb to say
        known = name in EXPORTERS and "--help" not in args
        options = ctx.meta[OPTIONS] = format_options([str(name)] if known else [*EXPORTERS])
        rest = super().parse_args(ctx, args)
        values = {each.name: ctx.params.pop(each.name) for each in options}
        ctx.meta[GIVEN] = {name: value for name, value in values.items() if value is not None}
        return rest


def export(
    ctx: typer.Context,
    dataset: Root,
    format_: Annotated[str, option(f"{FORMATS}.", "--format")],
    out: Annotated[
        Path | None, option("Directory of the export.", show_default="DATASET/exports/FORMAT")
    ] = None,
    also: Annotated[
        list[Path] | None,
        argument("Further datasets to join with it; needs --out.", metavar="[DATASET]..."),
    ] = None,
    split: Annotated[
        Literal["episodes", "failures"],
        option("What to export: the episodes, or the stored failed attempts."),
    ] = "episodes",
    embodiment: Annotated[
        str | None, option("Export these robots only, comma separated.", show_default="all")
    ] = None,
    where: Annotated[
        str | None, option('Export these episodes only, e.g. "level=3 and average_speed>0.1".')
    ] = None,
    validation: Annotated[
        float, number(0, 0.9, "Share of physics episodes in the split named validation.")
    ] = VALIDATION,
    fps: Annotated[
        int | None,
        number(
            1,
            240,
            "Frames a second, a divisor of 240; images are drawn again between frames.",
            show_default="as recorded",
        ),
    ] = None,
    weights: Annotated[
        str | None,
        option("Shares of the episodes of several datasets, like 2,1; without it all of them."),
    ] = None,
    workers: Workers = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Write a dataset in another format."""
    from pipeline.run.export import Request
    from pipeline.run.export import export as run_export

    source, robots = Dataset(dataset), split_list(embodiment)
    if embodiment is not None and not robots:
        raise names_nothing("--embodiment", embodiment)
    request = Request(
        format_,
        ctx.meta[GIVEN],
        out,
        split,
        robots or (),
        where,
        validation,
        [Dataset(root) for root in also or ()],
        numbers(weights, real, "--weights"),
        fps,
    )
    made = run_export(source, request, workers or usable_cores(), not as_json and not quiet)
    if made.warning:
        note(f"warning: {made.warning}")
    what = "failed attempts" if split == "failures" else "episodes"
    print_result(made.summary, as_json, f"{made.episodes} {what} written to {made.place}")


def publish(
    dataset: Root,
    format_: Annotated[str, option("The export to publish; it must exist.", "--format")],
    repo_id: Annotated[str, option("Name of the dataset repository, OWNER/NAME.")],
    private: Annotated[bool, option("Make the repository private.", "--private")] = False,
    dry_run: Annotated[bool, option("Only list what would be uploaded.", "--dry-run")] = False,
    yes: Annotated[bool, option("Do not ask before the upload.", "--yes")] = False,
    as_json: AsJson = False,
) -> None:
    """Publish an export on the Hugging Face hub; rerun the same command to resume."""
    from pipeline.export.publish import prepare
    from pipeline.export.publish import publish as send
    from pipeline.run.export import differences

    source = Dataset(dataset)
    place = source.exports(format_)
    if not place.is_dir():
        raise UsageError(
            f"{place} is not there: run `domino-data export {dataset} --format {format_}` first"
        )
    if held := forbidden(licences_in(source.made_by())):
        raise UsageError(
            f"{dataset}: shows {', '.join(held)}: this licence forbids publishing; ask its owner"
        )
    if problems := differences(source, place):
        raise UsageError(f"{problems[0]}: export it again first")
    shipment = prepare(place, repo_id, private)
    if dry_run or not as_json:
        print_result(shipment.as_dict(), as_json, shipment.describe())
    if shipment.problems:
        raise typer.Exit(1)
    if dry_run:
        return
    if not yes:
        if not sys.stdin.isatty():
            raise UsageError("nothing was uploaded: without a terminal to ask at, pass --yes")
        if not typer.confirm(f"Send this to {repo_id}?"):
            raise UsageError("nothing was sent")
    from huggingface_hub import HfApi, get_token

    token = get_token()
    if token is None:
        raise UsageError("the hub wants to know who you are: run `hf auth login`, or set HF_TOKEN")
    url = send(shipment, HfApi(token=token))
    print_result(shipment.as_dict() | {"url": url}, as_json, f"published: {url}")
