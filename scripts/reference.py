"""The tables of the documents that are generated from the code: `python -m scripts.reference
docs/*.md` updates them.

A page marks where a table goes by a line `<!-- generated: NAME -->`; it ends at the line `<!-- end
-->`.
"""

import csv
import inspect
import io
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from benchmarks.long_tables import cells
from pipeline.data.recipe.model import KEYS, Recipe
from pipeline.expert import scripts, skills
from pipeline.expert.candidates import GraspOptions
from pipeline.intake.catalogue.listings import list_objects
from pipeline.tasks.contract import Draw, Placement, Region, Task
from pipeline.tasks.outcome import Outcome
from pipeline.world.objects import FAMILIES

CSV = Path(__file__).parents[1] / "docs" / "measurements" / "tables"


def with_tables(page: str) -> str:
    """The text of a page with every table as it follows from the code now. Raises KeyError for a
    table that does not exist."""

    def again(found: re.Match[str]) -> str:
        return f"{found[1]}{shown(found[2])}\n{found[3]}"

    return re.sub(
        r"(^<!-- generated: (\w+) -->\n).*?(^<!-- end -->$)",
        again,
        page,
        flags=re.MULTILINE | re.DOTALL,
    )


def shown(name: str) -> str:
    """A table as its page has it: of a LONG one the first rows."""
    table = TABLES[name]()
    if name not in LONG:
        return table
    head, count = table.splitlines()[: 2 + SHOWN], len(table.splitlines()) - 2
    note = f"The first {SHOWN} of {count} rows: [all](measurements/tables/{name}.csv)."
    return "\n".join([*head, "", note])


def as_csv(name: str) -> str:
    """All rows of a table as CSV, code and escapes as plain text."""
    lines = [line for line in TABLES[name]().splitlines() if not line.startswith("|---")]
    out = io.StringIO()
    plain_rows = ([c.replace("`", "").replace("\\|", "|") for c in cells(line)] for line in lines)
    csv.writer(out, lineterminator="\n").writerows(plain_rows)
    return out.getvalue()


def rows(headers: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """A table in Markdown."""
    body = [" | ".join(cell.replace("|", "\\|") for cell in line) for line in lines]
    ruler = "|".join("---" for _ in headers)
    return "\n".join(
        (f"| {' | '.join(headers)} |", f"|{ruler}|", *(f"| {line} |" for line in body))
    )


def first_paragraph(thing: object) -> str:
    """The first paragraph of a docstring on one line."""
    return " ".join((inspect.getdoc(thing) or "").partition("\n\n")[0].split())


def whole(thing: object) -> str:
    """A docstring on one line."""
    return " ".join((inspect.getdoc(thing) or "").split())


class _Text(str):
    """A text that stands for a default as it is, without quotation marks."""

    __repr__ = str.__str__


def signature(name: str, function: Callable[..., Any]) -> str:
    """How a function is called: names of its arguments with their defaults, numbers rounded;
    neither types nor self."""
    # a skill takes no actor: its decorator does
    dropped = ("self", "a") if hasattr(function, "__wrapped__") else ("self",)
    given = [
        p.replace(annotation=p.empty)
        for p in inspect.signature(function).parameters.values()
        if p.name not in dropped
    ]
    shown = [
        p if p.default is p.empty else p.replace(default=_Text(plain(p.default))) for p in given
    ]
    return f"`{name}{inspect.Signature(shown)}`"


def plain(value: object) -> str:
    """A default as it is written in a call or a recipe."""
    if isinstance(value, float):
        return f"{value:.3g}"
    if isinstance(value, tuple | list):
        return f"({', '.join(map(plain, value))}{',' if len(value) == 1 else ''})"
    if type(value).__module__ == "pipeline.data.setup.rules":
        return "STRICT"
    return repr(value)


def skill_functions() -> str:
    """Skills and what they do."""
    every = {
        name: found
        for name, found in sorted(vars(skills).items())
        if callable(found) and not name.startswith("_")
    }
    every |= {name: getattr(scripts, name) for name in ("set_down_on", "let_go")}
    lines = [(signature(name, f), first_paragraph(f)) for name, f in every.items()]
    lines.append(("`kinds`, `goals`, `standoff`, `pitch` of `grasp`", whole(GraspOptions)))
    return rows(("skill", "what it does"), lines)


def outcome_questions() -> str:
    """Questions that success conditions ask."""
    methods = [
        (n, m) for n, m in vars(Outcome).items() if inspect.isfunction(m) and not n.startswith("_")
    ]
    return rows(
        ("question", "answer"), [(signature(f"o.{n}", m), first_paragraph(m)) for n, m in methods]
    )


def placements() -> str:
    """A placement, its region, and the random choices."""
    lines = [(signature(cls.__name__, cls), whole(cls)) for cls in (Placement, Region)]
    lines += [
        (signature(f"draw.{n}", m), first_paragraph(m))
        for n, m in vars(Draw).items()
        if inspect.isfunction(m) and n[0] != "_"
    ]
    return rows(("call", "meaning"), lines)


def task_attributes() -> str:
    """Class attributes of a task with their defaults."""
    hints = {name: hint for name, hint in inspect.get_annotations(Task).items() if name != "name"}
    defaults = {
        name: f"`{plain(getattr(Task, name))}`" if hasattr(Task, name) else "must be given"
        for name in hints
    }
    defaults |= dict.fromkeys(("seen", "unseen"), "from `phrases/NAME.txt`")
    defaults |= {"category": "by `manipulated`", "manipulated": "the target"}
    return rows(
        ("attribute", "default"), [(f"`{name}`", default) for name, default in defaults.items()]
    )


def families() -> str:
    """Object families with their frames and grasps, of the instance of seed 0."""
    described = list_objects(sorted(FAMILIES))
    lines = [
        (
            f"`{name}`",
            " x ".join(f"{100 * s:.1f}" for s in d["size"]),
            ", ".join(d["frames"]),
            ", ".join(sorted(d["grasps"])),
        )
        for name, d in described.items()
    ]
    return rows(("family", "size of seed 0 (cm)", "frames", "kinds of grasps"), lines)


def recipe_keys() -> str:
    """Keys of a recipe with their defaults and meaning."""
    return rows(("key", "default", "meaning"), [_recipe_key(name) for name in KEYS])


def _recipe_key(name: str) -> tuple[str, str, str]:
    field = Recipe.model_fields[name]
    value = field.default if field.default is not PydanticUndefined else field.default_factory()  # pyright: ignore
    text = (
        ", ".join(map(str, value))
        if isinstance(value, tuple)
        else ""
        if isinstance(value, Mapping)
        else _yaml(value)
    )
    allowed = _describe_values(Recipe.model_json_schema()["properties"][name])
    return (
        f"`{name}`",
        f"`{text}`" if text else "none",
        " ".join((field.description or "").split()) + allowed,
    )


def _yaml(value: object) -> str:
    """A single value as a recipe has it."""
    if isinstance(value, BaseModel):
        return "{" + ", ".join(f"{name}: {_yaml(part)}" for name, part in value) + "}"
    return (
        str(value).lower() if isinstance(value, bool) else "null" if value is None else str(value)
    )


def _describe_values(schema: Mapping[str, Any]) -> str:
    """What values a key may have, from its JSON schema."""
    schema, *others = schema.get("anyOf", [schema])
    one = schema.get("items", schema) if schema.get("type") == "array" else schema
    if choices := one.get("enum"):
        if any(other.get("type") != "null" for other in others):
            return ""
        return (
            f" One of {', '.join(map(str, choices))}."
            if one is schema
            else f" Any of {', '.join(map(str, choices))}."
        )
    bounds = [one[key] for key in ("minimum", "maximum") if key in one]
    if not bounds:
        return ""
    return (
        f" From {bounds[0]:,} to {bounds[1]:,}." if len(bounds) == 2 else f" {bounds[0]:,} or more."
    )


SHOWN = 5
LONG = ("outcome_questions", "families")
"""Tables of which a page has the first SHOWN rows, and docs/measurements/tables all."""

MAKERS = (skill_functions, outcome_questions, placements, task_attributes, families, recipe_keys)
TABLES: dict[str, Callable[[], str]] = {make.__name__: make for make in MAKERS}


def main(paths: Sequence[str]) -> None:
    """Update the generated tables of these pages."""
    for name in LONG:
        (CSV / f"{name}.csv").write_text(as_csv(name))
    for path in map(Path, paths):
        path.write_text(with_tables(path.read_text()))


if __name__ == "__main__":
    main(sys.argv[1:])
