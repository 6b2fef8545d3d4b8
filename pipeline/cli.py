"""The `domino-data` command: a thin table of verbs. Bad input ends with one line on stderr and exit
code 2."""

import io
import os
import sys
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from importlib.metadata import version
from typing import Annotated

import typer

from pipeline.crew.contract import SINGLE_THREAD

# before numpy, numba or Mesa read them
for _name, _value in SINGLE_THREAD.items():
    os.environ.setdefault(_name, _value)

from pipeline.commands.annotate import annotate
from pipeline.commands.build import build, plan, render
from pipeline.commands.catalogue import (
    check_object,
    check_robot,
    check_task,
    embodiments,
    motions,
    objects_app,
    robots_app,
    tasks,
)
from pipeline.commands.command import Command, run_app
from pipeline.commands.evaluate import compare, evaluate, paper_table, serve_policy
from pipeline.commands.export import ExportCommand, export, publish
from pipeline.commands.inspect import doctor, status, verify
from pipeline.commands.manage import diff, gc, merge, regenerate
from pipeline.commands.show import show, view
from pipeline.commands.stores import on_stores, pull, push
from pipeline.data.limited import Limits, run_limited
from pipeline.plugins import PluginError, announced_verbs, load_plugins, use_plugins
from pipeline.plugins import directories as plugin_directories

CHECK_LIMITS = Limits(memory=6 << 30, processor=3600, wall=7200.0)
VERBS = (
    *(
        build,
        plan,
        status,
        show,
        verify,
        render,
        view,
        export,
        publish,
        annotate,
        evaluate,
        compare,
        paper_table,
        serve_policy,
    ),
    *(
        diff,
        regenerate,
        merge,
        pull,
        push,
        gc,
        tasks,
        motions,
        embodiments,
        check_task,
        check_object,
        check_robot,
        doctor,
    ),
    *announced_verbs(),
)
CLASSES: dict[Callable[..., None], type[Command]] = {export: ExportCommand}
app = typer.Typer(no_args_is_help=True, pretty_exceptions_enable=False)


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


for _verb in VERBS:
    app.command(cls=CLASSES.get(_verb, Command))(on_stores(_verb))
app.add_typer(objects_app, name="objects")
app.add_typer(robots_app, name="robots")


def split_plugins(words: list[str]) -> tuple[list[str], list[str]]:
    """The words of a command line without --plugins DIR, wherever it is, and the directories.
    Raises PluginError for one that has none."""
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
    words, directories = split_plugins(sys.argv[1:])
    use_plugins(directories)
    if words[:1] == ["check-task"] and plugin_directories():
        # the code that is checked may end its process, but not this one
        code, out, err = run_limited(words[0], run_captured, words, limits=CHECK_LIMITS)
        print(out, end="")
        print(err, end="", file=sys.stderr)
        sys.exit(code)
    load_plugins()
    return words


def run_captured(words: list[str]) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of a command line with the plugins of the
    environment."""

    def loaded() -> list[str]:
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
