"""Asked against realised speeds of level-1 targets per alpha, over dry runs of real scenes: `start: early` beside `start: late`.

python -m benchmarks.speed_law [--motions 300] [--alpha 0.2 0.3] [--start late] [--robots aloha-agilex,piper]

Draws layouts of the 35 tasks in turn, each with its dry run, until `--motions` of them have a motion at every alpha and start that
is asked for. Nothing is replayed.
"""

import argparse
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from tqdm import tqdm

from benchmarks.hardware import hardware
from benchmarks.success import kolmogorov_smirnov
from pipeline.data.setup import DEFAULT, Setup
from pipeline.data.spec import EpisodeSpec
from pipeline.motion.planar.levels import mean_speed
from pipeline.stages.back_calculate import back_calculate
from pipeline.stages.dry_run import dry_run
from pipeline.stages.failure import Failure
from pipeline.stages.scene import build_scene
from pipeline.tasks.contract import expand_tasks
from pipeline.world.robots import MODELS

ALPHAS = (0.05, 0.1, 0.2, 0.3)
type Start = Literal["early", "late"]
STARTS: tuple[Start, ...] = ("early", "late")

type Found = dict[tuple[float, str], list[tuple[float, float]]]
"""By alpha and start: average speed (m/s), and seconds for which the target stands first."""


def measure(motions: int, alphas: Sequence[float], starts: Sequence[Start], robots: Sequence[str]) -> tuple[int, Found]:
    """How many scenes had a dry run, and the motions that they had."""
    tasks, scenes, found = expand_tasks(["domino"]), 0, defaultdict[tuple[float, str], list[tuple[float, float]]](list)
    for k in tqdm(range(4 * motions)):
        spec = EpisodeSpec(tasks[k % len(tasks)], robots[k % len(robots)], 1, alphas[0], "clean", k, k)
        try:
            scene = build_scene(spec)
            dry = dry_run(scene, DEFAULT.fps)
        except Failure:
            continue
        scenes += 1
        for alpha in alphas:
            for start in starts:
                try:
                    motion = back_calculate(replace(scene, spec=replace(spec, alpha=alpha)), dry, Setup(start=start))
                except Failure:
                    continue
                found[alpha, start].append((motion.features().average_speed, max(0.0, -motion.lead)))
        if min(len(found[alpha, start]) for alpha in alphas for start in starts) >= motions:
            break
    return scenes, found


def main() -> None:
    """Measure and print one table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--motions", type=int, default=300)
    parser.add_argument("--alpha", type=float, nargs="+", default=ALPHAS)
    parser.add_argument("--start", choices=STARTS, nargs="+", default=STARTS)
    parser.add_argument("--robots", default=",".join(MODELS))
    args = parser.parse_args()
    scenes, found = measure(args.motions, args.alpha, args.start, args.robots.split(","))
    print(f"{scenes} scenes; {hardware()}\n")
    print(
        "| alpha (m/s) | start | motions found | asked mean (m/s) | realised mean (m/s) | D, p against the law | start late, by |"
    )
    print("|---:|---|---:|---:|---:|---:|---:|")
    for (alpha, start), motions in sorted(found.items()):
        speeds, stood = np.array(motions).T
        d, p = kolmogorov_smirnov(speeds / alpha, 0.01 / alpha)
        late = stood[stood > 0]
        by = f"{100 * len(late) / len(stood):.0f} %, {late.mean():.1f} s" if len(late) else "none"
        means = f"{mean_speed(alpha):.4f} | {speeds.mean():.4f} | {d:.3f}, {p:.2g}"
        print(f"| {alpha:g} | {start} | {len(speeds)} | {means} | {by} |")


if __name__ == "__main__":
    main()
