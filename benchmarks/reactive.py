"""Accepted share of the reactive expert by level, robot and task, and why it fails: physics only.

    python -m benchmarks.reactive --slots 5 --rows rows.jsonl

One row a slot: the first attempt whose dry run and motion are accepted, so that only the reactive
expert decides. Rows that are in the file already are kept, so that a run which was stopped can be
resumed. `--table` prints the tables of the file alone.
"""

import argparse
import json
import time
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path
from statistics import median
from typing import Any

from benchmarks.hardware import hardware

ATTEMPTS = 8


@dataclass(frozen=True)
class ReactiveJob:
    """A slot with the sight of the expert (s, m)."""

    task: str
    robot: str
    level: int
    slot: int
    delay: float
    noise: float


def run(job: ReactiveJob, motions: Path | None) -> dict[str, Any]:
    """The row of a slot: "accepted", or the reason with its words. Motions that were found are
    stored in `motions`."""
    from pipeline.motion.models import motion_from_json
    from pipeline.run.names import recipe_from
    from pipeline.stages.attempt import draw_motion
    from pipeline.stages.failure import Failure
    from pipeline.stages.replay import react
    from pipeline.stages.scene import build_scene

    wanted = {
        "tasks": [job.task],
        "embodiments": [job.robot],
        "levels": [job.level],
        "episodes": job.slot + 1,
        "expert": "reactive",
    }
    recipe = recipe_from(
        {**wanted, "expert": "reactive", "sight": {"delay": job.delay, "noise": job.noise}}
    )
    slot = list(recipe.slots())[job.slot]
    kept = motions / f"{job.task}-{job.robot}-{job.level}-{job.slot}.json" if motions else None
    if kept and kept.exists():
        number, meeting, text = json.loads(kept.read_text())
        found = (
            build_scene(recipe.spec(slot, number), recipe.ruling()),
            motion_from_json(text),
            meeting,
        )
    else:
        found = None
        for number in range(ATTEMPTS):
            try:
                scene = build_scene(recipe.spec(slot, number), recipe.ruling())
                dry, motion, _ = draw_motion(scene, recipe)
            except Failure:
                continue
            found = scene, motion, dry.meeting
            if kept:
                kept.write_text(json.dumps([number, dry.meeting, motion.to_json()]))
            break
    if found is None:
        return asdict(job) | {"reason": "not drawn"}
    scene, motion, meeting = found
    began = time.process_time()
    try:
        log = react(scene, motion, recipe.sight, recipe.fps).log
        ended = {
            "reason": "accepted",
            "meeting": log.time_of("meeting"),
            "detail": "",
            "frames": len(log),
        }
    except Failure as failure:
        ended = {"reason": failure.reason, "detail": ", ".join(failure.conditions) or str(failure)}
    return asdict(job) | ended | {"planned": meeting, "cpu": round(time.process_time() - began, 2)}


def tables(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Accepted share by level and robot, then by task with its reasons."""
    rows = [row for row in rows if row["reason"] != "not drawn"]
    robots, levels = sorted({r["robot"] for r in rows}), sorted({r["level"] for r in rows})
    yield "| sight | robot | " + " | ".join(f"level {level}" for level in levels) + " |"
    yield "|---|---|" + "---|" * len(levels)
    for delay, noise in sorted({(r["delay"], r["noise"]) for r in rows}):
        for robot in robots:
            seen = [
                r for r in rows if (r["robot"], r["delay"], r["noise"]) == (robot, delay, noise)
            ]
            cells = [_share([r for r in seen if r["level"] == level]) for level in levels]
            sight = f"{1000 * delay:g} ms, {1000 * noise:g} mm" if delay or noise else "exact"
            yield f"| {sight} | {robot} | " + " | ".join(cells) + " |"
    yield ""
    yield (
        "| task | "
        + " | ".join(f"{robot}, level {level}" for robot in robots for level in levels)
        + " | why not |"
    )
    yield "|---|" + "---|" * (len(robots) * len(levels) + 1)
    by_task = defaultdict[str, list[dict[str, Any]]](list)
    for row in rows:
        if not row["delay"] and not row["noise"]:
            by_task[row["task"]].append(row)
    for task, own in sorted(by_task.items()):
        cells = [
            _share([r for r in own if (r["robot"], r["level"]) == (robot, level)])
            for robot in robots
            for level in levels
        ]
        why = Counter(_why(r) for r in own if r["reason"] != "accepted")
        yield (
            f"| {task} | "
            + " | ".join(cells)
            + " | "
            + ", ".join(f"{reason} {n}" for reason, n in why.most_common())
            + " |"
        )


def summary(rows: Sequence[dict[str, Any]]) -> str:
    """How much later than planned the expert meets the target, and the processor time of an
    episode's reactive stage."""
    late = [row["meeting"] - row["planned"] for row in rows if row["reason"] == "accepted"]
    cpu = [row["cpu"] for row in rows if "cpu" in row]
    return (
        f"Median: {median(late):.2f} s after the planned meeting, {median(cpu):.1f} s of processor"
        f" time. {hardware()}."
    )


def _why(row: dict[str, Any]) -> str:
    return row["detail"] if row["reason"] == "no_success" else row["reason"]


def _share(rows: Sequence[dict[str, Any]]) -> str:
    good = sum(row["reason"] == "accepted" for row in rows)
    return (
        f"{good}/{len(rows)}"
        if len(rows) < 20
        else f"{100 * good / len(rows):.0f} % of {len(rows)}"
    )


def main() -> None:
    from pipeline.tasks.contract import expand_tasks

    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--tasks", default="all")
    parser.add_argument("--robots", default="aloha-agilex,franka-panda")
    parser.add_argument("--levels", default="1,2,3")
    parser.add_argument("--slots", type=int, default=5)
    parser.add_argument("--first", type=int, default=0, help="first slot")
    parser.add_argument("--delay", type=float, default=0.0, help="s")
    parser.add_argument("--noise", type=float, default=0.0, help="m")
    parser.add_argument("--rows", type=Path, required=True, help="file of JSON lines")
    parser.add_argument(
        "--motions", type=Path, help="directory that keeps the motions found, for the next run"
    )
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--table", action="store_true", help="run nothing")
    args = parser.parse_args()
    rows = (
        [json.loads(line) for line in args.rows.read_text().splitlines()]
        if args.rows.exists()
        else []
    )
    if not args.table:
        known = {tuple(row[name] for name in ReactiveJob.__dataclass_fields__) for row in rows}
        every = (
            ReactiveJob(task, robot, int(level), slot, args.delay, args.noise)
            for slot in range(args.first, args.first + args.slots)
            for task in expand_tasks(args.tasks.split(","))
            for robot in args.robots.split(",")
            for level in args.levels.split(",")
        )
        jobs = [job for job in every if tuple(asdict(job).values()) not in known]
        if args.motions:
            args.motions.mkdir(parents=True, exist_ok=True)
        with (
            ProcessPoolExecutor(args.workers, mp_context=get_context("spawn")) as pool,
            args.rows.open("a") as file,
        ):
            for done in as_completed([pool.submit(run, job, args.motions) for job in jobs]):
                rows.append(done.result())
                print(json.dumps(rows[-1]), file=file, flush=True)
    print("\n".join(tables(rows)), summary(rows), sep="\n\n")


if __name__ == "__main__":
    main()
