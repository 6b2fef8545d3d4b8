"""evaluate: try a policy in closed loop."""

import sys
from pathlib import Path
from typing import Annotated

import typer
from tqdm import tqdm

from pipeline.commands.common import Address, AsJson, Executor, UsageError, Workers, pool_of, print_result, resumable
from pipeline.commands.options import CELLS, SETUP, Given, recipe_options
from pipeline.data.recipe.model import Recipe
from pipeline.data.setup import Setup


@recipe_options(*CELLS, "assets", *SETUP, levels="1", tasks="all", cameras="none", textures="unseen", rules="strict")
def evaluate(
    given: Given,
    policy: Annotated[
        str,
        typer.Option(
            help="replay, static, tapper, chaser, interceptor, random, FILE.py, ws://HOST:PORT and others (docs/evaluation.md)."
        ),
    ],
    episodes: Annotated[int, typer.Option(min=1, max=100_000, help="Admitted scenes per cell.")] = 100,
    seed: Annotated[
        int, typer.Option(min=0, max=10**12, help="Scenes are drawn from seed 100000 * (1 + SEED); a large secret seed hides them.")
    ] = 0,
    clock: Annotated[
        str | None,
        typer.Option(help="sim, step-locked, late:MS, latency:MS and others (docs/evaluation.md); by default that of the rules."),
    ] = None,
    instructions: Annotated[str, typer.Option(help="Instructions of the split seen or unseen.")] = "unseen",
    compounding: Annotated[bool, typer.Option(help="Apply the clutter penalty to every distractor, as the original does.")] = False,
    films: Annotated[int, typer.Option(min=0, max=1000, help="Film the first episodes of every cell (OUT/films).")] = 0,
    answer_seconds: Annotated[
        float,
        typer.Option(
            min=0.01,
            max=86_400,
            help="Time limit of one answer of the policy (s); all answers of an episode have ten times that.",
        ),
    ] = 300.0,
    batch_wait: Annotated[
        float | None,
        typer.Option(
            min=0,
            max=60_000,
            help="Load a BatchPolicy once for all workers; a batch waits this many ms for more questions.",
        ),
    ] = None,
    in_process: Annotated[
        bool,
        typer.Option(help="Run the policy in the evaluator's process, where a debugger reaches it and it could change its score."),
    ] = False,
    manifests: Annotated[Path | None, typer.Option(help="Directory of admitted seeds to share; OUT/manifests by default.")] = None,
    executor: Executor = "auto",
    workers: Workers = None,
    address: Address = None,
    out: Annotated[Path, typer.Option(help="Directory of the results; rerun the same command to resume.")] = Path("OUT"),
    quiet: Annotated[bool, typer.Option(help="No progress.")] = False,
    as_json: AsJson = False,
) -> None:
    """Evaluate a policy in closed loop: success rate, route completion and manipulation score, with intervals."""
    from pipeline.evaluate.asking import ANSWERS
    from pipeline.evaluate.evaluate import evaluate as run_evaluation
    from pipeline.evaluate.policies import isolate, policy_name
    from pipeline.evaluate.policy import staying
    from pipeline.evaluate.summary import table
    from pipeline.run.evaluation import EPISODE_SECONDS, answer_together, evaluation_of, runner

    if instructions not in ("seen", "unseen"):
        raise UsageError(f"--instructions {instructions!r} is unknown: choose seen or unseen")
    recipe = given.recipe(without=("cameras",) if given.values.get("cameras") == [] else (), levels=[1])
    wanted = evaluation_of(
        recipe,
        _images_setup(given, recipe),
        policy_name(policy) if in_process or batch_wait is not None else isolate(policy_name(policy)),
        clock or "",
        episodes=episodes,
        seed=seed,
        split=instructions,
        compounding=compounding,
        films=films,
        answer_seconds=answer_seconds,
    )
    # each worker is a client, and a server takes one unless it was told otherwise
    one_client = workers is None and policy.startswith("ws") and batch_wait is None
    pool = pool_of(executor, 1 if one_client else workers, address)
    together = answer_together(wanted, pool, None if batch_wait is None else batch_wait / 1000)
    with resumable(out), tqdm(disable=quiet, bar_format="{desc} [{elapsed}]") as bar, staying(), together as shared:
        runs = runner(pool, EPISODE_SECONDS + ANSWERS * answer_seconds)
        outcome = run_evaluation(shared, out, runs, manifests, bar.set_description_str)
    if outcome.faults:
        count, first = sum(outcome.faults.values()), next(iter(outcome.faults))
        print(
            f"domino-data: warning: episodes without a valid answer of the policy, which count as failed: {count} ({first})",
            file=sys.stderr,
        )
    text = [table(outcome.cells)]
    text += [
        f"mean of {m['tasks']} tasks ({m['category']}), level {m['level']}: SR {m['success_rate']:.1f} %, "
        f"RC {m['route_completion']:.1f}, MS {m['manipulation_score']:.1f}"
        for m in outcome.means
    ]
    print_result(outcome.to_dict(), as_json, "\n".join(text))


def _images_setup(given: Given, recipe: Recipe) -> Setup:
    """The setup of an evaluation: images only where cameras are named, textures of training only where they are asked for."""
    from pipeline.evaluate.case import blind

    if given.values.get("cameras") == [] or not (given.from_file or "cameras" in given.values):
        if asked := next((key for key in ("depth", "segmentation", "pointcloud") if given.values.get(key)), None):
            raise UsageError(f"--{asked} is of the images of --cameras: name some")
        return blind(recipe)
    return recipe.setup.override({"textures": given.values.get("textures", "unseen")})
