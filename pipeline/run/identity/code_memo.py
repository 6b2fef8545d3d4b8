"""What was found out about the code before, kept in the user's cache directory, so that it need not be parsed and imported again.

    $XDG_CACHE_HOME/domino-data/code/<fingerprint of the code>/<hash of the question>.json

Answers are functions of the code alone, whose fingerprint (run/identity/sources.py) an edit changes. Nothing depends on the cache:
a file that is missing or damaged only costs the time to find out again, and old versions of the code are deleted.
"""

import json
import os
import shutil
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from pipeline.data.atomic import temporary_name
from pipeline.data.keys import digest
from pipeline.data.store.user_cache import user_cache
from pipeline.run.identity import sources

_PACKAGE = Path(__file__).parents[2]
KEPT = 4  # versions of the code whose answers are kept
_FILES = "pipeline.world.objects.from_files"  # the module of objects from files, which are outside of the package
_NO_ANSWER = (OSError, ValueError, TypeError, LookupError, RecursionError)  # what reading a file raises that is no answer
_REGISTRIES = (
    *(("pipeline.tasks.contract", "TASKS"), ("pipeline.world.objects.contract", "FAMILIES")),
    ("pipeline.motion.models", "MODELS"),
)


def recall(root: Path, question: Sequence[str | bool], answer: Callable[[], Any]) -> Any:
    """The answer, plain data, to a question about the code of a package directory: from the cache, or found out and kept there.

    Raises what `answer` raises, and keeps nothing then.
    """
    cache = user_cache("code")
    if cache is None or _has_extensions():
        return answer()
    asked = list(question)
    path = cache / sources.fingerprint(root) / f"{digest(asked)}.json"
    with suppress(*_NO_ANSWER):
        held = json.loads(path.read_bytes())
        if held["sum"] == digest([asked, held["answer"]]):
            return held["answer"]
    found = answer()
    with suppress(OSError):
        _keep(path, {"answer": found, "sum": digest([asked, found])})
    return found


def _has_extensions() -> bool:
    """Whether this process has registered tasks, objects, motions or robots from outside the package: it has answers of its own."""
    for module, name in _REGISTRIES:
        registered = getattr(sys.modules.get(module), name, {})
        modules = (str(each.__module__) for each in registered.values())
        if any(not name.startswith(f"{sources.PACKAGE}.") or name == _FILES for name in modules):
            return True
    robots = getattr(sys.modules.get("pipeline.world.robots.pairs"), "MODELS", {})
    return any(not model.directory.is_relative_to(_PACKAGE) for model in robots.values())


def _keep(path: Path, values: dict[str, Any]) -> None:
    """Write an answer, whole or not at all; it need not outlive a power failure, after which its sum is wrong. Raises OSError."""
    if not path.parent.is_dir():
        path.parent.mkdir(parents=True, exist_ok=True)
        versions = sorted(path.parent.parent.iterdir(), key=lambda each: each.stat().st_mtime_ns)
        for old in versions[:-KEPT]:
            shutil.rmtree(old, ignore_errors=True)
    temporary = temporary_name(path)
    temporary.write_text(json.dumps(values))
    os.replace(temporary, path)
