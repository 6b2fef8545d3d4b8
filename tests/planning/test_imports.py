"""Which rooms a room may import: read from the source, imports for type checkers included."""

import ast
from pathlib import Path

import pytest

PIPELINE = Path(__file__).parents[2] / "pipeline"
PLANNING = {"planning", "world", "motion", "data", "poses"}
ALLOWED = {"planning": PLANNING, "expert": PLANNING | {"expert"}}


def imported(path: Path) -> set[str]:
    """Modules of the project that a file names in an import statement."""
    names = set[str]()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            module = node.module or ""
            if node.level:  # from a module of the same folder
                module = f"{module_of(path).rpartition('.')[0]}.{module}".rstrip(".")
            names |= {module} | {f"{module}.{alias.name}" for alias in node.names}
    return {name for name in names if name.startswith("pipeline.")}


def module_of(path: Path) -> str:
    parts = path.relative_to(PIPELINE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def edges(room: str) -> dict[str, set[str]]:
    """Modules of a room -> the modules of the same room that they import."""
    files = {module_of(path): path for path in (PIPELINE / room).rglob("*.py")}
    return {
        name: {other for other in imported(path) if other in files} - {name}
        for name, path in files.items()
    }


@pytest.mark.parametrize("room", sorted(ALLOWED))
def test_a_room_imports_only_rooms_below_it(room: str) -> None:
    files = list((PIPELINE / room).rglob("*.py"))
    assert len(files) > 5
    for path in files:
        rooms = {name.split(".")[1] for name in imported(path)}
        assert rooms <= ALLOWED[room], f"{path} imports {sorted(rooms - ALLOWED[room])}"


@pytest.mark.parametrize("room", sorted(ALLOWED))
def test_there_is_no_cycle_inside_a_room(room: str) -> None:
    left = edges(room)
    assert any(left.values())
    while left:
        ready = {name for name, needs in left.items() if not needs & left.keys()}
        assert ready, f"these import each other: {sorted(left)}"
        left = {name: needs for name, needs in left.items() if name not in ready}


def test_an_import_for_type_checkers_counts(tmp_path: Path) -> None:
    module = tmp_path / "module.py"
    module.write_text(
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from pipeline.expert.actor import"
        " Actor\n"
    )
    assert imported(module) == {"pipeline.expert.actor", "pipeline.expert.actor.Actor"}
