"""The tables of the documents are those that follow from the code."""

from pathlib import Path

import pytest

from pipeline.data.recipe.model import Recipe
from pipeline.expert import skills
from pipeline.world.objects import FAMILIES
from scripts.reference import CSV, LONG, TABLES, as_csv, with_tables

DOCS = Path(__file__).parents[1] / "docs"


@pytest.mark.parametrize("page", ["add_a_task.md", "add_an_object.md", "recipes.md"])
def test_the_tables_of_a_page_are_up_to_date(page):
    text = (DOCS / page).read_text()
    assert with_tables(text) == text, f"update them: python -m scripts.reference docs/{page}"


@pytest.mark.parametrize("name", LONG)
def test_the_rows_of_a_long_table_are_up_to_date(name):
    text = (CSV / f"{name}.csv").read_text()
    assert text == as_csv(name), "update it: python -m scripts.reference"


def test_an_edited_table_is_written_anew():
    text = (DOCS / "recipes.md").read_text()
    assert with_tables(text.replace("| `seed` | `0` |", "| `seed` | `1` |")) == text
    assert "`seed`" in text


def test_every_table_is_on_a_page_and_says_all():
    pages = "".join(page.read_text() for page in DOCS.glob("*.md"))
    assert all(f"<!-- generated: {name} -->" in pages for name in TABLES)
    for name in Recipe.model_fields:
        assert f"| `{name}` |" in pages
    families = (CSV / "families.csv").read_text()
    assert all(f"\n{name}," in families for name in FAMILIES)
    assert all(f"| `{name}(" in pages for name, found in vars(skills).items() if callable(found))
    assert all(field.description for field in Recipe.model_fields.values())
