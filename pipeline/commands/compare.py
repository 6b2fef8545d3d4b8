"""compare, check-result, results."""

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from .common import (
    AsJson,
    Executor,
    Workers,
    argument,
    crew_of,
    number,
    option,
    print_result,
    table,
)

NONE_AGAIN = "none carried out again, so consistent forgeries pass: add --again N"

type Values = dict[str, Any]  # a row of a comparison


def compare(
    runs: Annotated[
        list[str],
        argument(
            "Directories of evaluations; networks of one kind are joined by commas: A1,A2,A3.",
            metavar="RUN...",
        ),
    ],
    effect: Annotated[
        float,
        number(
            0.01, 100, "Estimate the number of scenes that a difference of this many points needs."
        ),
    ] = 5,
    one_by_one: Annotated[
        bool,
        option(
            "Say after how many scenes the better one was known; look as often as you like.",
            "--sequential",
        ),
    ] = False,
    score: Annotated[
        Literal["success", "route_completion", "manipulation_score"],
        option("What --sequential compares."),
    ] = "success",
    alpha: Annotated[
        float, number(0.0001, 0.5, "Chance of a false decision, --sequential.")
    ] = 0.05,
    as_json: AsJson = False,
) -> None:
    """Compare policies with the first one on the scenes they share: difference, 95 % interval,
    exact test, scenes needed. Of runs with --paired, also --sequential, each policy with itself
    without events."""
    from pipeline.evaluate.scoring.compare import compare as compare_arms
    from pipeline.evaluate.scoring.compare import compare_sequentially, event_arms, read_arms

    paired = event_arms(runs)
    if paired and not one_by_one:
        effects = [row for arms in paired for row in compare_arms(*arms, effect)]
        print_result({"effect": effect, "events": effects}, as_json, _describe(effects, effect))
        return
    if not paired:
        first, *others = read_arms(runs)
        paired = [(first, other) for other in others]
    if one_by_one:
        # each of several comparisons has its share of the chance of a false decision
        tests = [compare_sequentially(*arms, score, alpha / len(paired)) for arms in paired]
        text = "\n".join(map(_describe_test, tests))
        print_result({"alpha": alpha, "score": score, "comparisons": tests}, as_json, text)
        return
    comparisons = [row for arms in paired for row in compare_arms(*arms, effect)]
    _correct(comparisons)
    shares = dict.fromkeys(map(_describe_share, comparisons))
    text = "\n".join([_describe(comparisons, effect), *shares]).rstrip()
    print_result({"effect": effect, "comparisons": comparisons}, as_json, text)


def _describe_test(test: Values) -> str:
    pair, known = f"{test['second']} against {test['first']}", f"(p {test['p']:.2g})"
    if test["decided"]:
        return (
            f"{pair}: {test['better']} is better, known after {test['decided']} of"
            f" {test['scenes']} scenes {known}"
        )
    more = f"; about {test['more']} more at this difference" if test["more"] else ""
    return f"{pair}: undecided after {test['scenes']} scenes {known}{more}"


def _describe_share(row: Values) -> str:
    first, second, shared = (
        row.get(key) for key in ("first_episodes", "second_episodes", "shared")
    )
    if first == second == shared:
        return ""
    pair = f"{row['second']} against {row['first']}"
    return f"{pair}: the {shared} episodes of both, of {second} and {first}"


def _correct(comparisons: list[Values]) -> None:
    from pipeline.evaluate.scoring.statistics import holm

    for what in {row["what"] for row in comparisons}:
        rows = [row for row in comparisons if row["what"] == what]
        for row, p in zip(rows, holm([row["p"] for row in rows]), strict=True):
            row["p"] = p


def _describe(rows: list[Values], effect: float) -> str:
    head = (
        *("policy", "against", "of", "scenes", "SR %", "SR %", "difference (95 %)"),
        *("won", "lost", "p", f"for {effect:g} points"),
    )
    body = [
        (
            *(row["second"], row["first"], row["what"], row["scenes"]),
            *(f"{row['second_rate']:.1f}", f"{row['first_rate']:.1f}"),
            f"{row['effect']:+.1f} ({row['interval'][0]:+.1f} to {row['interval'][1]:+.1f})",
            *(row.get("won", "-"), row.get("lost", "-")),
            f"{row['p']:.2g}" if "p" in row else "-",
            row["needed"] or "-",
        )
        for row in rows
    ]
    return table(head, body)


def check_result(
    bundle: Annotated[Path, argument("The --out of a domino-data evaluate.", metavar="BUNDLE")],
    again: Annotated[int, number(0, 100_000, "Random episodes to carry out again.")] = 0,
    seed: Annotated[
        int | None, number(0, 10**12, "Draw the same episodes again; by default others.")
    ] = None,
    manifests: Annotated[
        Path | None, option("Directory of the scenes; BUNDLE/manifests by default.")
    ] = None,
    benchmark: Annotated[
        str | None, option("File of the benchmark; by default the one of its name that ships here.")
    ] = None,
    executor: Executor = "auto",
    workers: Workers = None,
    as_json: AsJson = False,
) -> None:
    """Check that results are whole and unedited, and carry out recorded actions again; exit code 1
    if anything differs."""
    from pipeline.evaluate.scenes.benchmark import read_benchmark
    from pipeline.run.check_result import check_result as check
    from pipeline.run.evaluation import runner

    scenes = None if benchmark is None else read_benchmark(benchmark)
    run = runner(crew_of(executor, workers, None))
    checked = check(bundle, run, again, seed, manifests, scenes)
    how = "every number" if checked.exact else "outcomes (made elsewhere or by another version)"
    done = f"{checked.again} carried out again, compared: {how}" if checked.again else NONE_AGAIN
    text = [f"{checked.episodes} episodes; {done}", *(f"  {fault}" for fault in checked.faults)]
    print_result(vars(checked), as_json, "\n".join(text))
    if checked.faults:
        raise typer.Exit(1)


def results(
    bundles: Annotated[list[Path], argument("Directories of evaluations.", metavar="BUNDLE...")],
    benchmark: Annotated[
        str | None, option("File of their benchmark, if it does not ship here.")
    ] = None,
    out: Annotated[Path, option("The page.")] = Path("results.html"),
) -> None:
    """Write one page with a table of all policies and clocks of several evaluations, and their
    films."""
    from pipeline.data.atomic import write_atomic
    from pipeline.evaluate.scenes.benchmark import read_benchmark
    from pipeline.evaluate.scenes.manifests import inline
    from pipeline.evaluate.scoring.compare import newest
    from pipeline.evaluate.scoring.page import board_page
    from pipeline.run.check_result import check_result as check

    scenes = None if benchmark is None else read_benchmark(benchmark)
    faults = {bundle: check(bundle, inline, benchmark=scenes).faults for bundle in bundles}
    page = board_page({bundle: newest(bundle) for bundle in bundles}, faults)
    write_atomic(out, page.encode())
    print_result({}, False, str(out))
