"""Cases of bad input about what evaluations and plugins read: results, manifests of seeds,
directories of plugins."""

import json
from collections.abc import Iterator
from pathlib import Path

from pipeline.data.atomic import write_atomic
from pipeline.evaluate.scenes.manifests import Manifests
from tests.commands.bad_input import Case
from tests.evaluate.test_bad_files import (
    CELL,
    FIELDS,
    LINES,
    OTHERS,
    ROW,
    TEXTS,
    changed,
    manifest_values,
)

WORDS = (
    "evaluate --policy random --tasks click_bell --levels 1 --episodes 1 --executor inline --quiet"
)
EVALUATE = tuple(WORDS.split())

PLUGINS = {
    "syntax": {"own.py": "1 +"},
    "raises": {"own.py": "raise RuntimeError('no\\nlicence')"},
    "exits": {"own.py": "import sys\nsys.exit(0)"},
    "imports": {"own.py": "import no_such_module_anywhere"},
    "null": {"own.py": "\0"},
    "deep": {"own.py": "x = " + "(" * 5000 + ")" * 5000},
    "module": {"numpy.py": ""},
    "package": {"json/__init__.py": ""},
    "task": {
        "own.py": "from pipeline.tasks import TASKS\nTASKS.add('click_bell', TASKS['click_bell'])"
    },
    "policy": {
        "own.py": "from pipeline.evaluate.names import POLICIES\nPOLICIES.add('random', None)"
    },
    "number": {"1own.py": "1/0"},
}
"""Files by name of a directory of plugins that cannot be used."""

NO_PLUGINS = ("missing", "file", "file/inside", "", "a\x1b[31mb", "x" * 300)
"""What is no directory of plugins."""


def evaluations(root: Path) -> Iterator[Case]:
    """Evaluations whose results or manifests hold something else; the files are written below
    `root`."""
    rows = [json.dumps(ROW | {key: value}).encode() for key, value in FIELDS[::4]]
    for number, line in enumerate((*rows, *LINES[::2])):
        out = root / "results" / str(number)
        out.mkdir(parents=True)
        (out / "episodes.jsonl").write_bytes(json.dumps(ROW).encode() + b"\n" + line + b"\n")
        yield Case((*EVALUATE, "--out", f"results/{number}"), "line 2 is no result")
    contradicting = root / "results" / "contradicting"
    contradicting.mkdir(parents=True)
    lines = [json.dumps(ROW | {"success": success}) for success in (False, True)]
    (contradicting / "episodes.jsonl").write_text("".join(f"{line}\n" for line in lines))
    yield Case((*EVALUATE, "--out", "results/contradicting"), "line 2 contradicts")
    (root / "results" / "directory" / "episodes.jsonl").mkdir(parents=True)
    yield Case((*EVALUATE, "--out", "results/directory"), "episodes.jsonl")
    whole = manifest_values()
    texts = [json.dumps(changed(whole, path, value)).encode() for path, value in OTHERS[::5]]
    for number, text in enumerate((*texts, *TEXTS[::3])):
        write_atomic(Manifests(root / "seeds" / str(number)).path(CELL), text)
        yield Case(
            (*EVALUATE, "--out", "OUT", "--manifests", f"seeds/{number}"),
            "delete it to draw them again",
        )
    for place in ("file", "file/inside"):
        yield Case((*EVALUATE, "--out", place), "is no directory")
        yield Case((*EVALUATE, "--out", "OUT", "--manifests", place), "is no directory")
        yield Case(
            ("ladder", "--tasks", "click_bell", "--executor", "inline", "--quiet", "--out", place),
            "is no directory",
        )


def plugins(root: Path) -> Iterator[Case]:
    """Commands with plugins that cannot be used; the files are written below `root`."""
    for name, files in PLUGINS.items():
        for file, text in files.items():
            path = root / "plugins" / name / file
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        yield Case(("tasks", "--plugins", f"plugins/{name}"), f"plugins/{name}")
    for place in NO_PLUGINS:
        yield Case(("tasks", f"--plugins={place}"), "--plugins")
    yield Case(("tasks", "--plugins"), "--plugins needs a directory")
