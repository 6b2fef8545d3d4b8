"""Whether episodes are made faster than by another version, run against run in alternation.

    python -m benchmarks.faster BASE [--rounds 3] [--tasks all] [--levels 1,3] [--episodes 1] [--workers 2] [--out FILE.md]

BASE is a worktree of the other version with its own `.venv`. In every round both make the same
episodes in fresh processes, now the one first and now the other; a worker's first episode is not
counted. Ratios are of the seconds of a round, base over this, with the least and the largest of all
rounds: of the clock, and of the processor, which holds on a machine that others load too. The floor
is bare rendering of the same frames by a warm renderer.
"""  # noqa: E501

import argparse
import json
import os
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np

from benchmarks import generation
from benchmarks.hardware import hardware

STAGES = (*generation.PHASES, "total", "floor")
ENDS = ("", ".cpu")


def made_here(recipe: str, workers: int) -> dict[str, float]:
    """Seconds per accepted episode by stage, failed attempts included, of the version on the path;
    those of the processor under names that end with ".cpu"."""
    made = generation.measure(generation.recipe_from(json.loads(recipe)), workers)
    accepted = [m for m in made if m.record.accepted]
    seconds = defaultdict[str, float](float)
    for one in made:
        # earlier versions have them in the record
        phases = getattr(one, "phases", None) or getattr(one.record, "phases", {})
        for end in ENDS:
            for stage in generation.PHASES:
                taken = phases.get(stage + end, 0.0) / len(accepted)
                seconds[stage + end] += taken
                seconds["total" + end] += taken
    for one in accepted:
        seconds["floor"] += one.floor / len(accepted)
        seconds["floor.cpu"] += one.floor_cpu / len(accepted)
    frames = float(np.mean([m.frames for m in accepted]))
    return {**seconds, "episodes": len(accepted), "attempts": len(made), "frames": frames}


def made_by(tree: Path, recipe: str, workers: int) -> dict[str, float]:
    """`made_here` by the version in a worktree. Raises CalledProcessError."""
    python = tree / ".venv/bin/python"
    command = [str(python), "-P", __file__, str(tree), "--one", recipe, "--workers", str(workers)]
    done = subprocess.run(
        command,
        cwd=tree,
        env=os.environ | {"PYTHONPATH": str(tree)},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    return json.loads(done.stdout.splitlines()[-1])


def report(rounds: list[tuple[dict[str, float], dict[str, float]]], workers: int) -> str:
    """A Markdown table of rounds (base, this): means by stage, ratios with their spread."""
    here = rounds[0][1]
    lines = [
        (
            f"{len(rounds)} rounds of {here['episodes']:.0f} episodes ({here['frames']:.0f} frames"
            f" x 3 cameras) by {workers} workers"
        ),
        "",
        (
            "| seconds per accepted episode | base, clock | this, clock | ratio | base, processor |"
            " this, processor | ratio |"
        ),
        "|---|" + "---:|" * 6,
    ]
    for stage in STAGES:
        cells = list[str]()
        for end in ENDS:
            base, this = np.array([[r[stage + end] for r in both] for both in rounds]).T
            ratio = base / np.maximum(this, 1e-9)
            cells += [f"{base.mean():.3f}", f"{this.mean():.3f}"]
            cells += [f"{np.median(ratio):.2f} ({ratio.min():.2f}-{ratio.max():.2f})"]
        lines.append(f"| {stage.replace('_', ' ')} | {' | '.join(cells)} |")
    hour = [f"{3600 * workers / np.mean([r[i]['total'] for r in rounds]):.0f}" for i in (0, 1)]
    lines.append(f"| **episodes an hour** | {hour[0]} | {hour[1]} | | | | |")
    return "\n".join(lines)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("base", type=Path, help="worktree of the other version, set up")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--tasks", default="all")
    parser.add_argument("--embodiment", default="aloha")
    parser.add_argument("--levels", default="1,3")
    parser.add_argument("--episodes", type=int, default=1, help="per task and level")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, help="write the table to this file as well")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        print(json.dumps(made_here(given.one, given.workers)))
        return
    base, this = given.base.resolve(), Path(__file__).resolve().parents[1]
    if not (base / ".venv/bin/python").exists():
        sys.exit(f"{base} has no .venv: run scripts/setup.sh there")
    recipe = json.dumps(
        {
            "tasks": given.tasks.split(","),
            "embodiments": given.embodiment.split(","),
            "levels": [int(level) for level in given.levels.split(",")],
            "episodes": given.episodes,
        }
    )
    rounds = list[tuple[dict[str, float], dict[str, float]]]()
    for k in range(given.rounds):
        order = [base, this] if k % 2 == 0 else [this, base]
        done = {tree: made_by(tree, recipe, given.workers) for tree in order}
        rounds.append((done[base], done[this]))
        print(
            f"round {k + 1}: {done[base]['total']:.2f} s, {done[this]['total']:.2f} s", flush=True
        )
    text = f"{hardware()}\n\n{report(rounds, given.workers)}"
    print(text)
    if given.out:
        given.out.write_text(text + "\n")


if __name__ == "__main__":
    main()
