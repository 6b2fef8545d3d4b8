"""Attempt success of tasks x robots x levels, physics only: `python -m benchmarks.success --robots all --levels 1 --slots 5`.

Slots are filled as a build fills them, without images: attempts, each with a layout of its own, until one is accepted. Prints per
cent of attempts accepted, tasks down, robots across, means with Wilson's 95 % interval, how the accepted targets move against how
the law draws them, and the reasons of failure. `--alpha` takes a list and then prints yield and speeds per alpha, drawn with
`--plot FILE.png`. `--rows FILE.parquet` keeps every attempt.
"""

import argparse
from collections import Counter, defaultdict
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, fields
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray
from scipy import stats
from tqdm import tqdm

from benchmarks.hardware import hardware
from pipeline.data.recipe.model import Recipe, Slot
from pipeline.data.spec import DOMAINS, EpisodeSpec
from pipeline.evaluate.scoring.intervals import wilson
from pipeline.motion.planar.motion import Features
from pipeline.report.speed_law import drawn_and_accepted, law
from pipeline.stages.attempt import Phases, attempt
from pipeline.stages.failure import Failure
from pipeline.tasks.contract import expand_tasks
from pipeline.world.robots import MODELS, get_embodiment

ORIGINAL_STATIC = {"aloha-agilex": 78.2, "arx-x5": 77.9, "franka-panda": 69.0, "piper": 27.0, "ur5-wsg": 61.3}
"""Mean static expert success of the original over its 35 tasks, per cent (RoboTwin 2.0 documentation)."""


@dataclass(frozen=True)
class Try:
    """The outcome of one attempt: its number at its slot, the reason (empty if accepted), and seconds of processor time.

    Also the features of the target's motion (m/s and m), if it had one."""

    spec: EpisodeSpec
    number: int
    reason: str
    detail: str
    seconds: float
    drawn: Features | None

    def row(self) -> dict[str, Any]:
        """As a row of attempts.parquet, with the processor seconds."""
        outcome = "failed" if self.reason else "accepted"
        stage, _, reason = self.reason.partition(": ")
        said = {"attempt": self.number, "outcome": outcome, "stage": stage, "reason": reason, "detail": self.detail}
        return asdict(self.spec) | said | {"seconds": self.seconds} | (asdict(self.drawn) if self.drawn else {})


def read_rows(paths: Sequence[Path]) -> list[Try]:
    """Attempts kept by `--rows`; a later file replaces the tasks that it holds."""
    by_task: dict[str, list[Try]] = {}
    for path in paths:
        found = defaultdict[str, list[Try]](list)
        for row in pq.read_table(path).to_pylist():
            spec = EpisodeSpec(**{f.name: row[f.name] for f in fields(EpisodeSpec)})
            drawn = Features(*(row[f.name] for f in fields(Features))) if row.get("average_speed") is not None else None
            reason = f"{row['stage']}: {row['reason']}" if row["outcome"] == "failed" else ""
            found[spec.task].append(Try(spec, row["attempt"], reason, row["detail"], row["seconds"], drawn))
        by_task |= found
    return [one for group in by_task.values() for one in group]


def fill(job: tuple[Recipe, Slot]) -> list[Try]:
    """Attempts at a slot until one is accepted."""
    recipe, slot = job
    tries = list[Try]()
    for number in range(recipe.attempts):
        phases, spec = Phases(), recipe.spec(slot, number)
        try:
            rollout = attempt(spec, recipe, phases)
        except Failure as failure:
            reason = f"{failure.stage}: {failure.reason}"
            tries.append(Try(spec, number, reason, failure.detail, sum(phases.cpu.values()), failure.drawn))
        else:
            tries.append(Try(spec, number, "", "", sum(phases.cpu.values()), rollout.motion.features()))
            break
    return tries


def run(jobs: Sequence[tuple[Recipe, Slot]], workers: int) -> list[Try]:
    """All slots in fresh processes; a bar shows how far and how well it goes. Ctrl-C ends it with what is finished."""
    tries = list[Try]()
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool, tqdm(total=len(jobs), unit="slot") as bar:
        try:
            for found in pool.map(fill, jobs, chunksize=1):
                tries += found
                bar.update()
                bar.set_postfix_str(f"{np.mean([not x.reason for x in tries]):.1%} of {len(tries)} attempts accepted")
        except KeyboardInterrupt:
            pool.shutdown(cancel_futures=True)
    return tries


def rates(tries: Sequence[Try], robots: Sequence[str], levels: Sequence[int]) -> str:
    """Markdown: tasks down, robots across, per cent of attempts accepted over all levels; means over tasks, per level too."""
    tasks = sorted({t.spec.task for t in tries})
    rows = [" | ".join(["| task", *robots, "s per accepted |"]), "|---|" + "---:|" * (len(robots) + 1)]
    for task in tasks:
        shares = [share(tries, (task,), robot, levels) for robot in robots]
        rows.append(" | ".join([f"| {task}", *shares, f"{cost([t for t in tries if t.spec.task == task]):.1f} |"]))
    for level in levels if len(levels) > 1 else ():
        means = [share(tries, tasks, robot, (level,)) for robot in robots]
        rows.append(" | ".join([f"| mean, level {level}", *means, f"{cost([t for t in tries if t.spec.level == level]):.2f} |"]))
    means = [f"**{share(tries, tasks, robot, levels)}**" for robot in robots]
    rows.append(" | ".join(["| **mean**", *means, f"{cost(tries):.2f} |"]))
    rows.append(" | ".join(["| 95 % interval", *(interval(tries, robot) for robot in robots), " |"]))
    still = [share(tries, tasks, robot, levels, "dry_run") for robot in robots]
    rows.append(" | ".join(["| dry runs alone", *still, " |"]))
    rows.append(
        " | ".join(
            [
                "| original, static (clean; its expert, attempts over seeds)",
                *(f"{ORIGINAL_STATIC[robot]:.0f}" for robot in robots),
                " |",
            ]
        )
    )
    return "\n".join(rows)


def share(tries: Sequence[Try], tasks: Sequence[str], robot: str, levels: Sequence[int], upto: str = "") -> str:
    """Per cent of attempts accepted, as text; with `upto="dry_run"` of those that got past the dry run."""
    early = ("layout", "dry_run")
    group = [
        not t.reason.startswith(early) if upto else not t.reason
        for t in tries
        if t.spec.task in tasks and t.spec.embodiment == robot and t.spec.level in levels
    ]
    return f"{100 * np.mean(group):.0f}"


def interval(tries: Sequence[Try], robot: str) -> str:
    """Wilson's 95 % interval of the share of a robot's attempts that were accepted, as text in per cent."""
    good = [not t.reason for t in tries if t.spec.embodiment == robot]
    low, high = wilson(sum(good), len(good))
    return f"{100 * low:.1f}-{100 * high:.1f}"


def domains(tries: Sequence[Try]) -> str:
    """Markdown: per cent of attempts accepted by domain, of every task, every level and all, with Wilson's 95 % interval of all."""
    names = [name for name in DOMAINS if any(t.spec.domain == name for t in tries)]
    groups: dict[str, list[Try]] = {
        task: [t for t in tries if t.spec.task == task] for task in sorted({t.spec.task for t in tries})
    }
    groups |= {f"level {level}": [t for t in tries if t.spec.level == level] for level in sorted({t.spec.level for t in tries})}
    rows = [f"| attempts | {' | '.join(names)} |", "|---|" + "---:|" * len(names)]
    for name, group in groups.items():
        shares = ["{} of {}".format(*_count_accepted(group, domain)) for domain in names]
        rows.append(f"| {name} | {' | '.join(shares)} |")
    counts = [_count_accepted(tries, domain) for domain in names]
    ends = [[100 * end for end in wilson(*count)] for count in counts]
    said = [f"**{100 * n / of:.1f}** ({low:.1f}-{high:.1f})" for (n, of), (low, high) in zip(counts, ends, strict=True)]
    return "\n".join([*rows, f"| **all, %** | {' | '.join(said)} |"])


def _count_accepted(tries: Sequence[Try], domain: str) -> tuple[int, int]:
    """How many attempts of a domain were accepted, and of how many."""
    good = [not t.reason for t in tries if t.spec.domain == domain]
    return sum(good), len(good)


def speeds(tries: Sequence[Try], levels: Sequence[int]) -> str:
    """Markdown: motions drawn against motions accepted per level, and the test of level 1 against the paper's law."""
    head = "| level | motions | number | average m/s | end m/s | displacement m | under 5 cm | at 0.01 m/s | 0.8 alpha or more |"
    rows = [head, "|---:|---|" + "---:|" * 7]
    for level in levels:
        groups = drawn_and_accepted([t.row() for t in tries if t.spec.level == level])
        for name, group in zip(("drawn", "accepted"), groups, strict=True):
            if (m := law(group)) is not None:
                means = f"{m.count} | {m.average_speed:.4f} | {m.end_speed:.4f} | {m.displacement:.3f}"
                rows.append(f"| {level} | {name} | {means} | {m.short:.0%} | {m.slow:.1%} | {m.fast:.0%} |")
    accepted = [t for t in tries if t.spec.level == 1 and not t.reason and t.drawn]
    if accepted:
        relative = [t.drawn.average_speed / t.spec.alpha for t in accepted if t.drawn]
        statistic, p = kolmogorov_smirnov(relative, 0.01 / accepted[0].spec.alpha)
        rows.append(
            f"\nLevel 1: Kolmogorov-Smirnov of {len(accepted)} accepted speeds against the law: D {statistic:.3f}, p {p:.2f}"
        )
    return "\n".join(rows)


def kolmogorov_smirnov(relative: Sequence[float] | NDArray[np.float64], slowest: float = 0.1) -> tuple[float, float]:
    """Statistic and p of speeds over alpha against clip(abs(N(0.8, 1/3)), slowest, 1), by its probability integral transform.
    `slowest` is 0.01 m/s over alpha.

    The law has atoms at both clips, where the transform draws from the atom's share: then it is uniform under the law.
    """
    normal, rng = stats.norm(0.8, 1 / 3), np.random.default_rng(0)
    x = np.asarray(relative)
    below = normal.cdf(x) - normal.cdf(-x)
    low, high = normal.cdf(slowest) - normal.cdf(-slowest), normal.cdf(1.0) - normal.cdf(-1.0)
    spread = rng.random(len(x))
    u = np.where(x <= slowest + 1e-9, spread * low, np.where(x >= 1 - 1e-9, high + spread * (1 - high), below))
    found = stats.kstest(u, "uniform")
    return float(found.statistic), float(found.pvalue)


def reasons(tries: Sequence[Try]) -> str:
    """Markdown: why attempts failed, per robot and task, with the conditions that did not hold."""
    counts = Counter((t.spec.embodiment, t.spec.task, _describe_try(t)) for t in tries if t.reason)
    rows = ["| robot | task | stage and reason | attempts |", "|---|---|---|---:|"]
    return "\n".join(rows + [f"| {robot} | {task} | {reason} | {n} |" for (robot, task, reason), n in sorted(counts.items())])


def _describe_try(t: Try) -> str:
    return f"{t.reason} ({t.detail.rpartition(': ')[2]})" if t.reason.endswith("no_success") else t.reason


def cost(tries: Sequence[Try]) -> float:
    """CPU seconds of all attempts per accepted one."""
    return sum(t.seconds for t in tries) / max(1, sum(not t.reason for t in tries))


def alphas(tries: Sequence[Try]) -> str:
    """Markdown: yield and target speeds per alpha."""
    rows = ["| alpha m/s | accepted % | average speed | fastest |", "|---:|---:|---:|---:|"]
    for alpha in sorted({t.spec.alpha for t in tries}):
        group = [t for t in tries if t.spec.alpha == alpha]
        good = [t.drawn for t in group if not t.reason and t.drawn]
        speeds = (np.mean([m.average_speed for m in good]), max(m.maximum_speed for m in good)) if good else (0.0, 0.0)
        rows.append(f"| {alpha:g} | {100 * len(good) / len(group):.0f} | {speeds[0]:.3f} | {speeds[1]:.3f} |")
    return "\n".join(rows)


def plot(tries: Sequence[Try], path: Path) -> None:
    """Picture of the yield and of the target's speeds against alpha, one line per task and their mean."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    steps = sorted({t.spec.alpha for t in tries})
    tasks = sorted({t.spec.task for t in tries})
    by: dict[tuple[str, float], list[bool]] = defaultdict(list)
    for t in tries:
        by[t.spec.task, t.spec.alpha].append(not t.reason)
    share = np.array([[np.mean(by[task, alpha]) for alpha in steps] for task in tasks])
    for name, row in zip(tasks, share, strict=True):
        left.plot(steps, 100 * row, marker=".", lw=0.8, alpha=0.6, label=name)
    left.plot(steps, 100 * share.mean(0), "k", marker="o", lw=2, label="mean")
    left.set(xlabel="alpha (m/s)", ylabel="attempts accepted (%)", ylim=(0, 103))
    left.legend(fontsize=7)
    good = [[t.drawn for t in tries if t.spec.alpha == a and not t.reason and t.drawn] for a in steps]
    width = 0.3 * float(np.diff(steps).min())
    right.boxplot([[m.average_speed for m in group] for group in good], positions=steps, widths=width, manage_ticks=False)
    right.plot(steps, [max((m.maximum_speed for m in group), default=np.nan) for group in good], "r^", label="fastest instant")
    right.plot([0, steps[-1]], [0, steps[-1]], "k:", label="alpha")
    right.set(xlabel="alpha (m/s)", ylabel="target speed, average of an episode (m/s)", ylim=(0, None))
    right.legend(fontsize=7)
    figure.savefig(path, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tasks", default="all")
    parser.add_argument("--robots", default="aloha")
    parser.add_argument("--levels", default="1")
    parser.add_argument("--alpha", default="0.1")
    parser.add_argument("--domains", default="clean")
    parser.add_argument("--slots", type=int, default=5, help="slots per task, robot, level, alpha and domain")
    parser.add_argument("--seed", type=int, default=0, help="seed of the recipe: other ones are other layouts")
    parser.add_argument("--attempts", type=int, default=30)
    parser.add_argument("--contact", help="what the first touch does to the target, where it is not what the rules say")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, help="also write the tables, with the reasons of failure, here")
    parser.add_argument("--rows", type=Path, help="write all attempts to this Parquet file")
    parser.add_argument("--read", type=Path, nargs="+", help="make no attempts: print the tables of these Parquet files")
    parser.add_argument("--plot", type=Path, help="draw yield and speeds against alpha here")
    args = parser.parse_args()
    tasks = expand_tasks(args.tasks.split(","))
    robots = list(MODELS) if args.robots == "all" else [get_embodiment(r).name for r in args.robots.split(",")]
    levels, alpha = [int(x) for x in args.levels.split(",")], [float(x) for x in args.alpha.split(",")]
    recipe = Recipe.model_validate(
        {
            **{"seed": args.seed, "tasks": tasks, "embodiments": robots, "levels": levels, "alpha": alpha},
            **{"domains": args.domains.split(","), "episodes": args.slots, "attempts": args.attempts, "contact": args.contact},
        }
    )
    tries = read_rows(args.read) if args.read else run([(recipe, slot) for slot in recipe.slots()], args.workers)
    if args.rows:
        pq.write_table(pa.Table.from_pylist([t.row() for t in tries]), args.rows)
    what = f"{len(tries)} attempts, levels {args.levels}, alpha {args.alpha}, {args.domains}"
    head = f"{what}, {cost(tries):.2f} s of processor time (physics and planning, failures included) per accepted episode."
    parts = [
        head,
        hardware(),
        rates(tries, robots, levels),
        *([domains(tries)] if len({t.spec.domain for t in tries}) > 1 else []),
        speeds(tries, levels),
        *([alphas(tries)] if len(alpha) > 1 else []),
        reasons(tries),
    ]
    print("\n\n".join(parts))
    if args.out:
        args.out.write_text("\n\n".join(parts) + "\n")
    if args.plot:
        plot(tries, args.plot)


if __name__ == "__main__":
    main()
