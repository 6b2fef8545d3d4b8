"""The commands `domino-data` and `puma`. They are outside of all packages so that they can refuse
foreign ones in one line."""

import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

PACKAGES = ("pipeline", "training")


def find_foreign() -> str:
    """Which package another one of the same name shadows, where it is, and the fix, in one line; ""
    if none does."""
    home = Path(__file__).resolve().parent
    for name in PACKAGES:
        spec = find_spec(name)
        origin = spec and spec.origin
        if origin is None or Path(origin).resolve().parents[1] != home:
            found = (
                f"{Path(origin).parent} is imported instead"
                if origin
                else "it is missing, or another folder hides it"
            )
            return (
                f"the package `{name}` of domino-data is not the one that Python finds: {found};"
                " remove that from PYTHONPATH, or install domino-data into an environment of its"
                " own (uv tool install)"
            )
    return ""


def main() -> None:
    """Entry point of `domino-data`."""
    _run("domino-data", "pipeline.cli")


def puma() -> None:
    """Entry point of `puma`."""
    _run("puma", "training.puma.cli")


def _run(name: str, module: str) -> None:
    if foreign := find_foreign():
        print(f"{name}: {foreign}", file=sys.stderr)
        sys.exit(2)
    import_module(module).main()
