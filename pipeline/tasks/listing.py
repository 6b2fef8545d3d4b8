"""What `domino-data tasks` prints."""

from typing import Any

import numpy as np

from pipeline.tasks.contract import TASKS, Draw


def listing() -> list[dict[str, Any]]:
    """All tasks by name: category, step limit, target, manipulated body, and the bodies of a scene."""
    out = []
    for name, task in sorted(TASKS.items()):
        rng = np.random.default_rng(0)
        objects = [p.name for p in task.layout(Draw(rng, rng))]
        out.append(
            {
                "name": name,
                "category": task.category,
                "objects": objects,
                "step_limit": task.step_limit,
                "target": task.target,
                "manipulated": task.manipulated,
                "description": (type(task).__doc__ or "").strip().splitlines()[0],
            }
        )
    return out
