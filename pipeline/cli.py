"""The `domino-data` command: a thin table of verbs. Bad input ends with one line on stderr and exit
code 2."""

import io
import os
import sys
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from importlib.metadata import entry_points, version
from typing import Annotated, Any

import typer

from pipeline.crew.contract import SINGLE_THREAD

# before numpy, numba or Mesa read them
for _name, _value in SINGLE_THREAD.items():
    os.environ.setdefault(_name, _value)

from pipeline.commands.command import LazyGroup, Verb, run_app

ANNOUNCED = "domino_data.commands"
"""Entry points that name functions, each a command of its own."""

MODULES = {
    "demo": ("demo",),
    "build": ("build", "plan", "render"),
    "inspect": ("status", "verify", "doctor", "diff", "merge", "gc"),
    "view": ("view",),
    "export": ("export", "publish"),
    "annotate": ("annotate",),
    "evaluate": ("evaluate",),
    "freeze": ("freeze",),
    "compare": ("compare", "check_result", "results", "paper_table"),
    "serve": ("serve_policy",),
    "stores": ("pull", "push"),
    "catalogue": (
        "tasks",
        "motions",
        "embodiments",
        "check_task",
        "check_object",
        "check_robot",
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
POINTS = {point.name: point for point in entry_points(group=ANNOUNCED)}


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
    """The words of a command line without --plugins DIR, wherever it is, and the directories.
    Raises PluginError for one that has none."""
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
        elif not (directory := value or next(rest, "")):
            raise PluginError("--plugins needs a directory")
        else:
            directories.append(directory)
    return left, directories


def words_after_plugins() -> list[str]:
    """The words of this process's command line, once the plugins that they name are loaded. Raises
    PluginError."""
    if sys.argv[1:] in (["--help"], ["--version"]):
        return sys.argv[1:]
    from pipeline.plugins import directories as plugin_directories
    from pipeline.plugins import load_plugins, use_plugins

    words, directories = split_plugins(sys.argv[1:])
    use_plugins(directories)
    if words[:1] == ["check-task"] and plugin_directories():
        from pipeline.data.process.limited import Limits, run_limited

        # the code that is checked may end its process, but not this one
        limits = Limits(memory=6 << 30, processor=3600, wall=7200.0)
        code, out, err = run_limited(words[0], run_captured, words, limits=limits)
        print(out, end="")
        print(err, end="", file=sys.stderr)
        sys.exit(code)
    load_plugins()
    return words


def run_captured(words: list[str]) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of a command line with the plugins of the
    environment."""

    def loaded() -> list[str]:
        from pipeline.plugins import load_plugins

        load_plugins()
        return words

    code, out, err = 0, io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        try:
            run_app(app, "domino-data", loaded)
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 1
    return code, out.getvalue(), err.getvalue()


def main() -> None:
    """Entry point."""
    run_app(app, "domino-data", words_after_plugins)


if __name__ == "__main__":
    main()
