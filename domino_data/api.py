"""The functions of the public API. Each calls what the command of its name calls, and imports it
then."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pipeline.crew.contract import Crew
    from pipeline.data.dataset import Dataset
    from pipeline.data.recipe.model import Recipe
    from pipeline.data.setup import Setup
    from pipeline.evaluate import DominoEnv
    from pipeline.evaluate.evaluate import EvaluationResult
    from pipeline.evaluate.policies.policy import Policy
    from pipeline.run.build import BuildResult

type Place = str | Path
type Wanted = Recipe | Mapping[str, Any] | Place
"""A recipe, its keys, the path of a recipe file, or the name of one that ships with the package,
such as "smoke"."""


def plan(
    recipe: Wanted, dataset: Place | None = None, *, workers: int = 1, measure: bool = False
) -> dict[str, Any]:
    """What building a recipe would make and take: the number of `slots`, `estimated_hours`,
    `estimated_bytes`, and more.

    `dataset` is an existing one whose finished episodes are subtracted, and whose times and sizes
    are the estimate. With `measure`, four episodes are made in a temporary directory to estimate
    both. Raises RecipeError for a recipe that cannot be used.
    """
    from pipeline.run.plan import measure as run_measure
    from pipeline.run.plan import plan as run_plan

    wanted = _recipe(recipe)
    return run_plan(
        wanted,
        open_dataset(dataset) if dataset else None,
        workers,
        run_measure(wanted) if measure else None,
    )


def build(recipe: Wanted, out: Place, *, workers: int = 1, progress: bool = False) -> "BuildResult":
    """Make the dataset of a recipe in the directory `out`, or resume making it; the bytes do not
    depend on `workers`.

    One worker runs in this process, more run on Ray. Returns counts, such as `accepted` and
    `given_up`. Raises RecipeError for a recipe that cannot be used, DatasetError if `out` holds
    another recipe's dataset, and NoRenderer for `rt` without Vulkan.
    """
    from pipeline.annotate.overlays import annotation_sheet
    from pipeline.report.page import refresh
    from pipeline.run.build import build as run_build

    shown = "bar" if progress else "none"
    result = run_build(Path(out), _recipe(recipe), _crew(workers), shown=shown)
    refresh(open_dataset(out), annotation_sheet)
    return result


def open_dataset(path: Place) -> "Dataset":
    """The dataset in a directory: `recipe()` is what it was built from, `accepted(recipe)` are its
    episode files, which `open_episode` opens. Raises DatasetError if there is none."""
    from pipeline.data.dataset import Dataset

    dataset = Dataset(Path(path))
    dataset.recipe()
    return dataset


def verify(
    dataset: Place, *, workers: int = 1, again: int = 0, trust: bool = False
) -> dict[str, Any]:
    """Check every file of a dataset against what was written, and make `again` of its episodes
    again. `ok` is true if nothing differs; `problems` has a line for whatever does.

    Raises DatasetError if there is no dataset, and if making episodes again would run a policy that
    its recipe names (`corrections`), unless `trust`.
    """
    from pipeline.run.checks.verify import verify as run_verify

    return run_verify(open_dataset(dataset), _crew(workers), again=again, trust=trust)


def export(
    dataset: Place,
    format: str,
    out: Place | None = None,
    *,
    where: str | None = None,
    workers: int = 1,
    **options: str | float | bool,
) -> Mapping[str, Any]:
    """Write a dataset in another format, by default to DATASET/exports/FORMAT, and return the
    export's summary.

    `where` selects episodes, for example "level=3 and task=click_bell"; None takes all. `options`
    are those of the format (docs/exports.md). Raises ExportError for a format or option that does
    not exist and if there is nothing to export.
    """
    from pipeline.run.export import Request
    from pipeline.run.export import export as run_export

    given = {
        name: value if isinstance(value, bool) else str(value) for name, value in options.items()
    }
    request = Request(format, given, Path(out) if out else None, where=where)
    return run_export(open_dataset(dataset), request, workers).summary


def evaluate(
    policy: "Place | Callable[[], Policy]",
    recipe: Wanted,
    out: Place,
    *,
    episodes: int = 100,
    seed: int = 0,
    setup: "Setup | Mapping[str, Any] | Place | None" = None,
    clock: str = "",
    workers: int = 1,
) -> "EvaluationResult":
    """Evaluate a policy in closed loop in the cells of a recipe, under its rules, with results in
    the directory `out`.

    `policy` is a name or file as for `domino-data evaluate --policy`, or a class or function that
    makes a policy, which runs in this process alone. `episodes` are the scenes of each cell;
    `clock` says when answers arrive (docs/evaluation.md). `setup` is what the policy sees: a Setup,
    keys of one, or a dataset that was built under one; without it, no images and the recipe's
    rules. Returns rows of results: `cells` and `means`. Raises PolicyError for a policy that cannot
    be used.
    """
    from pipeline.evaluate.evaluate import evaluate as run_evaluation
    from pipeline.evaluate.names import in_process, policy_name
    from pipeline.evaluate.scenes.case import blind, setup_of
    from pipeline.run.evaluation import evaluation_of, runner

    name = in_process(policy) if callable(policy) else policy_name(str(policy))
    crew, cells = _crew(1 if callable(policy) else workers), _recipe(recipe)
    wanted = evaluation_of(
        cells,
        blind(cells) if setup is None else setup_of(setup),
        name,
        clock,
        episodes=episodes,
        seed=seed,
    )
    return run_evaluation(wanted, Path(out), runner(crew))


def make_env(
    task: str, embodiment: str = "aloha-agilex", level: int = 1, alpha: float = 0.1, **options: Any
) -> "DominoEnv":
    """The gymnasium environment of a task; `options` are those of `DominoEnv`, such as setup,
    actions, benchmark and domain.

    Raises UnknownName for a task that does not exist, ValueError for options that do not fit.
    """
    from pipeline.evaluate import DominoEnv

    return DominoEnv(task, embodiment, level, alpha, **options)


def _recipe(given: "Wanted") -> "Recipe":
    """The recipe with all names checked. Raises RecipeError."""
    from pipeline.data.recipe.file import find_recipe, read_recipe
    from pipeline.data.recipe.model import Recipe
    from pipeline.run.names import recipe_from, resolve

    if isinstance(given, Recipe):
        return resolve(given)
    values = given if isinstance(given, Mapping) else read_recipe(find_recipe(Path(given)))
    return recipe_from(values, "recipe" if isinstance(given, Mapping) else str(given))


def _crew(workers: int) -> "Crew":

    from pipeline.crew.contract import Crew, pick_executor

    return Crew(*pick_executor("auto", workers))
