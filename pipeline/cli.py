"""The `domino-data` command: a thin table of verbs. Bad input ends with one line on stderr and exit
code 2."""

import os
import sys
from collections.abc import Callable
from importlib.metadata import entry_points, version
from typing import Annotated, Any

import typer

from pipeline.crew.contract import SINGLE_THREAD

# before numpy, numba or Mesa read them
for _name, _value in SINGLE_THREAD.items():
    os.environ.setdefault(_name, _value)

from pipeline.commands.command import LazyGroup, Verb, run_app

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
PLACES = {
    verb.replace("_", "-"): f"pipeline.commands.{module}:{verb}{'_app' if verb in APPS else ''}"
    for module, verbs in MODULES.items()
    for verb in verbs
}
POINTS = {point.name: point for point in entry_points(group="domino_data.commands")}
"""Entry points that name functions, each a command of its own."""


class Verbs(LazyGroup):
    """All verbs, and those of plugins."""

    places = PLACES | {name: point.value for name, point in POINTS.items()}

    def find(self, name: str) -> Any:
        if name not in POINTS:
            return super().find(name)
        from pipeline.plugins import load_verb

        return load_verb(POINTS[name])

    def typer_of(self, verb: Callable[..., None]) -> typer.Typer:
        from pipeline.commands.export import ExportCommand, export
        from pipeline.commands.stores import on_stores

        app = typer.Typer(add_completion=False, rich_markup_mode=None)
        app.command(cls=ExportCommand if verb is export else Verb)(on_stores(verb))
        return app


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
