"""How exactly each model of motions meets: planned against first contact, over accepted attempts.
Prints one table.

python -m benchmarks.motion_models [--models a,b | --tasks a,b] [--draws 20] [--embodiment
aloha-agilex] [--seconds 600]
"""

import argparse
import time
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from pipeline.data.recipe.model import Recipe
from pipeline.data.spec import EpisodeSpec
from pipeline.motion.models import MODELS
from pipeline.stages.attempt import attempt
from pipeline.stages.failure import Failure
from pipeline.tasks import TASKS
from pipeline.tasks.contract import expand_tasks

SENSIBLE = {
    "planar": "pick_from_belt",
    "circle": "pick_from_belt",
    "sinusoid": "pick_from_belt",
    "conveyor": "pick_from_belt",
    "ramp": "take_from_ramp",
    "turntable": "ring_turning_bell",
    "rolling": "stop_rolling_ball",
    "pendulum": "take_hanging_mug",
    "handed": "take_handed_object",
    "drop": "catch_dropped_ball",
    "toss": "catch_tossed_ball",
    "pushed": "stop_pushed_can",
}
"""A task for which each model makes sense."""


@dataclass(eq=False)
class Tally:
    """Late contacts (ms) and misses (mm) of accepted attempts, and the reasons of the others."""

    late: list[float] = field(default_factory=list[float])
    miss: list[float] = field(default_factory=list[float])
    failed: Counter[str] = field(default_factory=Counter[str])


def measure(model: str, task: str, embodiment: str, draws: int, until: float) -> Tally:
    """Attempts at a task, levels 1 to 3 in turn, until `draws` are accepted, three times as many
    are tried or time is up."""
    found = Tally()
    for seed in range(3 * draws):
        if len(found.late) == draws or time.monotonic() > until:
            break
        spec = EpisodeSpec(task, embodiment, 1 + seed % 3, 0.1, "clean", 0, seed)
        try:
            rollout = attempt(spec, Recipe(motion=model))
        except Failure as failure:
            found.failed[f"{failure.stage}/{failure.reason}"] += 1
            continue
        real, end = (
            rollout.replay.log.time_of("meeting"),
            rollout.scene.bodies[rollout.scene.task.target].pose,
        )
        assert real is not None
        found.late.append(1000 * (real - rollout.meeting))
        found.miss.append(1000 * float(np.linalg.norm(rollout.motion.pose(real)[:3] - end[:3])))
    return found


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--models", default=",".join(name for name in MODELS if name in SENSIBLE))
    parser.add_argument(
        "--tasks", help="tasks or suites, each on its own model, instead of a task for each model"
    )
    parser.add_argument("--draws", type=int, default=20)
    parser.add_argument("--embodiment", default="aloha-agilex")
    parser.add_argument("--seconds", type=float, default=600.0, help="for each model at most")
    args = parser.parse_args()
    print(
        "| model | task | accepted | median, worst time error (ms) | median, worst miss (mm) |"
        " rejected |"
    )
    print("|---" * 6 + "|")
    own = expand_tasks(args.tasks.split(",")) if args.tasks else ()
    pairs = [(TASKS[name].motion, name) for name in own] or [
        (model, SENSIBLE[model]) for model in args.models.split(",")
    ]
    for model, task in pairs:
        t = measure(model, task, args.embodiment, args.draws, time.monotonic() + args.seconds)
        tried = len(t.late) + t.failed.total()
        late, miss = np.abs(t.late or [np.nan]), np.array(t.miss or [np.nan])
        why = ", ".join(f"{reason} {n}" for reason, n in t.failed.most_common()) or "none"
        times, places = (f"{np.median(x):.1f}, {x.max():.1f}" for x in (late, miss))
        print(
            f"| `{model}` | `{task}` | {len(t.late)} of {tried} | {times} | {places} | {why} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
