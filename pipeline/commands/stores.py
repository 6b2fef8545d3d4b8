"""URLs of object stores in place of dataset directories."""

from collections.abc import Callable
from contextlib import ExitStack
from functools import wraps
from pathlib import Path
from typing import Annotated, Any

from pipeline.data.names import MANIFEST
from pipeline.data.reading import check_tree
from pipeline.data.store import place
from pipeline.data.store.files import url_of

from .common import AsJson, UsageError, argument, at_terminal, print_result

READS, DRAWN, WHOLE = (place.SMALL, False), (place.ALL, False), (place.ALL, True)
MADE = (place.REPORT, True)
EXPORTED = (place.SMALL + r"|(episodes|failures|annotations)/.*", True)
TAKEN = {
    "build": {"out": MADE, "like": READS},
    "plan": {"out": READS, "like": READS},
    "evaluate": {"like": READS},
    "status": {"dataset": READS},
    "verify": {"dataset": READS},
    "render": {"dataset": DRAWN, "out": MADE},
    "view": {"dataset": DRAWN},
    "export": {"dataset": EXPORTED, "out": WHOLE},
    "annotate": {"dataset": WHOLE},
    "diff": {"a": READS, "b": READS},
    "gc": {"dataset": WHOLE},
}
"""Of every verb the parameters that may be URLs: what is pulled first, and whether it is
changed."""


def on_stores(verb: Callable[..., None]) -> Callable[..., None]:
    """The verb, which works in directories (data/store/place.py) if URLs are given. Raises
    UsageError."""
    taken = TAKEN.get(verb.__name__, {})

    @wraps(verb)
    def run(**given: Any) -> None:
        with ExitStack() as stack:
            for name, value in list(given.items()):
                paths = [each for each in _listed(value) if isinstance(each, Path)]
                if url := next(filter(None, map(url_of, paths)), None):
                    if name not in taken:
                        word = verb.__name__.replace("_", "-")
                        raise UsageError(f"{url}: {word} takes a path of this machine there")
                    page = verb.__name__ == "view"
                    if page and not (given["out"] or given["serve"] or at_terminal()):
                        raise UsageError(
                            f"{url}: the pages are for this machine: add --out DIR, or --serve"
                        )
                    root = given[name] = stack.enter_context(place.open_place(url, *taken[name]))
                    if name != "out" and not (root / MANIFEST).exists():
                        raise UsageError(f"{url} is no dataset: it has no {MANIFEST}")
                elif isinstance(value, Path) and value.parts and ":" in value.parts[0]:
                    given[name] = Path.cwd() / value  # no library takes it for a URL
            verb(**given)

    return run


def _listed(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [value]


Url = Annotated[str, argument("A place on an object store.", metavar="URL")]
Directory = Annotated[Path, argument("A directory.", metavar="DIR")]


def pull(url: Url, directory: Directory, as_json: AsJson = False) -> None:
    """Copy what is below a URL to a directory of this machine. Of files that are there already,
    recipe, index and tables are copied again, others if their size differs; rerun it to resume."""
    from pipeline.run.copy import pull as run_pull

    check_tree(directory)
    _print_moved(*run_pull(_named(url), directory), f"fetched to {directory}", as_json)


def push(directory: Directory, url: Url, as_json: AsJson = False) -> None:
    """Copy the files of a directory to a URL. Of files that are there already, recipe, index and
    tables are copied again, others if their size differs; rerun it to resume."""
    from pipeline.run.copy import push as run_push

    if not directory.is_dir():
        raise UsageError(f"{directory} is no directory")
    check_tree(directory)
    _print_moved(*run_push(directory, _named(url)), f"put to {url}", as_json)


def _named(url: str) -> str:
    if known := url_of(url):
        return known
    fix = "copy to a directory with cp or rsync"
    raise UsageError(f"{url} is no URL of an object store, such as s3://bucket/sets/bells; {fix}")


def _print_moved(files: int, moved: int, where: str, as_json: bool) -> None:
    text = f"{moved} of {files} files {where}" + "; the others were there" * (moved < files)
    print_result({"files": files, "moved": moved}, as_json, text)
