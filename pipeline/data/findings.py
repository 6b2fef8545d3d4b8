"""What a check of a contract found."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from pipeline.data.errors import DominoError
from pipeline.data.own_code import describe_error, file_of, line_of_class, line_of_error


@dataclass(frozen=True)
class Finding:
    """One clause of a contract: whether it holds, and what was seen."""

    name: str
    ok: bool
    detail: str


def catch_errors(
    name: str, author: type, check: Callable[[], Iterable[Finding]]
) -> Iterator[Finding]:
    """The findings of a check of what the class `author` makes; an error that its code causes is a
    finding of this name.

    The finding names the last line of the author's files that led to the error, or the line of the
    class.
    """
    try:
        yield from check()
    except DominoError as error:
        yield Finding(name, False, str(error))
    except Exception as error:  # noqa: BLE001 (whatever foreign code raises)
        place = line_of_error(error, file_of(author)) or line_of_class(author)
        yield Finding(name, False, f"{place}: {describe_error(error)}")
