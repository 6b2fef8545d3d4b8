"""What `domino-data embodiments` prints."""

from typing import Any

from pipeline.world.cameras import cameras_of
from pipeline.world.robots import EMBODIMENTS, get_embodiment
from pipeline.world.robots.contract import SIDES


def listing() -> list[dict[str, Any]]:
    """All robots by name: degrees of freedom, vector names, limits (rad), gripper opening (m), cameras, aliases."""
    out = []
    for name in EMBODIMENTS:
        e = get_embodiment(name)
        joints = [(side, j) for side in SIDES for j in e.arms[side].joints if j.name in e.arms[side].arm_joints]
        out.append(
            {
                "name": name,
                "aliases": list(e.aliases),
                "dof": len(e.vector_names),
                "joints": list(e.vector_names),
                "limits": {f"{side}_{j.name}": [j.lower, j.upper] for side, j in joints},
                "max_opening": {side: e.arms[side].gripper.max_opening for side in SIDES},
                "cameras": [c.name for c in cameras_of(e)],
            }
        )
    return out
