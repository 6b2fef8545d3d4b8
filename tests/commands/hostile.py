"""Every option of every command, with what its type cannot be."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from typer.core import TyperCommand, TyperOption
from typer.main import get_command

from pipeline.cli import app
from pipeline.commands.bounded import check_of, name_of
from training.puma.cli import app as puma

WORDS = ("1_0", "١٠", "ten", "nan", "inf", "-inf", "1e400", "0x10", "1,2", "--1")
NUMBERS = (*WORDS, "", " ", "1\n", "1" * 5000, f"{10**30}", f"-{10**30}")
TEXTS = ("", " ", "a\nb", "a\x1b[31mb", "a\x00b", "a\x85b", "a\u2028b", "a\u202eb", "a" * 5000)
HOSTILE = {int: (*NUMBERS, "1.5", "1e3"), float: NUMBERS, str: TEXTS, Path: TEXTS}


def commands() -> Iterator[tuple[tuple[str, ...], TyperCommand]]:
    """Every command, with the words that call it."""
    todo: list[tuple[tuple[str, ...], Any]] = [
        (("domino-data",), get_command(app)),
        (("puma",), get_command(puma)),
    ]
    while todo:
        words, command = todo.pop()
        if isinstance(command, TyperCommand):
            yield words, command
        else:
            todo += [((*words, name), each) for name, each in command.commands.items()]


COMMANDS = dict(commands())


def kind_of(param: Any) -> type:
    found = param.type_descriptor.annotation
    return found.__args__[0] if param.type_descriptor.is_list else found


def words_of(words: tuple[str, ...], param: Any, text: str) -> list[str]:
    """An option of a command, or an argument after the others, with a value."""
    before = ["--format=parquet"] if words[-1] == "export" and param.name != "format_" else []
    if isinstance(param, TyperOption):
        return [*before, f"{name_of(param)}={text}"]
    arguments = [each for each in COMMANDS[words].params if not isinstance(each, TyperOption)]
    return [*before, "--", *["x"] * arguments.index(param), text]


def refused() -> Iterator[tuple[tuple[str, ...], Any, str]]:
    """The words of a command, one of its options, and a value that the option must refuse."""
    for words, command in COMMANDS.items():
        for param in command.params:
            yield from (
                (words, param, text)
                for text in (HOSTILE[kind_of(param)] if check_of(param) is not None else ())
            )
