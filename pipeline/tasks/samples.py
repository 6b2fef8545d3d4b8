"""Instructions drawn over all tasks, as docs/language.md shows them: `python -m pipeline.tasks.samples --seed 0 --count 100`."""

import argparse
from collections.abc import Iterator

import numpy as np

from pipeline.tasks import TASKS
from pipeline.tasks.contract import lay_out
from pipeline.tasks.language import Wording, instructions


def wording(name: str, seed: int, moving: bool) -> Wording:
    """What the instructions of one layout of a task are made from; `moving` as at levels above 0."""
    task = TASKS[name]
    bodies = lay_out(task, np.random.default_rng([seed, 0]), np.random.default_rng([seed, 1]))
    words = {body.name: body.instance.words() for body in bodies.values()}
    return Wording(task.seen, task.unseen, words, task.arms(bodies), moving)


def samples(seed: int, count: int) -> Iterator[tuple[str, str, bool, str]]:
    """Task, split, whether the target moves, and an instruction: tasks, splits and levels take turns, each in a new layout."""
    rng = np.random.default_rng(seed)
    names = sorted(TASKS)
    order: list[str] = []
    for i in range(count):
        order = order or [names[k] for k in rng.permutation(len(names))]
        name, split, moving = order.pop(), "unseen" if i % 4 == 3 else "seen", i % 3 != 2
        scene = wording(name, int(rng.integers(1 << 31)), moving)
        yield name, split, moving, instructions(scene, rng, 1)[split][0]


def page(seed: int, count: int) -> str:
    """Numbered lines of Markdown: instruction, task, split, and "still" where nothing moves."""
    lines = (
        f"{i + 1}. {text} *({name}, {split}{'' if moving else ', still'})*"
        for i, (name, split, moving, text) in enumerate(samples(seed, count))
    )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m pipeline.tasks.samples", description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=100)
    given = parser.parse_args()
    print(page(given.seed, given.count))


if __name__ == "__main__":
    main()
