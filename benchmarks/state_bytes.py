"""Fingerprints of the physics: one line a slot with the hash of its state log, to compare two
versions of the code.

    python -m benchmarks.state_bytes > before.txt
    python -m benchmarks.state_bytes --against before.txt

40 slots: every task once, robots and levels taking turns, then five randomized. A restructuring
must not change a line.
"""

import argparse
import hashlib
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np

ROBOTS = ("aloha-agilex", "arx-x5", "franka-panda", "piper", "ur5-wsg")
ARRAYS = ("times", "poses", "qpos", "qvel", "state", "action", "tcp", "target_velocity", "contacts")


def specs() -> list[tuple[str, str, int, str]]:
    """(task, robot, level, domain) of the 40 slots."""
    from pipeline.tasks.contract import expand_tasks

    names = expand_tasks(["domino"])
    clean = [(task, ROBOTS[i % 5], (i + i // 5) % 4, "clean") for i, task in enumerate(names)]
    return clean + [(names[7 * i], ROBOTS[i], 1 + i % 3, "randomized") for i in range(5)]


def fingerprint(job: tuple[str, str, int, str]) -> str:
    """Line of one slot: its name and the hash of everything its first attempt produced, or why that
    attempt failed."""
    from pipeline.run.names import recipe_from
    from pipeline.stages.attempt import attempt
    from pipeline.stages.failure import Failure

    task, robot, level, domain = job
    recipe = recipe_from(
        {
            "tasks": [task],
            "embodiments": [robot],
            "levels": [level],
            "domains": [domain],
            "alpha": 0.1,
            "episodes": 1,
        }
    )
    slot = next(recipe.slots())
    name = f"{task}/{robot}/L{level}/{domain}"
    for number in range(3):
        try:
            done = attempt(recipe.spec(slot, number), recipe)
        except Failure as failure:
            name += f" {failure.stage}:{failure.reason}:{failure.steps}"
            continue
        digest, log = hashlib.sha256(), done.replay.log
        for key in ARRAYS:
            digest.update(np.ascontiguousarray(getattr(log, key)).tobytes())
        digest.update(repr([(e.name, e.time) for e in log.events]).encode())
        digest.update(done.motion.to_json().encode())
        return f"{name} {digest.hexdigest()[:32]} {done.steps}"
    return f"{name} none"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--against",
        type=Path,
        help="an earlier output to compare with; exit code 1 where a line differs",
    )
    parser.add_argument("--workers", type=int, default=2)
    args = parser.parse_args()
    with ProcessPoolExecutor(args.workers, mp_context=get_context("spawn")) as pool:
        lines = list(pool.map(fingerprint, specs()))
    print("\n".join(lines))
    if args.against:
        old = args.against.read_text().splitlines()
        changed = [f"{a}\n    was {b}" for a, b in zip(lines, old, strict=True) if a != b]
        print(
            f"{len(lines) - len(changed)} of {len(lines)} lines are equal",
            *changed,
            sep="\n",
            file=sys.stderr,
        )
        sys.exit(bool(changed))


if __name__ == "__main__":
    main()
