"""From the names in a recipe to tasks and robots that exist."""

from collections.abc import Mapping
from typing import Any

from pipeline.data.recipe import Recipe, RecipeError, check_size, parse_recipe
from pipeline.tasks import TASKS
from pipeline.world.robots import UnknownEmbodiment, canonical_name, get_embodiment


def resolve(recipe: Recipe, source: str = "recipe") -> Recipe:
    """The recipe with `tasks: all` or none expanded, aliases of robots replaced by their names, and no meshes of unused robots.

    Raises RecipeError in one line for a task or robot that does not exist.
    """
    tasks = recipe.tasks if recipe.tasks and recipe.tasks != ("all",) else tuple(sorted(TASKS))
    for task in tasks:
        if task not in TASKS:
            raise RecipeError(f"{source}: no task {task!r}; `domino-data tasks` lists them: {', '.join(sorted(TASKS))}")
    try:
        embodiments = tuple(dict.fromkeys(get_embodiment(e).name for e in recipe.embodiments))
        meshes = {canonical_name(name): key for name, key in recipe.robot_meshes.items()}
    except UnknownEmbodiment as error:
        raise RecipeError(f"{source}: {error}") from error
    recipe = recipe.model_copy(update={"tasks": tasks, "embodiments": embodiments})
    check_size(recipe, source)
    used = {name: meshes[name] for name in recipe.robots() if name in meshes}
    return recipe.model_copy(update={"robot_meshes": used})


def recipe_from(values: Mapping[str, Any], source: str = "recipe", flags: Mapping[str, str] | None = None) -> Recipe:
    """A checked and resolved recipe from the keys of a file or of options (`flags`: option by key). Raises RecipeError."""
    return resolve(parse_recipe(values, source, flags), source)
