"""The public Python API of domino-data: build, read, export and evaluate datasets of robots that
manipulate moving objects.

    import domino_data as dd

    recipe = dd.Recipe(tasks=("click_bell",), levels=(1,), episodes=2)
    dd.build(recipe, "out/bells")
    dataset = dd.open_dataset("out/bells")

Importing this package registers the gymnasium ids `domino/<task>-v0` of the suite `domino`. It
loads no simulator, no torch and no Ray: each function imports them when it is called. Every
expected error is a `DominoError` of one line. docs/python_api.md shows all names in use. The
packages `pipeline` and `training` are internal and change without notice.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from domino_data_command import find_foreign

if TYPE_CHECKING:
    from domino_data.api import build, evaluate, export, make_env, open_dataset, plan, verify
    from pipeline.data.episode.file import open_episode
    from pipeline.data.errors import DominoError
    from pipeline.data.recipe.model import Recipe
    from pipeline.data.setup import Setup
    from pipeline.evaluate.policies.policy import BatchPolicy, Observation, Policy, Start

_MODULES = {
    **dict.fromkeys(
        ("build", "evaluate", "export", "make_env", "open_dataset", "plan", "verify"),
        "domino_data.api",
    ),
    "DominoError": "pipeline.data.errors",
    "Recipe": "pipeline.data.recipe.model",
    "Setup": "pipeline.data.setup",
    "open_episode": "pipeline.data.episode.file",
    **dict.fromkeys(
        ("BatchPolicy", "Observation", "Policy", "Start"), "pipeline.evaluate.policies.policy"
    ),
}

if foreign := find_foreign():
    raise ImportError(foreign)

import_module("pipeline.gym_ids").register_shipped()


def __getattr__(name: str) -> object:
    # each is imported when it is asked for: opening a dataset needs no simulator
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULES[name]), name)


__all__ = [
    "BatchPolicy",
    "DominoError",
    "Observation",
    "Policy",
    "Recipe",
    "Setup",
    "Start",
    "build",
    "evaluate",
    "export",
    "make_env",
    "open_dataset",
    "open_episode",
    "plan",
    "verify",
]
