"""The options that name recipe keys, made from its model, with completions."""

import inspect
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import wraps
from pathlib import Path
from typing import Annotated, Any

import typer

from pipeline.data.dataset import Dataset
from pipeline.data.names import EXPORT_RECORD, MANIFEST
from pipeline.data.parsing import ParseError, parse_yaml, pixels, real, show_value, whole
from pipeline.data.recipe.file import find_recipe, read_recipe
from pipeline.data.recipe.model import KEYS, Recipe
from pipeline.data.setup import SETUP_FILE, Setup, option_of
from pipeline.gym_ids import shipped_tasks

from .common import UsageError, names_nothing, option, split_list

NO_OPTION = ("name", "keep_failures")  # keys that only a file gives
SETUP = tuple(key for key in Setup.model_fields if key not in NO_OPTION)
EVERY = tuple(key for key in KEYS if key not in NO_OPTION)
CELLS = ("tasks", "embodiments", "levels", "domains", "alpha")
FLAGS = {key: option_of(key) for key in EVERY}

_TYPES = {"integer": int, "number": float, "boolean": bool}
_SCHEMA = Recipe.model_json_schema()["properties"]


def complete_task(incomplete: str) -> list[str]:
    """Names of tasks that begin like this; those of plugins if some are loaded."""
    loaded = sys.modules.get("pipeline.tasks.contract")
    return _fitting(incomplete, [*shipped_tasks("*"), *(loaded.TASKS if loaded else ())])


def complete_tasks(incomplete: str) -> list[str]:
    """As `complete_task`, for the last name of a list, which may be `all`."""
    return _last(incomplete, lambda last: [*complete_task(last), *_fitting(last, ["all"])])


def complete_robot(incomplete: str) -> list[str]:
    """Names of robots that begin like this."""
    from pipeline.world.robots import ALIASES, MODELS

    return _fitting(incomplete, [*MODELS, *ALIASES])


def complete_robots(incomplete: str) -> list[str]:
    """As `complete_robot`, for the last name of a list."""
    return _last(incomplete, complete_robot)


def _last(incomplete: str, complete: Callable[[str], list[str]]) -> list[str]:
    """Completions of the last name of a comma-separated list."""
    before, comma, last = incomplete.rpartition(",")
    return [f"{before}{comma}{name}" for name in complete(last)]


def _fitting(incomplete: str, names: Iterable[str]) -> list[str]:
    return sorted({name for name in names if name.startswith(incomplete)})


COMPLETIONS = {"tasks": complete_tasks, "embodiments": complete_robots}
Manifest = Annotated[
    Path | None,
    option(
        "A recipe file (YAML), or the name of one that ships with the package; other options"
        " override its keys."
    ),
]
Like = Annotated[
    Path | None,
    option(
        "A dataset whose recipe is used, an export of one, or a checkpoint with a setup.yaml;"
        " other options override its keys.",
        metavar="DATASET",
    ),
]
Trust = Annotated[
    bool, option("Run the policy that a dataset names in its `corrections`.", "--trust")
]
FILES = {"manifest": Manifest, "like": Like}  # options beside the keys


@dataclass(frozen=True)
class Given:
    """The part of a command line that defines a recipe: values by key, and files."""

    values: Mapping[str, Any] = field(default_factory=dict[str, Any])
    manifest: Path | None = None
    like: Path | None = None
    trust: bool = False

    @property
    def from_file(self) -> bool:
        """Whether a file or a dataset gives a recipe."""
        return self.manifest is not None or self.like is not None

    @property
    def export(self) -> Path | None:
        """The export that --like names, if it names one."""
        like = self.like
        return like if like is not None and (like / EXPORT_RECORD).is_file() else None

    def _dataset(self, like: Path) -> Dataset:
        if self.export is None:
            return Dataset(like)
        above = next((up for up in like.absolute().parents if (up / MANIFEST).is_file()), None)
        if above is None:
            raise UsageError(
                f"--like {like}: is an export outside of its dataset: give --like the dataset, and"
                " state the actions in the contract of FILE.py, or as ?like=EXPORT of others"
            )
        return Dataset(above)

    def recipe(self, without: Sequence[str] = (), **defaults: Any) -> Recipe:
        """The recipe of the files and the options, its names resolved, without the keys `without`.
        `defaults` hold if no file gives a whole recipe. Raises RecipeError, UsageError for two such
        files, and Untrusted for a policy that only the dataset of --like names."""
        # a second: it imports every task
        from pipeline.run.names import check_trust, installed_recipe, recipe_from

        if self.manifest is not None and self.like is not None:
            raise UsageError("--manifest and --like both give a recipe: leave one of them out")
        values, source = dict(defaults), "options"
        if self.manifest is not None:
            values, source = read_recipe(find_recipe(self.manifest)), str(self.manifest)
        elif self.like is not None and (setup := self.like / SETUP_FILE).exists():
            values, source = values | read_recipe(setup), str(setup)
        elif self.like is not None:
            values, source = installed_recipe(self._dataset(self.like)).model_dump(), str(self.like)
        values = {k: value for k, value in {**values, **self.values}.items() if k not in without}
        if self.values.get("events") == ["none"] and "paired" not in self.values:
            pairs = values.get("paired", [])
            pairs = pairs if isinstance(pairs, list | tuple) else [pairs]
            values["paired"] = [key for key in pairs if key not in ("events", "conditions")]
        if self.like is not None and not self.trust and "corrections" not in self.values:
            check_trust(values.get("corrections"), source)
        return recipe_from(values, source, {key: FLAGS[key] for key in self.values})


def recipe_options(
    *keys: str, files: Sequence[str] = tuple(FILES), **shown_defaults: str
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Gives a verb, whose first parameter is `given: Given`, an option for each of these keys and
    for `files`. `shown_defaults` are what --help shows."""
    taken = {name: FILES[name] for name in files}
    taken |= {_parameter(key): _option(key, shown_defaults.get(key)) for key in keys}
    runs_policy = "like" in files and "corrections" in keys

    def decorate(verb: Callable[..., None]) -> Callable[..., None]:
        @wraps(verb)
        def run(**arguments: Any) -> None:
            texts = {key: arguments.pop(_parameter(key)) for key in keys}
            values = {
                key: parse_value(key, text) for key, text in texts.items() if text is not None
            }
            others = [*files, *(["trust"] if runs_policy else [])]
            verb(Given(values, **{name: arguments.pop(name) for name in others}), **arguments)

        own = inspect.signature(verb, eval_str=True)
        kind = inspect.Parameter.KEYWORD_ONLY
        parameters = [
            inspect.Parameter(name, kind, default=None, annotation=option)
            for name, option in taken.items()
        ]
        if runs_policy:
            parameters.append(inspect.Parameter("trust", kind, default=False, annotation=Trust))
        parameters += [p.replace(kind=kind) for p in list(own.parameters.values())[1:]]
        parameters.sort(key=lambda p: p.default is not inspect.Parameter.empty)
        run.__signature__ = own.replace(parameters=parameters)  # pyright: ignore[reportAttributeAccessIssue]
        run.__annotations__ = {p.name: p.annotation for p in parameters}
        return run

    return decorate


def _parameter(key: str) -> str:
    return option_of(key)[2:].replace("-", "_")


def _option(key: str, default: str | None) -> Any:
    schema = _SCHEMA[key]
    one = schema.get("anyOf", [schema])[0]
    kind, flag = _TYPES.get(one.get("type", "string"), str), option_of(key)
    own = Recipe.model_fields[key]
    text = " ".join((own.description or "").split())
    if kind is bool:
        flags = f"{flag}/--no-{flag[2:]}"
        return Annotated[bool | None, option(text, flags, show_default=False)]
    words: dict[str, Any] = {
        "help": text,
        "show_default": default or _show_default(own.get_default(call_default_factory=True)),
        "autocompletion": COMPLETIONS.get(key),
    }
    if kind in (int, float):
        choices = one.get("enum", [0, 1])
        words |= {"min": one.get("minimum", min(choices)), "max": one.get("maximum", max(choices))}
    return Annotated[kind | None, typer.Option(flag, **words)]


def _show_default(value: Any) -> str | bool:
    if value is None or value in ((), {}):
        return False
    return ",".join(map(str, value)) if isinstance(value, tuple) else str(value)


def parse_value(key: str, given: Any) -> Any:
    """The value of an option, as a recipe's file would have it. Raises UsageError."""
    if key == "cameras":
        return cameras_of(given)
    try:
        if key == "size":
            return pixels(given)
        if _SCHEMA[key].get("type") != "array":
            return given
        words = split_list(given) or []
        if key in ("levels", "clutter", "alpha"):
            return [(real if key == "alpha" else whole)(word) for word in words]
    except ParseError as error:
        wrong = error if key == "size" else "is not a list of numbers like 1,2,3"
        raise UsageError(f"{option_of(key)} {show_value(given)} {wrong}") from error
    if not words:
        raise names_nothing(option_of(key), given)
    return words


def cameras_of(text: str) -> list[str | dict[str, Any]]:
    """The comma-separated names and JSON objects of --cameras; nothing for "none". Raises
    UsageError."""
    try:
        cameras = parse_yaml(f"[{text}]")
    except ParseError as error:
        wrong = "is not a list of names and JSON objects"
        raise UsageError(f"--cameras {show_value(text)} {wrong}") from error
    if not cameras:
        raise names_nothing("--cameras", text)
    return [] if cameras == ["none"] else cameras
