"""Instructions drawn over all tasks: `python -m pipeline.intake.catalogue.sentences >
docs/language.md` updates that page."""

import argparse
from collections.abc import Iterator

import numpy as np

from pipeline.tasks import TASKS
from pipeline.tasks.contract import Draw
from pipeline.tasks.language.sentences import Wording, instructions
from pipeline.tasks.layout import lay_out

SEED, COUNT = 0, 58
INTRODUCTION = """# Instructions

Every episode comes with instructions in words, 100 for each of the splits `seen` and `unseen` unless the recipe says otherwise.
They are made from templates (`phrases/TASK.txt` beside the task's file: 50 seen and 10 unseen for every task) and descriptions
(`phrases/FAMILY.txt` beside the object's file: 12 seen and 3 unseen, true of its colour, size and form). An instruction

- is true of its episode: it names arms that act, the goal and the facing that success requires, and nothing that does not happen;
- speaks of motion only if the target moves: never at level 0, and about one time in four above it;
- names every thing once, with a pronoun after that, and has the acting arm beside the verb that it belongs to.

`pipeline/tasks/language/check.py` looks for slot leaks, articles, number, repeated nouns and misused verbs ("pick up it"). It also
finds words of motion in still scenes, arms that do not act, phrases that attach to the wrong noun, and vague phrases. A test checks
10,000 instructions over all tasks, and `domino-data check-task` checks a task.

Below are {count} instructions of seed {seed}, drawn over all tasks, both splits, moving and still scenes, each in a new layout.
`python -m pipeline.intake.catalogue.sentences --seed 1` prints others; without options it prints this page.

| instruction | task | split |
|---|---|---|
"""  # noqa: E501


def wording(name: str, seed: int, moving: bool) -> Wording:
    """What the instructions of one layout of a task are made from; `moving` as at levels above
    0."""
    task = TASKS[name]
    bodies = lay_out(task, Draw(np.random.default_rng([seed, 0]), np.random.default_rng([seed, 1])))
    words = {body.name: body.instance.words() for body in bodies.values()}
    return Wording(task.seen, task.unseen, words, task.arms(bodies), moving)


def samples(seed: int, count: int) -> Iterator[tuple[str, str, bool, str]]:
    """Task, split, whether the target moves, and an instruction: tasks, splits and levels take
    turns, each in a new layout."""
    rng = np.random.default_rng(seed)
    names = sorted(TASKS)
    order: list[str] = []
    for i in range(count):
        order = order or [names[k] for k in rng.permutation(len(names))]
        name, split, moving = order.pop(), "unseen" if i % 4 == 3 else "seen", i % 3 != 2
        scene = wording(name, int(rng.integers(1 << 31)), moving)
        yield name, split, moving, instructions(scene, rng, 1)[split][0]


def page(seed: int, count: int) -> str:
    """The page docs/language.md: the rules that sentences keep, and `count` of them."""
    lines = (
        f"| {text} | {name} | {split}{'' if moving else ', still'} |"
        for name, split, moving, text in samples(seed, count)
    )
    return INTRODUCTION.format(seed=seed, count=count) + "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m pipeline.intake.catalogue.sentences", description=__doc__
    )
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--count", type=int, default=COUNT)
    given = parser.parse_args()
    print(page(given.seed, given.count), end="")


if __name__ == "__main__":
    main()
