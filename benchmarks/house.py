"""The rooms of the code: their size, what one call of a verb goes through, and which room imports
which.

    python -m benchmarks.house                          files, lines and characters by room; functions and files of three verbs
    python -m benchmarks.house docs/architecture.png    the picture of the import graph

A function counts if it is ours and is called at least once, in a process of its own for every verb:
a build of one slot, the evaluation of a policy on one scene, and an export of one episode. A file
counts if one of its functions does.
"""  # noqa: E501

import inspect
import subprocess
import sys
import threading
import tomllib
from pathlib import Path
from tempfile import TemporaryDirectory
from types import CodeType, FrameType

import grimp
import matplotlib.pyplot as plt

import domino_data
from pipeline.crew.contract import Crew
from pipeline.data.dataset import Dataset
from pipeline.run.build import build
from pipeline.run.export import Request, export
from pipeline.run.names import recipe_from

FLOORS = ({"domino_data"}, {"training.ladder", "training.puma"})
"""What is above pipeline/, from the top."""


def floors() -> list[list[str]]:
    """Rooms by floor, from the top: those above pipeline/, then its layers as the lint's contract
    has them, without the helpers."""
    contracts = tomllib.loads(Path("pyproject.toml").read_text())["tool"]["importlinter"][
        "contracts"
    ]
    layers = next(c["layers"] for c in contracts if c.get("containers") == ["pipeline"])
    return [sorted(floor) for floor in FLOORS] + [
        [f"pipeline.{room.strip()}" for room in layer.split("|")] for layer in layers[:-1]
    ]


def imports(rooms: list[str]) -> set[tuple[str, str]]:
    """(importer, imported) of the rooms that import one another directly; one that others imply is
    left out."""
    graph = grimp.build_graph("domino_data", "pipeline", "training")
    room_of = {
        module: room
        for module in graph.modules
        for room in rooms
        if module == room or module.startswith(room + ".")
    }
    direct = {
        (room_of[m], room_of[i])
        for m in room_of
        for i in graph.find_modules_directly_imported_by(m)
        if i in room_of
    }
    below: dict[str, set[str]] = {}
    for room in reversed(rooms):
        below[room] = {room}.union(
            *(below[lower] for upper, lower in direct if upper == room and lower != room)
        )
    return {
        (u, v)
        for u, v in direct
        if u != v and not any((u, w) in direct and w not in (u, v) and v in below[w] for w in rooms)
    }


def draw(out: Path) -> None:
    """Save the picture: one row a floor, a box a room, a line an import; all imports point
    downwards."""
    rows = floors()
    figure, axes = plt.subplots(figsize=(9, 8), dpi=100)
    places = {
        room: ((i + 0.5) / len(row), -y) for y, row in enumerate(rows) for i, room in enumerate(row)
    }
    for above, below in imports(list(places)):
        (x0, y0), (x1, y1) = places[above], places[below]
        bend = 0.25 if x0 == x1 and y0 - y1 > 1 else 0.0
        arrow = {
            "arrowstyle": "-|>",
            "color": "#3b6ea5",
            "lw": 1.2,
            "connectionstyle": f"arc3,rad={bend}",
        }
        axes.annotate("", (x1, y1 + 0.27), (x0, y0 - 0.27), arrowprops=arrow, zorder=1)
    for room, (x, y) in places.items():
        box = {"boxstyle": "round,pad=0.4", "fc": "#f4f1ea", "ec": "#444444", "lw": 0.8}
        axes.text(
            x,
            y,
            room.removeprefix("pipeline."),
            ha="center",
            va="center",
            fontsize=10,
            bbox=box,
            zorder=2,
        )
    axes.set_xlim(0, 1)
    axes.set_ylim(-len(rows) + 0.5, 0.5)
    axes.axis("off")
    figure.tight_layout(pad=0.2)
    figure.savefig(out)


def sizes() -> list[tuple[str, int, int, int]]:
    """Of every room of pipeline/: its name, files, lines and characters; the sum last."""
    found = dict[str, list[str]]()
    for path in sorted(Path("pipeline").rglob("*.py")):
        found.setdefault(path.parts[1] if len(path.parts) > 2 else "(helpers)", []).append(
            path.read_text()
        )
    rows = [
        (room, len(texts), sum(t.count("\n") for t in texts), sum(map(len, texts)))
        for room, texts in found.items()
    ]
    _, files, lines, characters = zip(*rows, strict=True)
    return [*rows, ("pipeline", sum(files), sum(lines), sum(characters))]


VERBS = ("build", "evaluate", "export")


def follow(verb: str, root: Path) -> tuple[int, int]:
    """Functions of ours that a verb calls, and the files that they are in. The dataset is below
    `root`, built by "build"."""
    recipe = recipe_from(
        {
            "tasks": "click_bell",
            "embodiments": "aloha",
            "levels": 1,
            "episodes": 1,
            "render": "raster-fast",
        }
    )
    called, mine = set[CodeType](), str(Path("pipeline").resolve())

    def note(frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        # not the bodies of modules and classes
        if (
            event == "call"
            and code.co_flags & inspect.CO_OPTIMIZED
            and code.co_filename.startswith(mine)
        ):
            called.add(code)

    def work() -> object:
        if verb == "build":
            return build(root / "set", recipe, Crew(), shown="none")
        if verb == "export":
            return export(Dataset(root / "set"), Request("parquet"))
        return domino_data.evaluate("static", recipe, root / "scores", episodes=1)

    threading.setprofile(note)
    sys.setprofile(note)
    try:
        work()
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
    named = {code for code in called if not code.co_name.startswith("<")}
    return len(named), len({code.co_filename for code in named})


def print_table() -> None:
    """Print both tables."""
    print("| room | files | lines | characters |\n|---|---:|---:|---:|")
    for row in sizes():
        print(f"| {row[0]} | {row[1]} | {row[2]:,} | {row[3]:,} |")
    print("\n| one call | functions | files |\n|---|---:|---:|")
    with TemporaryDirectory() as folder:
        for verb in VERBS:
            command = [sys.executable, "-m", "benchmarks.house", verb, folder]
            last = subprocess.run(
                command, check=True, stdout=subprocess.PIPE, text=True
            ).stdout.splitlines()[-1]
            print(f"| {verb} | {' | '.join(last.split())} |", flush=True)


if __name__ == "__main__":
    match sys.argv[1:]:
        case []:
            print_table()
        case [verb, folder] if verb in VERBS:
            print(*follow(verb, Path(folder)))
        case [out] if out.endswith(".png"):
            draw(Path(out))
        case _:
            print(__doc__)
