"""The `domino-data` command: a thin table of verbs. Bad input ends with one line on stderr and exit
code 2."""

import os
import sys
from functools import cached_property
from importlib import import_module
from importlib.metadata import entry_points, version
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command as command_of

from pipeline.crew.contract import SINGLE_THREAD

# before numpy, numba or Mesa read them
for _name, _value in SINGLE_THREAD.items():
    os.environ.setdefault(_name, _value)

from pipeline.commands.command import Verb, describe, run_app

MODULES = {
    "build": ("demo", "build", "plan", "render"),
    "inspect": ("status", "verify", "doctor", "diff", "merge", "gc"),
    "view": ("view",),
    "export": ("export", "publish"),
    "annotate": ("annotate",),
    "evaluate": ("evaluate",),
    "compare": ("compare", "check_result", "results"),
    "serve": ("freeze", "serve_policy"),
    "stores": ("pull", "push"),
    "catalogue": (
        *("tasks", "motions", "embodiments"),
        *("check_task", "check_object", "check_robot"),
    ),
    "intake": ("objects", "robots"),
}
"""The verbs by the module of pipeline.commands that has them."""

APPS = ("objects", "robots")
POINTS = {point.name: point for point in entry_points(group="domino_data.commands")}
"""Entry points that name functions, each a command of its own."""

PLACES = {
    verb.replace("_", "-"): f"pipeline.commands.{module}:{verb}{'_app' if verb in APPS else ''}"
    for module, verbs in MODULES.items()
    for verb in verbs
} | {name: point.value for name, point in POINTS.items()}


class Verbs(TyperGroup):
    """All verbs, and those of plugins, each imported when it is asked for."""

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        del self.commands  # typer's, which are none

    @cached_property
    def commands(self) -> Any:
        """All verbs as commands, by name."""
        return {name: self.load(name) for name in PLACES}

    def list_commands(self, ctx: Any) -> list[str]:
        return list(PLACES)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """What `--help` shows and the shell completes: a name and a sentence, nothing imported."""
        place = PLACES.get(cmd_name)
        return place and TyperCommand(cmd_name, help=describe(place))

    def load(self, name: str) -> Any:
        """The command of a verb. Raises PluginError."""
        from pipeline.commands.export import ExportCommand, export
        from pipeline.commands.stores import on_stores
        from pipeline.plugins import load_verb

        module, _, attribute = PLACES[name].partition(":")
        verb: Any = (
            load_verb(POINTS[name]) if name in POINTS else getattr(import_module(module), attribute)
        )
        holder = typer.Typer(add_completion=False, rich_markup_mode=None)
        if isinstance(verb, typer.Typer):
            holder.add_typer(verb, name=name)
            group: Any = command_of(holder)
            return group.commands[name]
        holder.command(cls=ExportCommand if verb is export else Verb)(on_stores(verb))
        return command_of(holder)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        name, found, rest = super().resolve_command(ctx, args)
        return name, found and self.load(str(name)), rest


app = typer.Typer(
    cls=Verbs,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # importing rich takes as long as everything else of --help
    context_settings={"max_content_width": 120},
)


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"domino-data {version('domino-data')}")
        raise typer.Exit


@app.callback()
def options(
    _version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version and exit."
        ),
    ] = False,
) -> None:
    """A dataset factory for robot manipulation of moving objects.

    Every command takes --plugins DIR: a directory whose modules add tasks, objects, robots,
    motions, exporters or policies.
    """


def split_plugins(words: list[str]) -> tuple[list[str], list[str]]:
    """The words without --plugins DIR, and the directories. Raises PluginError for one without
    DIR."""
    from pipeline.plugins import PluginError

    left: list[str] = []
    directories: list[str] = []
    rest = iter(words)
    for word in rest:
        if word == "--":
            return [*left, word, *rest], directories
        name, _, value = word.partition("=")
        if name != "--plugins":
            left.append(word)
        elif directory := value or next(rest, ""):
            directories.append(directory)
        else:
            raise PluginError("--plugins needs a directory")
    return left, directories


def words_after_plugins() -> list[str]:
    """The words of this command line, once the plugins that they name are loaded. Raises
    PluginError."""
    if sys.argv[1:] in (["--help"], ["--version"]):
        return sys.argv[1:]
    from pipeline.plugins import load_plugins, use_plugins

    words, directories = split_plugins(sys.argv[1:])
    use_plugins(directories)
    load_plugins()
    return words


def main() -> None:
    """Entry point."""
    run_app(app, "domino-data", words_after_plugins)


if __name__ == "__main__":
    main()
