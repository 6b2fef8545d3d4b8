"""export and publish."""

import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import MISSING, fields
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

GIVEN = "given"
FORMATS = (
    "lerobot, lerobot-v2.1, aloha, robotwin, xpolicylab, parquet, zarr, robomimic, rlds,"
    " dynamicwam, puma-gt"
)


def format_flags(formats: Iterable[str]) -> dict[str, dict[str, bool]]:
    """Option as it is typed -> format that has it -> whether it takes no value there."""
    from pipeline.export import EXPORTERS
    from pipeline.export.options import flag_name, is_flag

    flags: dict[str, dict[str, bool]] = {}
    for name in formats:
        for f in fields(EXPORTERS[name].options):
            flags.setdefault(flag_name(f), {})[name] = is_flag(f)
    return flags


def split_options(
    args: list[str], own: set[str], flags: Mapping[str, bool], format_: str = ""
) -> tuple[list[str], dict[str, str | bool]]:
    """Arguments without the options of the format, and these by field name; `flags` is true for
    options without a value. Raises UsageError."""
    rest: list[str] = []
    given: dict[str, str | bool] = {}
    left = iter(args)
    for word in left:
        flag, sign, value = word.partition("=")
        if word == "--":
            return [*rest, word, *left], given
        if flag in flags:
            if not flags[flag] and not sign and (value := next(left, None)) is None:
                raise UsageError(f"{flag} needs a value")
            given[flag.removeprefix("--").replace("-", "_")] = True if flags[flag] else str(value)
        elif flag.startswith("--") and flag not in own:
            options = ", ".join(flags) or "none"
            raise UsageError(
                f"{flag} is not an option of export nor of --format {format_}, which has: {options}"
            )
        else:
            rest.append(word)
    return rest, given


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

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the command line. Raises UsageError for options that the format does not have."""
        from pipeline.export import EXPORTERS

        name, helps = named_format(args), "--help" in args
        # words that the shell completes
        if name is None and not helps and not ctx.resilient_parsing:
            raise UsageError(f"export needs --format: choose {', '.join(EXPORTERS)}")
        # whether the format exists is for the verb to say
        known = name is not None and name in EXPORTERS and not helps
        flags = format_flags([str(name)] if known else EXPORTERS)
        own = {option for parameter in self.get_params(ctx) for option in parameter.opts}
        alone = {flag: all(users.values()) for flag, users in flags.items()}
        rest, ctx.meta[GIVEN] = split_options(args, own, alone, name or "")
        if helps:
            self.epilog = _describe_options(flags)
        return super().parse_args(ctx, rest)


def _describe_options(flags: Mapping[str, Mapping[str, bool]]) -> str:
    from pipeline.export import EXPORTERS
    from pipeline.export.options import flag_name

    lines = ["Options of formats:"]
    for flag, users in flags.items():
        f = next(f for f in fields(EXPORTERS[next(iter(users))].options) if flag_name(f) == flag)
        stated = f.default is not MISSING and f.default != "" and not isinstance(f.default, bool)
        default = f"; default {f.default}" if stated and f.default is not None else ""
        lines.append(f"{flag} ({', '.join(users)}): {f.metadata['help']}{default}")
    return "\n\n".join(lines)


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
    from pipeline.export import EXPORTERS
    from pipeline.export.publish import prepare
    from pipeline.export.publish import publish as send
    from pipeline.run.export import differences

    source = Dataset(dataset)
    if format_ not in EXPORTERS:
        raise UsageError(f"--format {format_!r} is unknown: choose {', '.join(EXPORTERS)}")
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
