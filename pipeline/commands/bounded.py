"""Commands whose options are checked, each by its type, before anything else happens; and how an
application of them ends."""

import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, get_args

from typer import Typer, TyperException
from typer.core import TyperCommand, TyperOption

from pipeline.data.disk import describe_error
from pipeline.data.errors import DominoError
from pipeline.data.parsing import ParseError, line, real, show_value, whole
from pipeline.data.reading import printable
from pipeline.data.store.urls import with_urls


class BoundedCommand(TyperCommand):
    """A command that refuses values which no option accepts.

    These are numbers out of the range of their option or not written in digits, and texts and paths
    that are empty, longer than 4096 characters, or not on one line.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the command line. Raises TyperException, which names the option and its value."""
        if ctx.resilient_parsing:  # a shell completes the words
            return super().parse_args(ctx, args)
        given, _, _ = self.make_parser(ctx).parse_args(list(args))
        for param in self.get_params(ctx):
            raw = given.get(param.name or "")
            for text in raw if isinstance(raw, list | tuple) else [raw]:
                if isinstance(text, str) and (check := check_of(param)) is not None:
                    try:
                        check(text)
                    except ParseError as error:
                        ctx.fail(f"{name_of(param)} {show_value(text)} {error}")
        return super().parse_args(ctx, args)


def check_of(param: Any) -> Callable[[str], object] | None:
    """What reads the text of an option or argument, by its type; None for one that takes no text,
    or one of a few words."""
    kind = param.type_descriptor.annotation
    kind = next(iter(get_args(kind)), kind) if param.type_descriptor.is_list else kind
    info = param.type_descriptor.parameter_info
    if kind in (int, float):
        return partial(whole if kind is int else real, low=info.min, high=info.max)
    # "" is what such an option has where it is not given
    return line if kind in (str, Path) and param.default != "" else None


def name_of(param: Any) -> str:
    """An option as it is typed, or the name of an argument."""
    return (
        max(param.opts, key=len)
        if isinstance(param, TyperOption)
        else param.metavar or param.name.upper()
    )


def run_app(app: Typer, name: str, words: Callable[[], list[str]] = lambda: sys.argv[1:]) -> None:
    """Run an application on `words()` and exit: an expected error becomes a line on stderr that
    begins with `name`, exit code 2."""
    try:
        code = app(words(), standalone_mode=False)
    except TyperException as error:
        # a group without a word after it has printed its help
        if not (message := " ".join(error.format_message().split())):
            sys.exit(2)
        context = getattr(error, "ctx", None)
        said = f"{message.rstrip('.')}; see {context.command_path if context else name} --help"
    except DominoError as error:
        said = with_urls("; ".join([str(error), *getattr(error, "__notes__", ())]))
    except OSError as error:
        said = with_urls(describe_error(error))
    else:
        # the exit code of a verb that raised typer.Exit
        sys.exit(code if isinstance(code, int) else 0)
    print(f"{name}: {printable(said)}", file=sys.stderr)
    sys.exit(2)
