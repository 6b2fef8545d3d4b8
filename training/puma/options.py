"""Options that several commands of `puma` share, and the configuration that they name."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from training.puma.config import Config

Checkpoint = Annotated[
    Path,
    typer.Argument(
        help="A checkpoint, or the directory of a run: its newest one.", metavar="CHECKPOINT"
    ),
]
Configuration = Annotated[
    str,
    typer.Option("--config", help="A YAML file, or the name of a configuration (`puma configs`)."),
]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", help="A key of the configuration, such as train.steps=1000."),
]
Datasets = Annotated[
    list[Path] | None,
    typer.Option("--data", help="A dataset directory; several make a mixture of equal shares."),
]
Out = Annotated[Path, typer.Option(help="Directory of the run; rerun the same command to resume.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="Show no progress.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON for a program to read.")]


def configuration(name: str, settings: list[str] | None, data: list[Path] | None) -> "Config":
    """A configuration by its name, with settings "key=value", and with datasets, whose paths hold
    from any directory."""
    from training.puma.reading import read_config

    extra = (
        [f"data.sources={json.dumps([{'dataset': str(path.absolute())} for path in data])}"]
        if data
        else []
    )
    return read_config(name, [*extra, *(settings or [])])
