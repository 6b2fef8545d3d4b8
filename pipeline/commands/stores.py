"""URLs of object stores (s3://, gs://, hf://, ...) in place of dataset directories: which verbs
take them where."""

from collections.abc import Callable
from contextlib import ExitStack
from functools import wraps
from pathlib import Path
from typing import Any

from pipeline.commands.common import UsageError
from pipeline.data.store.mirror import open_url
from pipeline.data.store.urls import url_of

READS, WRITES = False, True
TAKEN = {
    "build": {"out": WRITES, "like": READS},
    "plan": {"out": READS, "like": READS},
    "evaluate": {"like": READS},
    "status": {"dataset": READS},
    "verify": {"dataset": READS},
    "render": {"dataset": READS, "out": WRITES},
    "view": {"dataset": READS},
    "export": {"dataset": WRITES, "out": WRITES},
    "annotate": {"dataset": WRITES},
    "diff": {"a": READS, "b": READS},
    "regenerate": {"dataset": READS},
    "gc": {"dataset": WRITES},
}
"""Of every verb the parameters that may be URLs, and whether it changes what is there."""


def on_stores(verb: Callable[..., None]) -> Callable[..., None]:
    """The verb, which works on mirrors (data/store/mirror.py) where URLs are given. Raises
    UsageError if it cannot."""

    @wraps(verb)
    def run(**given: Any) -> None:
        taken = TAKEN.get(verb.__name__, {})
        with ExitStack() as stack:
            for name, value in list(given.items()):
                urls = [
                    url_of(each)
                    for each in (value if isinstance(value, list) else [value])
                    if isinstance(each, Path)
                ]
                url = next(filter(None, urls), None)
                if url is None:
                    given[name] = _plain(value)
                    continue
                if name not in taken:
                    raise UsageError(
                        f"{url}: {verb.__name__.replace('_', '-')} takes a path of this machine"
                        " there, no URL"
                    )
                if given.get("local"):  # what is asked for are the mirrors themselves
                    continue
                if url.startswith("memory:"):
                    raise UsageError(
                        f"{url}: is gone when the command ends: name a directory, or another store"
                    )
                if verb.__name__ == "view" and not (
                    given["out"] or given["serve"] or given["rerun"]
                ):
                    raise UsageError(
                        f"{url}: the pages are for this machine: add --out DIR, or --serve"
                    )
                given[name] = stack.enter_context(open_url(url, taken[name], made=name != "out"))
            verb(**given)

    return run


def _plain(value: Any) -> Any:
    """A path that no library takes for a URL: one with a colon in its first part begins at the
    root."""
    if isinstance(value, Path) and value.parts and ":" in value.parts[0]:
        return Path.cwd() / value
    return value
