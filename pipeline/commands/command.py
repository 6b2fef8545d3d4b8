"""A verb as typer knows it, its description, and how every application of verbs ends."""

import ast
import math
import sys
import traceback
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

from typer import Typer, TyperException
from typer.core import TyperCommand

from pipeline.data.errors import DominoError, describe_error
from pipeline.data.reading import printable
from pipeline.data.store.place import with_urls

LONGEST = 2000
"""Characters of a message; it may repeat what was typed."""


class Verb(TyperCommand):
    """A command of typer whose ranges also refuse NaN, which is neither below nor above them."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the command line. Raises TyperException, which names the option."""
        rest = super().parse_args(ctx, args)
        for param in self.params:
            value = ctx.params.get(param.name)
            if isinstance(value, float) and math.isnan(value):
                ctx.fail(f"{max(param.opts, key=len)} is not a number")
        return rest


def run_app(app: Typer, name: str, words: Callable[[], list[str]] = lambda: sys.argv[1:]) -> None:
    """Run an application on `words()` and exit. An error becomes one line on stderr that begins
    with `name`, exit code 2; one that nobody foresaw names a file with its traceback."""
    try:
        code = app(words(), standalone_mode=False)
        # the exit code of a verb that raised typer.Exit
        sys.exit(code if isinstance(code, int) else 0)
    except TyperException as error:
        # a group without a word after it has printed its help
        if not (text := " ".join(error.format_message().split())):
            sys.exit(2)
        text = text.replace(": Value error, ", ": ")  # which typer has from pydantic
        context = getattr(error, "ctx", None)
        message = f"{text.rstrip('.')}; see {context.command_path if context else name} --help"
    except DominoError as error:
        message = "; ".join([str(error), *getattr(error, "__notes__", ())])
    except OSError as error:
        message = describe_error(error)
    except KeyboardInterrupt:
        sys.exit(130)  # as of a shell
    except Exception as error:  # noqa: BLE001 - the one place where whatever is left ends
        message = describe_missing(error.name or "") if isinstance(error, ImportError) else ""
        if not message:
            with NamedTemporaryFile("w", prefix="domino-data-", suffix=".log", delete=False) as log:
                traceback.print_exception(error, file=log)
            text = " ".join(f"{type(error).__name__}: {error}".split())[:300]
            message = f"{text}: nobody foresaw this; please report it with {log.name}"
    print(f"{name}: {printable(with_urls(message))[:LONGEST]}", file=sys.stderr)
    sys.exit(2)


def describe(place: str) -> str:
    """The docstring of the function at a place, or the help of the application there; "" if it
    cannot be read."""
    module, _, name = place.partition(":")
    try:
        spec = find_spec(module)
        tree = ast.parse(Path(str(spec and spec.origin)).read_text())
    except (ImportError, OSError, SyntaxError, ValueError):
        return ""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and node.name == name:
            return ast.get_docstring(node) or ""
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == name:
            words = node.value.keywords if isinstance(node.value, ast.Call) else ()
            texts = [word.value for word in words if word.arg == "help"]
            return str(ast.literal_eval(texts[0])) if texts else ""
    return ""


EXTRAS = {
    "ray": "ray",
    **dict.fromkeys(("huggingface_hub", "fsspec"), "hub"),
    "s3fs": "s3",
    "gcsfs": "gcs",
    "lerobot": "lerobot",
    "transformers": "annotate",
    **dict.fromkeys(("torch", "accelerate", "peft", "safetensors"), "train"),
    "tensorboard": "trackers",
    "zmq": "gr00t",
    "mujoco": "mjcf",
    "coacd": "shapes",
}
"""The extra by module."""


def describe_missing(module: str) -> str:
    """One line on a module that is not installed and how to install it; "" if it is of no extra."""
    name = module.partition(".")[0]
    if name == "sapien":
        return (
            "this needs the simulator (sapien), which has no wheel for this platform: see"
            " docs/installation.md for what works without it"
        )
    if name not in EXTRAS:
        return ""
    return f"this needs {name}: uv pip install 'domino-data[{EXTRAS[name]}]'"
