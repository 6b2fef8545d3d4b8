"""Reading a recipe's file: plain YAML, in which nothing stands twice and nothing means what it does not say."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from pipeline.data.recipe import SHOWN, RecipeError

LARGEST_FILE = 1_000_000
"""Bytes of a recipe's file at most."""


class _Loader(yaml.SafeLoader):
    """Plain YAML in which no mapping has a key twice."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        keys = [k.value for k, _ in node.value if isinstance(k, yaml.ScalarNode)]
        if twice := next((k for k in keys if keys.count(k) > 1), None):
            raise yaml.constructor.ConstructorError(problem=f"{twice[:SHOWN]!r} stands there twice", problem_mark=node.start_mark)
        return super().construct_mapping(node, deep)


def _number(construct: Callable[[yaml.SafeLoader, yaml.ScalarNode], Any]) -> Callable[[yaml.SafeLoader, yaml.ScalarNode], Any]:
    """A number of YAML 1.1, in which 1:30 would be 90 (base 60); here it is a text."""
    return lambda loader, node: node.value if ":" in node.value else construct(loader, node)


_Loader.add_constructor("tag:yaml.org,2002:int", _number(yaml.SafeLoader.construct_yaml_int))
_Loader.add_constructor("tag:yaml.org,2002:float", _number(yaml.SafeLoader.construct_yaml_float))


def read_recipe(path: Path) -> dict[str, Any]:
    """The keys of a recipe file, unchecked. Raises RecipeError for a file that is missing or not a YAML mapping of texts."""
    try:
        with open(path, "rb") as file:
            data = file.read(LARGEST_FILE + 1)
        if len(data) > LARGEST_FILE:
            raise RecipeError(f"{path}: has more than {LARGEST_FILE} bytes; a recipe is a short YAML file")
        values = yaml.load(data.decode(), _Loader)
    except RecursionError as error:
        raise RecipeError(f"{path}: is nested too deeply for a recipe; write plain keys and lists") from error
    except OSError as error:
        raise RecipeError(f"{path}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise RecipeError(f"{path}: is not text ({error.reason})") from error
    except yaml.YAMLError as error:
        mark, problem = getattr(error, "problem_mark", None), getattr(error, "problem", None) or str(error).splitlines()[0]
        line = f"line {mark.line + 1}: " if mark is not None else ""
        raise RecipeError(f"{path}: is not YAML ({line}{problem})") from error
    except ValueError as error:
        raise RecipeError(f"{path}: holds a value that cannot be read ({' '.join(str(error).split())[:SHOWN]})") from error
    if not isinstance(values, dict) or not all(isinstance(key, str) for key in values):
        raise RecipeError(f"{path}: is not a mapping of recipe keys, like `levels: [1, 2]`")
    return values
