"""A benchmark file: how long it takes to load, and what physics makes of its scenes where numeric
libraries use other instructions, as they do on another processor.

    python -m benchmarks.frozen domino-v1 --scenes 28

The expert's actions are recorded once. Every mode is a process of its own that takes them, and the
scenes, from files: it carries the actions out, and lets `interceptor`, which plans live, try the
same scenes.
"""

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.hardware import hardware
from pipeline.evaluate.episode import EpisodeJob, play
from pipeline.evaluate.policies.policy import PolicyName
from pipeline.evaluate.scenes.benchmark import Benchmark, read_benchmark, shipped_benchmarks
from pipeline.evaluate.scenes.case import Case, expert_actions
from pipeline.evaluate.scenes.trial import Trial
from pipeline.evaluate.scoring.clock import parse_clock
from pipeline.poses import Floats
from pipeline.stages.failure import Failure

LOADED = 1750
"""Scenes that are loaded: as many as one level has, 50 of each of 35 tasks."""

OLD = ["AVX", "AVX2", "FMA", "FMA4", "AVX512F", "AVX512CD", "AVX512BW", "AVX512DQ", "AVX512VL"]
NUMPY = "AVX2 FMA3 AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL AVX512_SPR"
LIBRARIES = {
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=" + ",".join(f"-{name}" for name in OLD),
    "NPY_DISABLE_CPU_FEATURES": NUMPY,
    "OPENBLAS_CORETYPE": "Nehalem",
}
MODES = {
    "the same again": {},
    "numba for a generic x86-64": {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""},
    "glibc, numpy, OpenBLAS without AVX and FMA": LIBRARIES,
    "all of these": {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": "", **LIBRARIES},
}
"""Environments of a mode."""


def load(benchmark: str) -> tuple[float, float]:
    """Processor seconds to read LOADED scenes, and to rebuild their bodies; a smaller benchmark is
    taken several times."""
    read = rebuilt = count = 0.0
    while count < LOADED:
        began = time.process_time()
        cases = chosen(found := read_benchmark(benchmark), len(found.lines))
        middle = time.process_time()
        for case in cases:
            case.scene()
        read, rebuilt = read + middle - began, rebuilt + time.process_time() - middle
        count += len(cases)
    return read * LOADED / count, rebuilt * LOADED / count


def chosen(benchmark: Benchmark, scenes: int) -> list[Case]:
    """As many scenes, spread over all cells."""
    each = benchmark.cases([cell.cell() for cell in benchmark.head.cells], benchmark.head.scenes)
    cases = [case for of_cell in zip(*each.values(), strict=True) for case in of_cell]
    return cases[:: max(1, len(cases) // scenes)][:scenes]


def record(cases: list[Case], actions: dict[str, Floats]) -> dict[str, Any]:
    """By scene: poses (T,B,7) and commands under recorded actions and under the policy, and whether
    they solve it."""
    out = dict[str, Any]()
    for number, case in enumerate(cases):
        trial = Trial(case.scene(), case.target_motion)
        for action in actions[str(number)]:
            if trial.ending:
                break
            trial.advance(action)
        out[f"{number}.poses"] = trial.log().poses
        out[f"{number}.commands"] = trial.commanded
        out[f"{number}.success"] = trial.ending == "success"
        policy = PolicyName("interceptor", "interceptor", process="evaluator")
        done, row = play(EpisodeJob(case, policy, parse_clock("sim")))
        out[f"{number}.live poses"] = done.log().poses
        out[f"{number}.live commands"] = done.commanded
        out[f"{number}.live success"] = row["success"]
    return out


def compare(first: dict[str, Any], second: dict[str, Any], kind: str) -> str:
    """Shares of scenes with equal commands, states and outcomes, and how far (mm) bodies are apart
    at the same time in the worst scene."""
    scenes = sum(name.endswith(f".{kind}success") for name in first)
    outcomes = commands = states = 0
    apart = list[float]()
    for number in range(scenes):
        one, other = (run[f"{number}.{kind}poses"] for run in (first, second))
        outcomes += first[f"{number}.{kind}success"] == second[f"{number}.{kind}success"]
        states += one.tobytes() == other.tobytes()
        told = (run[f"{number}.{kind}commands"] for run in (first, second))
        commands += next(told).tobytes() == next(told).tobytes()
        both = min(len(one), len(other))
        apart.append(1000 * float(np.abs(one[:both, :, :3] - other[:both, :, :3]).max()))
    counts = " | ".join(f"{equal} of {scenes}" for equal in (commands, states, outcomes))
    return f"{counts} | {max(apart):.2g}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("benchmark", nargs="?", default=next(iter(shipped_benchmarks()), ""))
    parser.add_argument("--scenes", type=int, default=28)
    parser.add_argument("--record", type=Path, help="do the work of one mode")
    parser.add_argument("--actions", type=Path)
    args = parser.parse_args()
    cases = chosen(read_benchmark(args.benchmark), args.scenes)
    if args.record:
        with np.load(args.actions) as actions:
            np.savez(args.record, **record(cases, dict(actions)))
        return
    read, rebuilt = load(args.benchmark)
    print(
        f"{LOADED} scenes of {args.benchmark} are read in {read:.1f} processor seconds; rebuilding"
    )
    print(f"their bodies takes {rebuilt:.1f} more.\n")
    with TemporaryDirectory() as folder:
        file = Path(folder) / "actions.npz"
        kept = {}
        for number, case in enumerate(cases):
            try:
                kept[str(number)] = expert_actions(case)
            except Failure:
                kept[str(number)] = np.zeros((0, 14))
        np.savez(file, **kept)
        runs = dict[str, dict[str, Any]]()
        for name, more in {"": {}, **MODES}.items():
            out = Path(folder) / "run.npz"
            environment = os.environ | more
            if more:
                environment["NUMBA_CACHE_DIR"] = str(Path(folder) / "numba")
            words = (args.benchmark, "--scenes", str(args.scenes), "--record", str(out))
            subprocess.run(
                [sys.executable, "-m", "benchmarks.frozen", *words, "--actions", str(file)],
                env=environment,
                check=True,
            )
            with np.load(out) as done:
                runs[name] = dict(done)
        print(
            "| actions | numeric mode | equal commands | equal states | equal outcomes | worst mm |"
        )
        print("|---|---|---:|---:|---:|---:|")
        for kind, title in (("", "recorded"), ("live ", "planned live")):
            for name in MODES:
                print(f"| {title} | {name} | {compare(runs[''], runs[name], kind)} |")
    print(f"\n{hardware()}")


if __name__ == "__main__":
    main()
