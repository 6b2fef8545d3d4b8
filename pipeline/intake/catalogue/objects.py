"""What `domino-data objects` prints."""

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from pipeline.tasks import TASKS
from pipeline.tasks.layout import families_of
from pipeline.world.objects.contract import FAMILIES


def listing(names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Families by name, from their instance of seed 0: noun, size (m), mass (kg), parameters,
    frames, number of grasps by kind, and the tasks whose layouts draw it.

    A named frame is a pose (x y z qw qx qy qz) in the object's frame."""
    out = {}
    for name in names:
        one = FAMILIES[name].draw(np.random.Generator(np.random.Philox(0)))
        shape, frames = one.shape(), one.frames()
        out[name] = {
            "noun": one.words().noun,
            "size": np.ptp(shape.aabb(), axis=0).round(4).tolist(),
            "mass": round(shape.mass, 4),
            "parameters": list(vars(one)),
            "frames": {label: p.round(5).tolist() for label, p in frames.points.items()},
            "grasps": dict(Counter(g.kind for g in frames.grasps)),
            "tasks": [task for task in sorted(TASKS) if name in families_of(TASKS[task])],
        }
    return out
