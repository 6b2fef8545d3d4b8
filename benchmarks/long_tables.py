"""Long tables of pages as CSV: `python -m benchmarks.long_tables PAGE.md ...`.

The first rows of each and its sums stay; all rows go into `tables` beside the page.
"""

import argparse
import csv
import io
import re
from collections.abc import Mapping
from itertools import count
from pathlib import Path

LONGEST, SHOWN = 6, 3  # rows of a table that stays whole, and of the head of a longer one
TABLE = re.compile(r"^\|.*\n\|[-:| ]+\|\n(?:\|.*(?:\n|\Z))+", re.MULTILINE)
SUMMARY = re.compile(r"\| (\*\*|level |all |95 % |slots |original)")  # a row that stays
HEADING = re.compile(r"^#+ (.*)$", re.MULTILINE)


def shortened(text: str, stem: str) -> tuple[str, Mapping[str, str]]:
    """A page's text with the heads of its long tables, and the CSV files by name."""
    files, linked = dict[str, str](), set(re.findall(r"\(tables/(\w+\.csv)\)", text))

    def head(match: re.Match[str]) -> str:
        lines = match[0].rstrip("\n").splitlines()
        rows = [cells(line) for line in (lines[0], *lines[2:])]
        if len(rows) - 1 <= LONGEST or text.startswith("\nThe first", match.end()):
            return match[0]
        headings = HEADING.findall(text, 0, match.start())
        base = f"{stem}_{slug(headings[-1] if headings else stem)}"
        free = (f"{base}_{k}" if k > 1 else base for k in count(1))
        name = next(name for name in free if f"{name}.csv" not in files.keys() | linked)
        out = io.StringIO()
        csv.writer(out, lineterminator="\n").writerows(rows)
        files[f"{name}.csv"] = out.getvalue()
        note = f"The first {SHOWN} of {len(rows) - 1} rows: [all](tables/{name}.csv)."
        last = [line for line in lines[2 + SHOWN :] if SUMMARY.match(line)]
        return "\n".join([*lines[: 2 + SHOWN], *last, "", note, ""])

    return TABLE.sub(head, text), files


def cells(line: str) -> list[str]:
    """The cells of a row; a break is a line break."""
    return [cell.strip().replace("<br>", "\n") for cell in line.strip()[1:-1].split(" | ")]


def slug(heading: str) -> str:
    """A heading as a part of a file's name."""
    return "_".join(re.findall(r"[a-z0-9]+", heading.lower())[:5])


def write_page(page: Path, text: str) -> None:
    """Write a page and the tables beside it."""
    short, files = shortened(text, page.stem)
    page.write_text(short)
    for name, data in files.items():
        (page.parent / "tables").mkdir(exist_ok=True)
        (page.parent / "tables" / name).write_text(data)


def is_written(page: Path, text: str) -> bool:
    """Whether a page and the tables beside it are those that `write_page` would write."""
    short, files = shortened(text, page.stem)
    places = {page.parent / "tables" / name: data for name, data in files.items()} | {page: short}
    return all(place.is_file() and place.read_text() == data for place, data in places.items())


def main() -> None:
    """Shorten pages in place."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("pages", nargs="+", type=Path)
    for page in parser.parse_args().pages:
        write_page(page, page.read_text())


if __name__ == "__main__":
    main()
