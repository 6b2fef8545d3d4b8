"""paper-table: an experiment of the DOMINO paper for any policy, beside the rows that the paper prints."""

from pathlib import Path
from typing import Annotated

import typer

from pipeline.commands.common import AsJson, Executor, Workers, pool_of, print_result, table
from pipeline.commands.options import Given, recipe_options


@recipe_options("rules", "cameras", files=(), rules="domino")
def paper_table(
    given: Given,
    name: Annotated[str, typer.Argument(help="main, task-type, history-aware, cross-level, slow or double.", metavar="NAME")],
    policy: Annotated[str, typer.Option(help="A policy, as for `evaluate`.")],
    episodes: Annotated[int, typer.Option(min=1, max=100_000, help="Scenes per task and level; the paper has 100.")] = 100,
    clock: Annotated[str | None, typer.Option(help="As for `evaluate`; that of the rules by default.")] = None,
    executor: Executor = "auto",
    workers: Workers = None,
    out: Annotated[Path, typer.Option(help="Directory of the results; rerun the same command to resume.")] = Path("OUT"),
    as_json: AsJson = False,
) -> None:
    """Evaluate a policy as in an experiment of the DOMINO paper and print it beside the published rows."""
    from pipeline.evaluate.evaluate import evaluate as run_evaluation
    from pipeline.evaluate.paper import beside, differences, experiment
    from pipeline.evaluate.policies import isolate, policy_name
    from pipeline.run.evaluation import evaluation_of, runner

    found = experiment(name)
    cells = {"tasks": found.tasks, "levels": found.levels, "alpha": found.alpha, "embodiments": "aloha"}
    recipe = given.recipe(rules="domino", **cells)
    setup = recipe.setup.override({"textures": "unseen"})
    wanted = evaluation_of(recipe, setup, isolate(policy_name(policy)), clock or "", episodes=episodes)
    means = run_evaluation(wanted, out, runner(pool_of(executor, workers, None))).to_dict()["means"]
    rows = beside(found, means)
    apart = differences(found, episodes, means[0]["rules"], means[0]["clock"])
    lines = [
        (
            row["method"] if row["paper"] else f"-> {row['method']}",
            row["level"],
            row["category"],
            *(_number(row["paper"], row[key], row.get(f"{key}_interval")) for key in ("success_rate", "manipulation_score")),
        )
        for row in rows
    ]
    text = [found.title, "", table(("method", "level", "tasks", "SR %", "MS"), lines), "", "-> differs from the paper:"]
    values = {"experiment": name, "rows": rows, "differences": apart, "episodes": str(out)}
    print_result(values, as_json, "\n".join([*text, *(f"   {line}" for line in apart)]))


def _number(paper: bool, value: float, interval: list[float] | None) -> str:
    return f"{value:g}" if paper or interval is None else f"{value:.1f} ({interval[0]:.1f}-{interval[1]:.1f})"
