"""Tables and lists in Markdown."""

from collections.abc import Iterable, Sequence

from pipeline.html import markdown


def table(head: str, rows: Iterable[Sequence[object]]) -> str:
    """A Markdown table: cells of the head are Markdown, parted by bars; others are escaped."""
    cells = head.split(" | ")
    lines = [cells, ["---"] * len(cells), *(map(markdown, row) for row in rows)]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n\n"


def bullets(lines: Iterable[str]) -> str:
    """A Markdown list."""
    return "".join(f"- {line}\n" for line in lines)
