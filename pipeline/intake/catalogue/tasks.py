"""What `domino-data tasks` prints."""

from typing import Any

import numpy as np

from pipeline.tasks.contract import TASKS, Draw


def listing() -> list[dict[str, Any]]:
    """All tasks by name: suite, model of the target's motion, category, step limit (frames),
    target, manipulated body, bodies of a scene, and the first sentence of the docstring."""
    out = []
    for name, task in sorted(TASKS.items()):
        rng = np.random.default_rng(0)
        objects = [p.name for p in task.layout(Draw(rng, rng))]
        out.append(
            {
                "name": name,
                "suite": task.suite,
                "motion": task.motion,
                "category": task.category,
                "objects": objects,
                "step_limit": task.step_limit,
                "target": task.target,
                "manipulated": task.manipulated,
                "description": _first_sentence(type(task).__doc__ or ""),
            }
        )
    return out


def _first_sentence(docstring: str) -> str:
    """What a docstring says up to its first full stop, blank line or end, on one line."""
    paragraph = " ".join(docstring.strip().split("\n\n")[0].split())
    return paragraph.split(". ")[0].rstrip(".")
