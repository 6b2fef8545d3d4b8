"""Pages from jinja2 templates, and text for Markdown. Every value of HTML is escaped; one of
Markdown is given escaped."""

import base64
import re
from collections.abc import Iterable, Sequence
from functools import cache
from html import escape

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined


def render_page(package: str, template: str, **values: object) -> str:
    """The text of `template` in the folder templates/ of a package, filled with `values`.

    Filters beside jinja2's own: `jpeg` and `mp4` (bytes -> data URI), `anchor` (title -> id).
    Raises jinja2.UndefinedError."""
    return _environment(package).get_template(template).render(**values)


@cache
def _environment(package: str) -> Environment:
    """The templates of a package, each compiled once."""
    environment = Environment(
        loader=ChoiceLoader([PackageLoader(package), PackageLoader("pipeline")]),
        autoescape=lambda name: not str(name).endswith(".md.jinja"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"jpeg": _jpeg_uri, "mp4": mp4_uri, "anchor": _anchor}
    return environment


def _jpeg_uri(jpeg: bytes) -> str:
    return f"data:image/jpeg;base64,{base64.b64encode(jpeg).decode()}"


def mp4_uri(mp4: bytes) -> str:
    return f"data:video/mp4;base64,{base64.b64encode(mp4).decode()}"


def _anchor(title: str) -> str:
    """The id of a section: letters and digits of its title in lower case, hyphens for others."""
    return "".join(c if c.isalnum() else "-" for c in title.lower())


class Markdown(str):
    """Text that is Markdown already: `markdown` leaves it as it is."""


def markdown(value: object) -> str:
    """A value as one line of Markdown text, in which nothing is markup."""
    if isinstance(value, Markdown):
        return value
    text = escape(_line(str(value)), quote=False)
    return "".join(f"&#{ord(c)};" if c in "`[]|" else c for c in text)


def code_span(value: object) -> Markdown:
    """A value as code within a line or a table's cell."""
    return Markdown("`" + _line(str(value)).replace("`", "'").replace("|", "\\|") + "`")


def code_block(text: str, language: str) -> Markdown:
    """Lines as a block of code, which no line of them can end."""
    fence = max(re.findall("`+", text), key=len, default="").rjust(3, "`")
    fence += "`" * (fence in text)
    lines = [fence + language, *map(_line, text.strip().splitlines()), fence]
    return Markdown("\n".join(lines) + "\n")


def table(head: str, rows: Iterable[Sequence[object]]) -> str:
    """A Markdown table: cells of the head are Markdown, parted by bars; others are escaped."""
    cells = head.split(" | ")
    lines = [cells, ["---"] * len(cells), *(map(markdown, row) for row in rows)]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n\n"


def bullets(lines: Iterable[str]) -> str:
    """A Markdown list of lines that are Markdown."""
    return "".join(f"- {line}\n" for line in lines)


def _line(text: str) -> str:
    return "".join(
        c if c.isprintable() else c.encode("unicode_escape", "surrogatepass").decode() for c in text
    )
