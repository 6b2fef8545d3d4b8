"""What a policy must know: reference policies with limited knowledge, on clocks, with events.

    python -m benchmarks.ladder --tasks decide --rows rows.jsonl
    python -m benchmarks.ladder --clocks sim,latency:100,latency:300 --rows rows.jsonl
    python -m benchmarks.ladder --policies effects --events stop@share=0.5 --rows rows.jsonl
    python -m benchmarks.ladder --tasks pick_named --conditions occluder,second --rows rows.jsonl

One row a scene, policy, clock and event; rows that the file has are not made again. With an event
every scene is run without it too, with conditions every set of them. `--table` prints the tables of
what there is."""

import argparse
import json
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from itertools import combinations
from multiprocessing import get_context
from pathlib import Path
from random import Random
from typing import Any

from benchmarks.hardware import hardware
from pipeline.data.errors import DominoError
from pipeline.data.spec import EpisodeSpec
from pipeline.evaluate.episode import EpisodeJob, run_episode
from pipeline.evaluate.names import policy_name
from pipeline.evaluate.policies.rehearsal import alike
from pipeline.evaluate.scenes.case import BLIND, admit
from pipeline.evaluate.scoring.clock import parse_clock
from pipeline.evaluate.scoring.statistics import by_task, interval, mean, wilson
from pipeline.run.names import check_known
from pipeline.stages.failure import Failure
from pipeline.tasks import TASKS
from pipeline.tasks.contract import expand_tasks

Row = dict[str, Any]

RUNGS = {
    "still": "still",
    "blind": "blind",
    "one image": "static:cue=0",
    "two images": "interceptor:cue=0",
    "watching": "reactive:cue=0,memory=0.1",
    "memory of 2 s": "reactive:memory=2",
    "told": "interceptor:foresight=1",
}
EFFECTS = {
    "static": "static",
    "chaser": "chaser",
    "interceptor": "interceptor",
    "reactive": "reactive",
    "reactive, 100 ms": "reactive:delay=0.1",
    "reactive, 300 ms": "reactive:delay=0.3",
}
CONDITIONS: dict[str, dict[str, Any]] = {
    "occluder": {"kind": "occluder", "when": {"share": 0.4}, "lasts": 1.0},
    "second": {"kind": "second", "when": {"share": 0.3}},
}
GROUPS = {"rungs": RUNGS, "effects": EFFECTS}
KEY = ("task", "level", "scene", "policy", "clock", "event")
TRIES = 30  # seeds of a scene, of which the first that the expert solves is taken


@dataclass(frozen=True)
class LadderJob:
    """A scene, and the policies, clocks and events to try in it."""

    task: str
    level: int
    scene: int
    seed: int
    wanted: tuple[tuple[str, str, str], ...]


def run(job: LadderJob) -> list[Row]:
    """The rows of a scene; none if the expert solves none of its seeds."""
    for number in range(TRIES):
        seed = job.seed + 1000 * job.scene + number
        try:
            case = admit(EpisodeSpec(job.task, "aloha-agilex", job.level, 0.1, "clean", 0, seed))
        except Failure:
            continue
        break
    else:
        return []
    rows, cue = list[Row](), len(alike(case.scene())) > 1
    for policy, clock, event in job.wanted:
        conditions = [CONDITIONS[name] for name in event.split("+")[1:]]
        setup = BLIND.override({"events": conditions or [event]}) if event else BLIND
        paired = bool(event) and not conditions
        name = policy_name(policy if cue else policy.replace("cue=0", "cue=1"))
        done = run_episode(EpisodeJob(case, name, parse_clock(clock), setup=setup, paired=paired))
        row = dict(zip(KEY, (job.task, job.level, job.scene, policy, clock, event), strict=True))
        row |= {"seed": seed, "cue": cue, "success": bool(done["success"])}
        row |= {"failed": done["failed"], "ending": done["ending"], "fault": done["fault"]}
        if paired:
            row |= {"control": bool(done["control"]["success"]), "same": done["same_prefix"]}
            row |= {"happened": done["event"], "phase": done["phase"]}
        rows.append(row)
    return rows


def share(rows: Sequence[Row]) -> str:
    """Solved of tried; per cent with Wilson's interval from 20 on."""
    good, count = sum(row["success"] for row in rows), len(rows)
    if count < 20:
        return f"{good}/{count}" if count else ""
    low, high = (100 * bound for bound in wilson(good, count))
    return f"{100 * good / count:.0f} ({low:.0f}-{high:.0f})"


def cross(
    rows: Sequence[Row], down: str, columns: Sequence[tuple[str, Callable[[Row], bool]]]
) -> str:
    """Markdown: values of the key `down`, then all, against named columns."""
    lines = ["| " + " | ".join([down, *(name for name, _ in columns)]) + " |"]
    lines.append("|---|" + "---:|" * len(columns))
    for value in [*sorted({row[down] for row in rows}), None]:
        own = [row for row in rows if value in (None, row[down])]
        cells = [share([row for row in own if takes(row)]) for _, takes in columns]
        name = "**all**" if value is None else f"`{value}`"
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def effect_groups(rows: Sequence[Row]) -> dict[tuple[str, str], list[Row]]:
    """Rows in which an event happened, by its kind and the name of the policy."""
    names = {text: name for name, text in EFFECTS.items()}
    groups = defaultdict[tuple[str, str], list[Row]](list)
    for text in dict.fromkeys([*names, *(row["policy"] for row in rows)]):
        for row in rows:
            if row["policy"] == text and row.get("happened", "none") != "none":
                kind = row["event"].partition("@")[0]
                name = text.rpartition("/")[2].partition("?")[0].partition(".")[0]
                groups[kind, names.get(text, name)].append(row)
    return groups


def effects(rows: Sequence[Row]) -> str:
    """Markdown: paired effects of events (points, with 95 % intervals) where they happened."""
    groups = effect_groups(rows)
    kinds, policies = (list(dict.fromkeys(key[i] for key in groups)) for i in (0, 1))
    lines = ["| event | " + " | ".join(policies) + " |", "|---|" + "---:|" * len(policies)]
    for kind in kinds:
        cells = [effect_text(groups.get((kind, policy), [])) for policy in policies]
        lines.append(f"| `{kind}` | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def effect(rows: Sequence[Row]) -> tuple[float, float, float]:
    """The paired effect on the success rate and its 95 % interval, in points."""
    change = by_task([("", float(row["success"]) - row["control"]) for row in rows])
    low, high = interval(change)
    return 100 * mean(change), 100 * low, 100 * high


def effect_text(rows: Sequence[Row]) -> str:
    """Rate without events, the effect with its interval, and the pairs, as text."""
    if not rows:
        return ""
    calm = 100 * sum(row["control"] for row in rows) / len(rows)
    return "{:.0f}: {:+.0f} ({:+.0f} to {:+.0f})".format(calm, *effect(rows))


def tables(rows: Sequence[Row]) -> Iterator[str]:
    """All tables that the rows fill."""
    yield hardware()
    calm = [row for row in rows if not row["event"]]
    for level in sorted({row["level"] for row in calm}):
        own = [row for row in calm if row["level"] == level]
        still = [row for row in own if row["clock"] == "sim"]
        known = [(n, text) for n, text in RUNGS.items() if any(r["policy"] == text for r in still)]
        if known:
            yield f"Level {level}, what a policy knows:"
            yield cross(
                still, "task", [(n, lambda r, t=text: r["policy"] == t) for n, text in known]
            )
        clocks = [*dict.fromkeys(row["clock"] for row in own)]
        if len(clocks) > 1:
            yield f"Level {level}, by clock:"
            several = {r["policy"] for r in own if r["clock"] != "sim"}
            own = [row for row in own if row["policy"] in several]
            yield cross(own, "policy", [(c, lambda r, c=c: r["clock"] == c) for c in clocks])
            for policy in sorted(several):
                yield f"`{policy}`:"
                one = [row for row in own if row["policy"] == policy]
                yield cross(one, "task", [(c, lambda r, c=c: r["clock"] == c) for c in clocks])
    sets = [*dict.fromkeys(row["event"] for row in rows if row["event"].startswith("+"))]
    for policy in dict.fromkeys(row["policy"] for row in rows if row["event"] in sets):
        own = [row for row in rows if row["policy"] == policy and row["clock"] == "sim"]
        shared = set[tuple[Any, ...]].intersection(
            *({_scene(row) for row in own if row["event"] == each} for each in ("", *sets))
        )
        own = [row for row in own if _scene(row) in shared]
        names = [
            (e.removeprefix("+") or "none", lambda r, e=e: r["event"] == e) for e in ("", *sets)
        ]
        yield f"`{policy}`, by condition, the same scenes in each column:"
        yield cross([row for row in own if row["event"] in ("", *sets)], "task", names)
    if any("control" in row for row in rows):
        yield "Per cent without the event: effect of the event (95 % interval)"
        yield effects(rows)


def _scene(row: Row) -> tuple[Any, ...]:
    return row["task"], row["level"], row["scene"]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--tasks", default="decide")
    parser.add_argument("--levels", default="1")
    parser.add_argument("--scenes", type=int, default=10)
    parser.add_argument("--seed", type=int, default=4_300_000)
    parser.add_argument(
        "--policies", default="rungs", help="rungs, effects, or policies separated by spaces"
    )
    parser.add_argument("--clocks", default="sim")
    parser.add_argument("--events", default="", help="one a run, as in `evaluate --events`")
    parser.add_argument("--conditions", default="", help=f"of {', '.join(CONDITIONS)}")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--rows", type=Path, required=True, help="file of JSON lines")
    parser.add_argument("--table", action="store_true", help="run nothing")
    args = parser.parse_args()
    try:
        check_known("task", expand_tasks(args.tasks.split(",")), TASKS, "--tasks: ")
    except DominoError as error:
        parser.exit(2, f"{error}\n")
    text = args.rows.read_text() if args.rows.exists() else ""
    rows: list[Row] = [json.loads(line) for line in text.splitlines()]
    if not args.table:
        known = {tuple(row[name] for name in KEY) for row in rows}
        jobs = [job for job in wanted(args, known) if job.wanted]
        Random(0).shuffle(jobs)
        context = get_context("spawn")
        with (
            ProcessPoolExecutor(args.workers, mp_context=context) as pool,
            args.rows.open("a") as file,
        ):
            for number, done in enumerate(as_completed([pool.submit(run, job) for job in jobs]), 1):
                for row in done.result():
                    rows.append(row)
                    print(json.dumps(row), file=file, flush=True)
                print(f"{number} of {len(jobs)} scenes", flush=True)
    print("\n\n".join(tables(rows)))


def wanted(args: argparse.Namespace, known: set[tuple[Any, ...]]) -> Iterator[LadderJob]:
    """The scenes with what is not known of them."""
    policies = (
        [*GROUPS[args.policies].values()] if args.policies in GROUPS else args.policies.split()
    )
    names = [name for name in args.conditions.split(",") if name]
    sets = [each for n in range(1, len(names) + 1) for each in combinations(names, n)]
    events = [*args.events.split(","), *("".join(f"+{name}" for name in each) for each in sets)]
    for scene in range(args.scenes):
        for task in expand_tasks(args.tasks.split(",")):
            for level in map(int, args.levels.split(",")):
                for event in events:
                    tried = [(p, c, event) for p in policies for c in args.clocks.split(",")]
                    left = [one for one in tried if (task, level, scene, *one) not in known]
                    yield LadderJob(task, level, scene, args.seed, tuple(left))


if __name__ == "__main__":
    main()
